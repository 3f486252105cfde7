//! Engine units: the one place of the conversion.

use crate::geometry::pose::Pose;
use crate::input::params::Time;

/// SI value of one engine unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Units {
    /// m.
    pub length: f64,
    /// s.
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
