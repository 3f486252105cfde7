//! What the control makes of each body, for those who watch. Nothing depends on it.

use super::Control;
use crate::input::observer::State;
use crate::input::params::ControlMode;
use crate::world::{Role, World};

impl Control<'_> {
    /// Shape `[body]`; all free where there is no control.
    pub fn states(&self, world: &World) -> Vec<State> {
        if self.params.mode == ControlMode::Off {
            return vec![State::Free; world.bodies().len()];
        }
        let nailed = world.nailed();
        let state = |(id, body): (usize, &crate::world::WorldBody)| match body.role {
            Role::Waiting => State::Waiting,
            Role::Kept => State::Kept,
            Role::Held => State::Held,
            Role::Gone => State::Free,
            Role::Free if self.ended => State::Free,
            Role::Free if nailed[id] => State::Held,
            Role::Free if self.certified.get(id).is_some_and(|&certified| certified) => State::Candidate,
            Role::Free if !self.is_inside(world, id) => State::Outside,
            Role::Free => State::Unstable,
        };
        world.bodies().iter().enumerate().map(state).collect()
    }
}
