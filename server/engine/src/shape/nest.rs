//! Nesting poses: cups, bowls and plates in others of their kind.

use super::{Shape, Solid, hull_mesh};
use cairn_geometry::raster::rasterise;
use cairn_geometry::{MOST_ITERATIONS, ROUNDING, TOLERANCE};
use glam::{DQuat, DVec2, DVec3};
use rapier3d::math::Pose as EnginePose;
use rapier3d::parry::query::intersection_test;
use std::f64::consts::TAU;

/// Cells of the height fields, along each axis.
const CELLS: usize = 96;
/// Halvings of the distance.
const HALVINGS: usize = 16;
/// Start of the search for a plane at rest, diameters: beyond every prop, and below every gap.
const FAR: f64 = 100.0;

/// The pose of a prop at rest in another one of its kind, in the frame of the one below.
#[derive(Clone, Copy, Debug)]
pub struct NestingPose {
    pub rotation: DQuat,
    /// The height of its centre of mass above the other's, m at scale 1.
    pub pitch: f64,
}

impl Shape {
    /// Nesting poses of one prop in another of its kind, both upright along `up` (unit, in the body's frame), at
    /// `turns` evenly spaced rotations about it. Empty for a convex prop. A prop that is not quite round leans a
    /// little, to a different side at each rotation.
    pub fn nesting_poses(&self, up: DVec3, turns: usize) -> Vec<NestingPose> {
        let Solid::Convex(parts) = &self.solid else { return Vec::new() };
        if parts.len() < 2 {
            return Vec::new();
        }
        let unit = self.size.diameter;
        let upright = DQuat::from_rotation_arc(up, DVec3::Y);
        let mut triangles: Vec<[DVec3; 3]> = Vec::new();
        for part in parts {
            let mesh = hull_mesh(&part.iter().map(|&p| upright * p / unit).collect::<Vec<_>>());
            triangles.extend((0..mesh.triangles.len()).map(|i| mesh.corners(i)));
        }
        let below = heights(&triangles, f64::max);
        let nesting = |turn: DQuat| {
            let turned: Vec<_> = triangles.iter().map(|t| t.map(|p| turn * p)).collect();
            let gaps = gaps(&below, &heights(&turned, f64::min));
            let [slope_x, slope_z] = resting_slope(&gaps);
            let lean = DQuat::from_rotation_arc(DVec3::Y, DVec3::new(-slope_x, 1.0, -slope_z).normalize());
            let rotation = (upright.inverse() * lean * turn * upright).normalize();
            Some(NestingPose { rotation, pitch: self.pitch(up, rotation)? })
        };
        (0..turns).filter_map(|i| nesting(DQuat::from_rotation_y(TAU * i as f64 / turns as f64))).collect()
    }

    /// Least distance along `up` at which the prop in this rotation does not overlap another one; m at scale 1.
    fn pitch(&self, up: DVec3, rotation: DQuat) -> Option<f64> {
        let unit = self.size.diameter;
        let (place, solid) = self.collider(1.0 / unit)?;
        let overlap = |distance: f64| {
            let above = EnginePose::from_parts((up * distance).as_vec3(), rotation.as_quat()) * place;
            intersection_test(&place, &*solid, &above, &*solid).is_ok_and(|hit| hit.intersecting)
        };
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = (low + high) / 2.0;
            if overlap(middle) { low = middle } else { high = middle }
        }
        Some(high * unit)
    }
}

/// The highest or lowest of the triangles above each cell; NaN where there is none.
fn heights(triangles: &[[DVec3; 3]], of: fn(f64, f64) -> f64) -> Vec<f64> {
    // The diameter is 1: no point is further than that from the centre of mass.
    let mut heights = vec![f64::NAN; CELLS * CELLS];
    for triangle in triangles {
        let placed = triangle.map(|p| (DVec2::new(p.x, p.z) + 1.0, p.y));
        rasterise(placed, edge(), [CELLS; 2], &[0.0], |cell, _, y| heights[cell] = of(heights[cell], y));
    }
    heights
}

/// Edge of a cell: the height fields cover two diameters.
fn edge() -> f64 {
    2.0 / CELLS as f64
}

/// The cells that both cover (x, z), and the height by which the upper one must be raised there (y).
fn gaps(below: &[f64], above: &[f64]) -> Vec<DVec3> {
    let at = |i: usize| edge() * (i as f64 + 0.5) - 1.0;
    let gap = |i: usize| DVec3::new(at(i % CELLS), below[i] - above[i], at(i / CELLS));
    (0..below.len()).map(gap).filter(|gap| gap.y.is_finite()).collect()
}

/// Slopes along X and Z of the lowest plane, at the origin, that is nowhere below these points: how a body lies at rest
/// on three of them. By the simplex method on the dual program, the weights of the points that carry.
fn resting_slope(points: &[DVec3]) -> [f64; 2] {
    let mut carry = [0.0, 1.0, 2.0].map(|i| DVec3::new(libm::cos(TAU * i / 3.0), -1.0, libm::sin(TAU * i / 3.0)) * FAR);
    for _ in 0..MOST_ITERATIONS {
        let Some([slope_x, height, slope_z]) = plane(carry) else { break };
        let above = |p: &DVec3| p.y - (height + slope_x * p.x + slope_z * p.z);
        let Some(highest) = points.iter().max_by(|a, b| above(a).total_cmp(&above(b))) else { break };
        if above(highest) <= TOLERANCE {
            break;
        }
        // It takes the place of one of the three, so that the origin stays between them.
        let around = |k: usize| {
            let mut three = carry;
            three[k] = *highest;
            let least = weights(three).map_or(f64::NEG_INFINITY, |w| w.min_element());
            (least, three)
        };
        carry = [around(0), around(1), around(2)].into_iter().reduce(|a, b| if b.0 > a.0 { b } else { a }).unwrap().1;
    }
    plane(carry).filter(|_| carry.iter().all(|p| p.y > -FAR / 2.0)).map_or([0.0; 2], |[x, _, z]| [x, z])
}

/// The shares of three points of which the origin, seen from above, is the mean.
fn weights([a, b, c]: [DVec3; 3]) -> Option<DVec3> {
    let flat = |p: DVec3| DVec2::new(p.x, p.z);
    let area = |p: DVec3, q: DVec3| flat(p).perp_dot(flat(q));
    let shares = DVec3::new(area(b, c), area(c, a), area(a, b));
    let whole = shares.element_sum();
    (whole.abs() > ROUNDING).then(|| shares / whole)
}

/// Slope along X, height at the origin and slope along Z of the plane through three points.
fn plane([a, b, c]: [DVec3; 3]) -> Option<[f64; 3]> {
    let normal = (b - a).cross(c - a);
    (normal.y.abs() > ROUNDING).then(|| [-normal.x / normal.y, normal.dot(a) / normal.y, -normal.z / normal.y])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On three of the points, between which the origin is.
    #[test]
    fn a_plane_rests_on_the_points_around_the_origin() {
        let at = |x: f64, z: f64| DVec3::new(x, 0.3 + 0.1 * x - 0.2 * z, z);
        let carry = [at(1.0, 0.1), at(-0.4, 0.9), at(-0.5, -0.8)];
        let below = (0..40).map(|i| at(0.5 * libm::cos(f64::from(i)), 0.5 * libm::sin(f64::from(i))) - DVec3::Y * 0.01);
        let points: Vec<DVec3> = carry.into_iter().chain(below).collect();
        let [x, z] = resting_slope(&points);
        assert!((x - 0.1).abs() < 1e-9 && (z + 0.2).abs() < 1e-9, "{x} {z}");
        let below = |p: &DVec3| p.y <= 0.3 + x * p.x + z * p.z + 1e-9;
        assert!(points.iter().all(below));
    }

    /// Nothing rests on points that are all on one side.
    #[test]
    fn a_plane_without_a_rest_is_level() {
        assert_eq!(resting_slope(&[DVec3::new(1.0, 0.0, 0.0), DVec3::new(2.0, 1.0, 0.5)]), [0.0; 2]);
        assert_eq!(resting_slope(&[]), [0.0; 2]);
    }
}
