//! How thick a solid is from place to place, and its parts: limbs, handles, sheets.
//!
//! The local thickness at a point is the diameter of the largest ball within the solid that contains the point
//! (Hildebrand & Rueegsegger 1997). It is sampled: a ball for each of many points of the inside, that which touches the
//! surface at the point nearest to it (the shrinking ball of Ma, Bae & Choi 2012).

use crate::interior::MeshInterior;
use glam::DVec3;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

/// Points of the inside.
const SAMPLES: usize = 2000;
/// A ball fills the corners around it: up to this many of its radii, a point belongs to it. The corner of a square is
/// sqrt(2) radii from the middle.
const CORNER: f64 = 1.42;
/// The largest ball is within this share of its radius.
const ACCURACY: f64 = 1e-3;
/// Bound on the shrinking of a ball, which takes some five steps.
const MOST_STEPS: usize = 30;
/// Points are neighbours up to this many of their mean distances.
const NEIGHBOURS: f64 = 2.0;
/// Parts that are named in words.
const NAMED: usize = 3;
/// A part has at least this share of the solid's volume.
pub const LEAST_PART: f64 = 0.01;

/// A solid's local thickness at random points.
#[derive(Clone, Debug, Default)]
pub struct LocalThickness {
    points: Vec<DVec3>,
    /// The largest ball that holds each of them.
    balls: Vec<Ball>,
    /// Their distances from the surface, ascending, m.
    depths: Vec<f64>,
    /// Mean distance of the points, m.
    spacing: f64,
}

/// A ball within the solid that touches its surface.
#[derive(Clone, Copy, Debug)]
struct Ball {
    center: DVec3,
    radius: f64,
}

/// A connected part of a solid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Of the box around it, m.
    pub center: [f64; 3],
    /// Of that box, m.
    pub size: [f64; 3],
    /// Of the solid's volume.
    pub share: f64,
    /// Its local thickness, m: half of it is thicker.
    pub thickness: f64,
}

impl LocalThickness {
    /// Of the inside of a mesh. Without samples, where that fills next to nothing of its box.
    pub fn new(region: &MeshInterior) -> LocalThickness {
        let mut rng = Pcg64Mcg::seed_from_u64(0);
        let points: Vec<DVec3> = (0..SAMPLES).map_while(|_| region.sample_inside(&mut rng)).collect();
        let (touching, mut depths): (Vec<Ball>, Vec<f64>) =
            points.iter().map(|&point| touching_ball(region, point)).unzip();
        let largest = |(&point, own): (&DVec3, &Ball)| {
            let holds = |ball: &&Ball| ball.center.distance_squared(point) <= (CORNER * ball.radius).powi(2);
            let larger = |a: Ball, b: &Ball| if b.radius > a.radius { *b } else { a };
            touching.iter().filter(holds).fold(*own, larger)
        };
        let balls = points.iter().zip(&touching).map(largest).collect();
        depths.sort_by(f64::total_cmp);
        let spacing = libm::cbrt(region.volume() / points.len().max(1) as f64);
        LocalThickness { points, balls, depths, spacing }
    }

    /// At a point, m.
    fn thickness(&self, i: usize) -> f64 {
        2.0 * self.balls[i].radius
    }

    /// Share of the volume that is at least so thick, m. 1 without samples.
    pub fn share(&self, thickness: f64) -> f64 {
        match self.points.len() {
            0 => 1.0,
            n => (0..n).filter(|&i| self.thickness(i) >= thickness).count() as f64 / n as f64,
        }
    }

    /// Share of the volume that is no farther from the surface than that, m. 0 without samples.
    pub fn share_within(&self, depth: f64) -> f64 {
        self.depths.partition_point(|&d| d <= depth) as f64 / self.depths.len().max(1) as f64
    }

    /// The distance from the surface, m, within which that share of the volume lies. 0 without samples.
    pub fn depth_of_share(&self, share: f64) -> f64 {
        let place = (share.clamp(0.0, 1.0) * self.depths.len() as f64) as usize;
        self.depths.get(place.min(self.depths.len().saturating_sub(1))).copied().unwrap_or(0.0)
    }

    /// The parts that are thinner than that, m.
    pub fn thinner(&self, thickness: f64) -> Vec<Part> {
        self.parts(|i| self.thickness(i) < thickness)
    }

    /// The parts whose middle is not covered.
    pub fn uncovered(&self, is_covered: impl Fn(DVec3) -> bool) -> Vec<Part> {
        self.parts(|i| !is_covered(self.balls[i].center))
    }

    /// Connected parts of the points that belong to them, the largest first.
    fn parts(&self, belongs: impl Fn(usize) -> bool) -> Vec<Part> {
        let mut left: Vec<usize> = (0..self.points.len()).filter(|&i| belongs(i)).collect();
        let near = (NEIGHBOURS * self.spacing).powi(2);
        let mut parts = Vec::new();
        while let Some(first) = left.pop() {
            let mut members = vec![first];
            let mut next = 0;
            while let Some(&from) = members.get(next) {
                let from = self.points[from];
                let is_near = |i: &usize| self.points[*i].distance_squared(from) <= near;
                members.extend(left.extract_if(.., |i| is_near(i)));
                next += 1;
            }
            if members.len() as f64 >= LEAST_PART * self.points.len() as f64 {
                parts.push(self.part(&members));
            }
        }
        parts.sort_by(|a, b| b.share.total_cmp(&a.share));
        parts
    }

    fn part(&self, members: &[usize]) -> Part {
        let points = members.iter().map(|&i| self.points[i]);
        let (low, high) = crate::mesh::bounds(points);
        let mut thickness: Vec<f64> = members.iter().map(|&i| self.thickness(i)).collect();
        thickness.sort_by(f64::total_cmp);
        Part {
            center: ((low + high) / 2.0).to_array(),
            size: (high - low).to_array(),
            share: members.len() as f64 / self.points.len() as f64,
            thickness: thickness[thickness.len() / 2],
        }
    }
}

/// Where parts are, in words: the largest ones.
pub fn describe_parts(parts: &[Part]) -> String {
    let place = |part: &Part| {
        let ([x, y, z], thickness) = (part.center, part.thickness);
        format!("{thickness:.3} m thick around ({x:.2}, {y:.2}, {z:.2})")
    };
    let mut places: Vec<String> = parts.iter().take(NAMED).map(place).collect();
    places.extend((parts.len() > NAMED).then(|| "...".into()));
    places.join("; ")
}

/// The largest ball within the solid that touches the surface at the place nearest to a point.
/// Besides, the point's distance from the surface, m.
fn touching_ball(region: &MeshInterior, point: DVec3) -> (Ball, f64) {
    let (foot, depth, _) = region.nearest(point);
    let inward = (point - foot).normalize_or_zero();
    // No larger one is within its box.
    let (low, high) = region.bounds();
    let mut radius = (high - low).min_element() / 2.0;
    for _ in 0..MOST_STEPS {
        let middle = foot + inward * radius;
        let Some(touched) = region.nearest_within(middle, (1.0 - ACCURACY) * radius) else { break };
        let across = touched - foot;
        // Through both points.
        let smaller = across.length_squared() / (2.0 * inward.dot(across));
        if smaller.is_nan() || !(0.0..radius).contains(&smaller) {
            break;
        }
        radius = smaller;
    }
    let radius = radius.max(depth);
    (Ball { center: foot + inward * radius, radius }, depth)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TriMesh;

    /// A box from corner to corner.
    fn cuboid(low: [f64; 3], high: [f64; 3]) -> TriMesh {
        let corner = |i: usize| DVec3::from_array([0, 1, 2].map(|a| if i >> a & 1 == 0 { low[a] } else { high[a] }));
        let faces: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        TriMesh { points: (0..8).map(corner).collect(), triangles }
    }

    fn joined(meshes: &[TriMesh]) -> TriMesh {
        let mut all = TriMesh::default();
        for mesh in meshes {
            let first = all.points.len() as u32;
            all.points.extend(&mesh.points);
            all.triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| v + first)));
        }
        all
    }

    #[test]
    fn a_slab_is_as_thick_as_it_is_and_a_cube_too() {
        for (high, thickness) in [([4.0, 0.5, 4.0], 0.5), ([1.0, 1.0, 1.0], 1.0), ([0.2, 0.2, 3.0], 0.2)] {
            let found = LocalThickness::new(&MeshInterior::new(&cuboid([0.0; 3], high)));
            assert!(found.share(0.98 * thickness) > 0.95, "{high:?}: {}", found.share(0.98 * thickness));
            assert_eq!(found.share(1.01 * thickness), 0.0, "{high:?}");
            assert_eq!(found.thinner(0.9 * thickness), [], "{high:?}: corners are no parts");
        }
    }

    #[test]
    fn limbs_are_named_by_their_place() {
        // A trunk with two thin legs, which reach into it.
        let mesh = joined(&[
            cuboid([-1.0, 1.0, -0.5], [1.0, 2.0, 0.5]),
            cuboid([-0.9, 0.0, -0.1], [-0.7, 1.1, 0.1]),
            cuboid([0.7, 0.0, -0.1], [0.9, 1.1, 0.1]),
        ]);
        let found = LocalThickness::new(&MeshInterior::new(&mesh));
        let legs = found.thinner(0.3);
        assert_eq!(legs.len(), 2, "{legs:?}");
        for leg in &legs {
            let [x, y, z] = leg.center;
            assert!((x.abs() - 0.8).abs() < 0.05 && (y - 0.5).abs() < 0.1 && z.abs() < 0.05, "{leg:?}");
            assert!((leg.thickness - 0.2).abs() < 0.02 && (0.01..0.03).contains(&leg.share), "{leg:?}");
        }
        assert_eq!(found.thinner(0.15), []);
        let upper = found.uncovered(|p| p.x < 0.0 || p.y > 1.0);
        assert_eq!(upper.len(), 1, "{upper:?}");
        assert!(upper[0].center[0] > 0.6);
    }
}
