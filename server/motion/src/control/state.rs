//! The state of each body under the control, for observers. Nothing depends on it.

use super::PileControl;
use cairn_engine::world::{Role, World, WorldBody};
use cairn_input::observer::State;

impl PileControl<'_> {
    /// Shape `[body]`.
    pub fn states(&self, world: &World) -> Vec<State> {
        let held =
            self.support.as_ref().map_or_else(|| vec![false; world.bodies().len()], |support| support.held(world));
        let candidates = self.candidates();
        let state = |(id, body): (usize, &WorldBody)| match body.role {
            Role::Anchored => State::Anchored,
            Role::Waiting | Role::Free if world.cluster_of(id).is_some() => State::Glued,
            // There is no verdict.
            _ if self.support.is_none() => State::Free,
            Role::Waiting => State::Waiting,
            Role::Pinned => State::Pinned,
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
