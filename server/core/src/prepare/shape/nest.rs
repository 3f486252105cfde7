//! How deep props of one kind go into each other.

use super::{Shape, Solid};
use glam::{DQuat, DVec3};
use rapier3d::math::Pose as EnginePose;
use rapier3d::parry::query::intersection_test;

/// Halvings of the distance.
const HALVINGS: usize = 16;

impl Shape {
    /// How far above another one the prop comes to lie where its `up` axis (unit, in the body's frame) is up, turned about it by `turn`
    /// against the other: m at scale 1, at most `height`. Less than that for cups, bowls and plates.
    pub fn nesting(&self, up: DVec3, turn: f64, height: f64) -> f64 {
        if !matches!(&self.solid, Solid::Convex(parts) if parts.len() > 1) {
            return height;
        }
        let unit = self.size.diameter;
        let Some((place, solid)) = self.collider(1.0 / unit) else { return height };
        let overlap = |distance: f64| {
            let turn = DQuat::from_axis_angle(up, turn).as_quat();
            let above = EnginePose::from_parts((up * (distance / unit)).as_vec3(), turn) * place;
            intersection_test(&place, &*solid, &above, &*solid).is_ok_and(|hit| hit.intersecting)
        };
        let (mut low, mut high) = (0.0, height);
        for _ in 0..HALVINGS {
            let middle = (low + high) / 2.0;
            if overlap(middle) { low = middle } else { high = middle }
        }
        high
    }
}
