//! What carries the bodies that wait for their layer. A body that nothing carries any more is released at once: it
//! would be seen to wait in the air.

use cairn_engine::world::{BodyId, Role};
use cairn_motion::pile::Pile;

/// What moves faster carries nothing that waits, d per characteristic time: a fall over a hundredth of d is as fast.
const CARRYING_SPEED: f64 = 0.15;

/// The bodies that wait.
#[derive(Default)]
pub struct Carriers {
    /// [`cairn_motion::carried::Carried::looks`] of the latest decision.
    decided: Option<u64>,
}

impl Carriers {
    /// Bodies that wait and that no chain of contacts from below joins to what stands or to a slow body that was
    /// released, ascending. They are to be released.
    pub fn lost(&mut self, pile: &mut Pile) -> Vec<BodyId> {
        let Pile { world, carried, .. } = pile;
        let waits = |id: BodyId| world.bodies()[id].role == Role::Waiting;
        carried.follow(world, waits);
        if self.decided.replace(carried.looks) == Some(carried.looks) {
            return Vec::new();
        }
        carried.hanging(world, waits, |id| world.speed(id) < CARRYING_SPEED)
    }
}
