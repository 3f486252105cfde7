//! The curve skeleton of a shape: lines inside its convex parts, which connect all of them.
//!
//! The engine pushes each part of a body out of a sheet on the side where that is shorter. With parts on both sides,
//! the body meets the sheet nowhere and still has it through its middle: the skeleton shows that.

use super::{Shape, Solid, corners};
use cairn_geometry::pose::Pose;
use cairn_geometry::topology::DisjointSets;
use glam::DVec3;
use rapier3d::math::Vector;
use rapier3d::parry::query::{self, Contact};

/// The line between the two corners of a part that are farthest apart counts this far from its middle: at its ends, it
/// is no deeper in the part than a contact may be.
const INNER: f64 = 0.8;

impl Shape {
    /// The lines of the skeleton at a pose, `scale` engine units per metre of the prop. None for a ball.
    pub fn skeleton<'a>(&'a self, scale: f64, pose: &Pose) -> impl Iterator<Item = [DVec3; 2]> + 'a {
        let pose = *pose;
        let lines = self.skeleton.get_or_init(|| self.find_skeleton());
        lines.iter().map(move |line| line.map(|p| pose.transform_point(p * scale)))
    }

    /// At scale 1, m.
    fn find_skeleton(&self) -> Vec<[DVec3; 2]> {
        let parts = match &self.solid {
            Solid::Ball { .. } => return Vec::new(),
            Solid::Box(_) => vec![corners(self, 1.0, &Pose::IDENTITY).collect()],
            Solid::Convex(parts) => parts.clone(),
        };
        let mut lines: Vec<[DVec3; 2]> = parts.iter().map(|part| longest(part)).collect();
        let middles: Vec<DVec3> = parts.iter().map(|part| part.iter().sum::<DVec3>() / part.len() as f64).collect();
        let mut sets = DisjointSets::new(parts.len());
        // The parts that reach deepest into each other are joined first.
        for (a, b, joint) in self.joints() {
            if sets.find(a) != sets.find(b) {
                sets.join(a, b);
                lines.extend([[middles[a], joint], [joint, middles[b]]]);
            }
        }
        lines
    }

    /// Pairs of parts, each with a point that both hold, or that is between them; nearest first.
    fn joints(&self) -> Vec<(usize, usize, DVec3)> {
        let size = self.size.diameter;
        let Some(hulls) = self.unit_hulls() else { return Vec::new() };
        let mut found: Vec<(f32, usize, usize, Vector)> = Vec::new();
        for (b, second) in hulls.iter().enumerate() {
            for (a, first) in hulls[..b].iter().enumerate() {
                let here = Default::default();
                if let Ok(Some(Contact { point1, point2, dist, .. })) = query::contact(&here, first, &here, second, 2.0)
                    && (point1 + point2).is_finite()
                {
                    found.push((dist, a, b, (point1 + point2) / 2.0));
                }
            }
        }
        found.sort_by(|one, other| one.0.total_cmp(&other.0));
        found.into_iter().map(|(_, a, b, p)| (a, b, p.as_dvec3() * size)).collect()
    }
}

/// The line between the points that are farthest apart, without its ends.
fn longest(points: &[DVec3]) -> [DVec3; 2] {
    let pairs = points.iter().enumerate().flat_map(|(i, &p)| points[i..].iter().map(move |&q| [p, q]));
    let far = |pair: &[DVec3; 2]| pair[0].distance_squared(pair[1]);
    let [a, b] = pairs.max_by(|one, other| far(one).total_cmp(&far(other))).unwrap_or_default();
    let middle = (a + b) / 2.0;
    [a, b].map(|p| middle + INNER * (p - middle))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::Size;
    use cairn_geometry::mesh::TriMesh;
    use cairn_input::params::{Accuracy, Params};
    use cairn_input::scene::{Model, Prop};

    /// Blocks along a circle of radius 1, so many of sixteen.
    fn arc(count: u32) -> Shape {
        let block = crate::shape::hull_mesh(
            &(0..8)
                .map(|i| DVec3::new(f64::from(i & 1) - 0.5, f64::from(i >> 1 & 1) - 0.5, f64::from(i >> 2) - 0.5))
                .map(|p| p * DVec3::new(0.25, 0.2, 0.45))
                .collect::<Vec<_>>(),
        );
        let mut mesh = TriMesh::default();
        for k in 0..count {
            let turn = glam::DQuat::from_rotation_y(f64::from(k) * std::f64::consts::TAU / 16.0);
            let points = block.points.iter().map(|&p| turn * (p + DVec3::X)).collect();
            mesh.append(&TriMesh { points, ..block.clone() });
        }
        let size = Size::of(&mesh);
        let prop = Prop::new(Model::new("arc", mesh));
        Shape::new(&prop, size, &Params::new(Accuracy::Draft).physics).unwrap()
    }

    #[test]
    fn the_skeleton_connects_all_parts_and_stays_in_them() {
        for count in [5, 9, 16] {
            let shape = arc(count);
            let lines: Vec<[DVec3; 2]> = shape.skeleton(1.0, &Pose::IDENTITY).collect();
            let parts = shape.solid.parts();
            assert!(parts >= 3, "{count} blocks: {parts} parts");
            assert_eq!(lines.len(), parts + 2 * (parts - 1), "a line in each part, and two for each joint");
            // Away from the middle of the circle, around which there is nothing; parts bridge some of the bend.
            let axis = -shape.center;
            for [a, b] in lines {
                for t in 0..=8 {
                    let p = a.lerp(b, f64::from(t) / 8.0) - axis;
                    let r = p.x.hypot(p.z);
                    assert!((0.6..1.2).contains(&r), "{count} blocks: a line is {r} from the axis");
                    assert!(p.y.abs() < 0.11);
                }
            }
        }
    }
}
