//! Bodies that creep must not fall asleep. The engine puts to sleep any body that has been slow for a while, and a
//! block that begins to slide down a slope is slow: asleep, it would hang there as if glued. A body that moves to and
//! fro without getting anywhere, as the engine's contacts let some bodies do forever, may sleep.

use super::WorldCounters;
use crate::world::bodies::{Bodies, Role, WorldBody};
use rapier3d::prelude::*;

/// Poses of the bodies at earlier looks. Shapes `[body]`.
#[derive(Clone, Default)]
pub struct Creep {
    /// Engine time since the last look.
    time: f64,
    looks: u32,
    last: Vec<Pose>,
    /// [`LONG`] looks ago, or up to twice as many.
    early: Vec<Pose>,
    /// At the last multiple of [`LONG`] looks.
    late: Vec<Pose>,
}

/// From one look to the next, characteristic times: less than half of the time after which an island sleeps.
const WINDOW: f64 = 0.7;
/// A body that has moved by more than this since the last look (its center, or its rim by turning; d) stays awake. A
/// block whose slope is a tenth of a degree too steep moves farther by the second look; a body at rest does not.
const CREEP: f64 = 0.001;
/// Looks after which a body that creeps at that pace has moved by this many times as much. A body that has not, only
/// rocks.
const LONG: u32 = 20;

impl Creep {
    /// After a step: no body that has crept since the last look may sleep before the next.
    pub fn prevent_sleep(&mut self, engine: &mut PhysicsWorld, bodies: &Bodies, counters: &mut WorldCounters) {
        self.time += f64::from(engine.integration_parameters.dt);
        if self.time < WINDOW {
            return;
        }
        self.time = 0.0;
        let pose = |(id, body): (usize, &WorldBody)| match body.role {
            Role::Gone => Pose::IDENTITY,
            _ => bodies.pose(engine, id),
        };
        let now: Vec<Pose> = bodies.as_slice().iter().enumerate().map(pose).collect();
        for (id, body) in bodies.free().take_while(|&(id, _)| id < self.last.len()) {
            if moved(&self.last[id], &now[id], body) <= CREEP {
                continue;
            }
            let rocks =
                self.early.get(id).is_some_and(|before| moved(before, &now[id], body) <= f64::from(LONG) * CREEP);
            counters.rocking_looks += u64::from(rocks);
            let rigid = engine.bodies.get_mut(body.carrier).filter(|rigid| !rocks && !rigid.is_sleeping());
            if let Some(rigid) = rigid {
                rigid.activation_mut().time_since_can_sleep = 0.0;
            }
        }
        self.looks += 1;
        if self.looks.is_multiple_of(LONG) {
            self.early = std::mem::replace(&mut self.late, now.clone());
        }
        self.last = now;
    }
}

/// Displacement of a body's center, or of its rim by rotation, whichever is larger; d.
fn moved(from: &Pose, to: &Pose, body: &WorldBody) -> f64 {
    let turned = from.rotation.angle_between(to.rotation) as f64 * body.radius;
    turned.max(from.translation.distance(to.translation) as f64)
}
