//! What creeps must not fall asleep. The engine puts to sleep whatever has been slow for a while, and a block that begins to
//! slide down a slope is slow: asleep, it would hang there as if glued. What moves to and fro without getting anywhere, as
//! the engine's contacts let some bodies do for ever, may sleep.

use super::{BodyId, Role, World, WorldBody};
use rapier3d::prelude::*;

/// Where the bodies were at earlier looks. Shapes `[body]`.
#[derive(Default)]
pub struct Marks {
    /// Engine time since the last look.
    time: f64,
    looks: u32,
    last: Vec<Pose>,
    /// [`LONG`] looks ago, or up to twice as many.
    early: Vec<Pose>,
    /// At the last multiple of [`LONG`] looks.
    late: Vec<Pose>,
}

/// From one look to the next, natural times: less than half of the time after which an island sleeps.
const WINDOW: f64 = 0.7;
/// A body that has moved by more than this since the last look (its centre, or its rim by turning; d) stays awake. A block
/// whose slope is a tenth of a degree too steep moves farther by the second look; what has come to rest does not.
const CREEP: f64 = 0.001;
/// Looks after which a body that creeps at that pace has moved by this many times as much.
const LONG: u32 = 20;
/// A body that is within this distance of where it was [`LONG`] looks ago, d, only rocks.
const ROCKING: f64 = LONG as f64 * CREEP;

impl World {
    /// After a step: nothing that has crept since the last look may sleep before the next.
    pub(super) fn keep_awake_what_creeps(&mut self) {
        self.marks.time += self.step_length();
        if self.marks.time < WINDOW {
            return;
        }
        self.marks.time = 0.0;
        let now: Vec<Pose> = (0..self.bodies.len()).map(|id| self.pose_or_none(id)).collect();
        let Marks { last, early, .. } = &self.marks;
        for (id, body) in self.bodies.iter().enumerate().take(last.len()).filter(|(_, body)| body.role == Role::Free) {
            if moved(&last[id], &now[id], body) <= CREEP {
                continue;
            }
            let rocks = early.get(id).is_some_and(|before| moved(before, &now[id], body) <= ROCKING);
            self.counters.rocking_looks += u64::from(rocks);
            let rigid = self.engine.bodies.get_mut(body.handle).filter(|rigid| !rocks && !rigid.is_sleeping());
            if let Some(rigid) = rigid {
                rigid.activation_mut().time_since_can_sleep = 0.0;
            }
        }
        self.marks.looks += 1;
        if self.marks.looks.is_multiple_of(LONG) {
            self.marks.early = std::mem::replace(&mut self.marks.late, now.clone());
        }
        self.marks.last = now;
    }

    fn pose_or_none(&self, id: BodyId) -> Pose {
        match self.bodies[id].role {
            Role::Gone => Pose::IDENTITY,
            _ => self.engine_pose(id),
        }
    }
}

/// How far a body's centre has moved, or its rim by turning, whichever is more; d.
fn moved(from: &Pose, to: &Pose, body: &WorldBody) -> f64 {
    let turned = from.rotation.angle_between(to.rotation) as f64 * body.radius;
    turned.max(from.translation.distance(to.translation) as f64)
}
