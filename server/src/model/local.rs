//! Where a node stands relative to the one above it.

use glam::{DAffine3, DQuat, DVec3};

/// Translation, rotation and scale.
#[derive(Clone, Copy)]
pub struct Local {
    pub translation: DVec3,
    pub rotation: DQuat,
    pub scale: DVec3,
}

impl Local {
    pub fn affine(&self) -> DAffine3 {
        DAffine3::from_scale_rotation_translation(self.scale, self.rotation, self.translation)
    }
}

/// Made unit length, whatever the file says.
pub fn unit(q: DQuat) -> DQuat {
    if q.length_squared() > 0.0 { q.normalize() } else { DQuat::IDENTITY }
}
