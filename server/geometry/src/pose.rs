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

    /// A point of the body's frame -> the world.
    pub fn transform_point(&self, p: DVec3) -> DVec3 {
        self.translation + self.rotation * p
    }

    /// Upper bound on the distance between the two places of any point within `radius` of the frame's origin.
    pub fn moved(&self, other: &Pose, radius: f64) -> f64 {
        let turned = (self.rotation.inverse() * other.rotation).normalize();
        // A turn by the angle a moves a point at the radius r by 2 r sin(a / 2).
        self.translation.distance(other.translation) + 2.0 * radius * turned.xyz().length()
    }

    /// The pose between `self` (at 0) and `other` (at 1), rotating along the shorter arc.
    pub fn interpolate(&self, other: &Pose, s: f64) -> Pose {
        Pose {
            translation: self.translation.lerp(other.translation, s),
            rotation: self.rotation.slerp(other.rotation, s).normalize(),
        }
    }
}
