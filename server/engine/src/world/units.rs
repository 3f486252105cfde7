//! Poses in the engine's type.

pub use crate::units::Units;

use cairn_geometry::pose::Pose;
use glam::DQuat;
use rapier3d::math::Pose as EnginePose;

/// A pose in the engine's type; its lengths are engine units already.
pub(super) fn to_engine(pose: &Pose) -> EnginePose {
    EnginePose::from_parts(pose.translation.as_vec3(), pose.rotation.as_quat())
}

/// The reverse of [`to_engine`].
pub(super) fn from_engine(pose: &EnginePose) -> Pose {
    let q: DQuat = pose.rotation.as_dquat();
    Pose { translation: pose.translation.as_dvec3(), rotation: q.normalize() }
}
