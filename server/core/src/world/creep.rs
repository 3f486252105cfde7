//! What creeps must not fall asleep. The engine puts to sleep whatever has been slow for a while, and a block that begins to
//! slide down a slope is slow: asleep, it would hang there as if glued.

use super::{Role, World};
use rapier3d::prelude::*;

/// Where a body was at the last look.
#[derive(Default)]
pub struct Marks {
    /// Engine time since then.
    time: f64,
    /// Shape `[body]`.
    poses: Vec<Pose>,
}

/// From one look to the next, natural times: less than half of the time after which an island sleeps.
const WINDOW: f64 = 0.7;
/// A body that has moved by more than this since the last look (its centre, or its rim by turning; d) stays awake. A block
/// whose slope is a tenth of a degree too steep moves farther by the second look; what has come to rest does not.
const CREEP: f64 = 0.001;

impl World {
    /// After a step: nothing that has crept since the last look may sleep before the next.
    pub(super) fn keep_awake_what_creeps(&mut self) {
        self.marks.time += self.step_length();
        if self.marks.time < WINDOW {
            return;
        }
        self.marks.time = 0.0;
        let known = self.marks.poses.len();
        for (id, body) in self.bodies.iter().enumerate() {
            let pose = match body.role {
                Role::Gone => Pose::IDENTITY,
                _ => *self.engine.bodies[body.handle].position(),
            };
            if id >= known {
                self.marks.poses.push(pose);
                continue;
            }
            let before = std::mem::replace(&mut self.marks.poses[id], pose);
            let turned = before.rotation.angle_between(pose.rotation) * body.radius as f32;
            let moved = before.translation.distance(pose.translation).max(turned);
            let creeps = body.role == Role::Free && moved > CREEP as f32;
            if creeps && let Some(rigid) = self.engine.bodies.get_mut(body.handle).filter(|rigid| !rigid.is_sleeping())
            {
                rigid.activation_mut().time_since_can_sleep = 0.0;
            }
        }
    }
}
