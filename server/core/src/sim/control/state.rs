//! What the control makes of each body, for those who watch. Nothing depends on it.

use super::Control;
use crate::input::observer::State;
use crate::world::{Role, World, WorldBody};

impl Control<'_> {
    /// Shape `[body]`; all free where there is no control.
    pub fn states(&self, world: &World) -> Vec<State> {
        let Some(support) = &self.support else { return vec![State::Free; world.bodies().len()] };
        let held = support.held(world);
        let candidates = self.candidates();
        let state = |(id, body): (usize, &WorldBody)| match body.role {
            Role::Waiting => State::Waiting,
            Role::Pinned => State::Pinned,
            Role::Anchored => State::Anchored,
            Role::Frozen => State::Held,
            Role::Gone => State::Free,
            Role::Free if self.ended => State::Free,
            Role::Free if held[id] => State::Held,
            Role::Free if candidates.get(id).is_some_and(|&candidates| candidates) => State::Candidate,
            Role::Free if !self.eligibility.is_inside(world, id) => State::Outside,
            Role::Free => State::Unstable,
        };
        world.bodies().iter().enumerate().map(state).collect()
    }
}
