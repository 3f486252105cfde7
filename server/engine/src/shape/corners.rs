//! The corners of a shape.

use super::{Shape, Solid};
use cairn_geometry::pose::Pose;
use glam::DVec3;

/// The corners of a shape at a pose, `scale` engine units per metre of the prop.
pub fn corners<'a>(shape: &'a Shape, scale: f64, pose: &Pose) -> Box<dyn Iterator<Item = DVec3> + 'a> {
    let pose = *pose;
    match &shape.solid {
        Solid::Box(b) => Box::new((0..8).map(move |i| {
            let sign = DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2 & 1)) * 2.0 - 1.0;
            pose.transform_point((b.center + b.rotation * (b.half * sign)) * scale)
        })),
        Solid::Ball { center, radius } => Box::new((0..6).map(move |i| {
            let axis = DVec3::AXES[i / 2] * if i % 2 == 0 { *radius } else { -*radius };
            pose.transform_point(*center * scale) + axis * scale
        })),
        Solid::Convex(parts) => Box::new(parts.iter().flatten().map(move |&p| pose.transform_point(p * scale))),
    }
}
