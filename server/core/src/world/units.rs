//! Engine units: the one place of the conversion.

use crate::geometry::pose::Pose;
use crate::input::params::Time;
use glam::DQuat;
use rapier3d::math::Pose as EnginePose;

/// SI value of one engine unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Units {
    /// m: the diameter d of the median prop.
    pub length: f64,
    /// s: the characteristic time sqrt(d / g).
    pub time: f64,
    /// kg.
    pub mass: f64,
}

impl Units {
    /// Units in which the median prop has size, mass and gravity 1.
    pub fn new(diameter: f64, mass: f64, gravity: f64) -> Units {
        Units { length: diameter, time: (diameter / gravity).sqrt(), mass }
    }

    /// A duration in engine units.
    pub fn duration(&self, time: Time) -> f64 {
        match time {
            Time::Natural(t) => t,
            Time::Seconds(s) => s / self.time,
        }
    }

    pub fn pose_to_engine(&self, pose: &Pose) -> Pose {
        Pose { translation: pose.translation / self.length, ..*pose }
    }

    pub fn pose_to_si(&self, pose: &Pose) -> Pose {
        Pose { translation: pose.translation * self.length, ..*pose }
    }
}

/// A pose in the engine's type; its lengths are engine units already.
pub(super) fn to_engine(pose: &Pose) -> EnginePose {
    EnginePose::from_parts(pose.translation.as_vec3(), pose.rotation.as_quat())
}

/// The reverse of [`to_engine`].
pub(super) fn from_engine(pose: &EnginePose) -> Pose {
    let q: DQuat = pose.rotation.as_dquat();
    Pose { translation: pose.translation.as_dvec3(), rotation: q.normalize() }
}
