//! Looks for bodies that stand still in the air, in each frame.

use crate::carried::Carried;
use cairn_engine::world::{BodyId, REST_SPEED, Role, World};

/// What was seen so far.
#[derive(Debug, Default)]
pub struct Hanging {
    /// Bodies that stood still in the air, summed over the frames.
    pub body_frames: u64,
    /// Bodies that were at rest in the latest frame. Shape `[body]`.
    at_rest: Vec<bool>,
    /// Bodies that hung in the latest frame, ascending.
    hanging: Vec<BodyId>,
}

impl Hanging {
    /// A frame is due. A body hangs if it is at rest in this frame and in the one before, and no chain of contacts from
    /// below joins it to what stands or still moves. It counts from the second such frame on: in the first, what
    /// carried it may just have left. What is glued is held by its glue.
    pub fn look(&mut self, world: &World, carried: &mut Carried) {
        let is_at_rest = |id: BodyId| {
            let body = &world.bodies()[id];
            let may_fall = matches!(body.role, Role::Waiting | Role::Frozen | Role::Free);
            may_fall && world.cluster_of(id).is_none() && world.speed(id) < REST_SPEED
        };
        let at_rest: Vec<bool> = (0..world.bodies().len()).map(|id| world.is_present(id) && is_at_rest(id)).collect();
        let before = std::mem::replace(&mut self.at_rest, at_rest);
        let stays = |id: BodyId| self.at_rest[id] && before.get(id).is_some_and(|&rested| rested);
        carried.follow(world, stays);
        let hanging = carried.hanging(world, stays, |_| true);
        self.body_frames += hanging.iter().filter(|id| self.hanging.binary_search(id).is_ok()).count() as u64;
        self.hanging = hanging;
    }
}
