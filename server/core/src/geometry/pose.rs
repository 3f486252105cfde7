//! A rigid placement.

use glam::{DQuat, DVec3};

/// Rotation, then translation, from a body's own frame (the prop's origin) to the world.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Pose {
    /// Metres.
    pub translation: DVec3,
    /// Unit quaternion.
    pub rotation: DQuat,
}

impl Pose {
    pub const IDENTITY: Pose = Pose { translation: DVec3::ZERO, rotation: DQuat::IDENTITY };

    /// Where a point of the body's frame lies in the world.
    pub fn transform_point(&self, p: DVec3) -> DVec3 {
        self.translation + self.rotation * p
    }

    /// The pose between `self` (at 0) and `other` (at 1), rotating along the shorter arc.
    pub fn interpolate(&self, other: &Pose, s: f64) -> Pose {
        Pose {
            translation: self.translation.lerp(other.translation, s),
            rotation: self.rotation.slerp(other.rotation, s).normalize(),
        }
    }
}
