//! Role, damping and friction of each body, each from the reasons for it. Nothing else in the simulation writes one of
//! the three.

use crate::invariants;
use crate::world::{BodyId, Role, World};
use std::collections::BTreeMap;

/// The reasons for which bodies of a pile are damped.
///
/// Roles and friction take effect at once, since other decisions of the same step rest on them; damping takes effect in
/// [`Policy::apply`], once a step.
#[derive(Debug, Default)]
pub struct Policy {
    /// `release.damping`: of every released body, per characteristic time.
    base: f64,
    /// Late in the hold, of every released body, so that bodies that still roll or rattle come to rest; per
    /// characteristic time.
    quiet: Option<f64>,
    /// While the control ends gently, of every body; per characteristic time.
    gentle: Option<f64>,
    /// By the control's latest look at a body, per characteristic time.
    controlled: BTreeMap<BodyId, f64>,
    /// Bodies without friction, ascending.
    jammed: Vec<BodyId>,
    /// A reason has changed since [`Policy::apply`].
    is_stale: bool,
}

impl Policy {
    /// `base`: damping of every released body, per characteristic time.
    pub fn new(base: f64) -> Policy {
        Policy { base, is_stale: true, ..Policy::default() }
    }

    /// A body has come: it falls or flies freely until the control looks at it.
    pub fn join(&mut self, id: BodyId) {
        self.damp(id, self.base);
    }

    /// A body waits where it is until its layer is released.
    pub fn wait(world: &mut World, id: BodyId) {
        world.set_role(id, Role::Waiting);
    }

    /// A body stays where it was placed.
    pub fn pin(world: &mut World, id: BodyId) {
        world.set_role(id, Role::Pinned);
    }

    /// A body, with all that are glued to it, is glued to the ground or scenery.
    pub fn anchor(world: &mut World, id: BodyId) {
        world.set_role(id, Role::Anchored);
    }

    /// A waiting, pinned or anchored body is released.
    pub fn release(&mut self, world: &mut World, id: BodyId) {
        world.set_role(id, Role::Free);
        self.damp(id, self.base);
    }

    /// A support takes a body out of the solver.
    pub fn freeze(&mut self, world: &mut World, id: BodyId) {
        world.set_role(id, Role::Frozen);
    }

    /// A frozen body moves again.
    pub fn thaw(&mut self, world: &mut World, id: BodyId) {
        world.set_role(id, Role::Free);
        self.is_stale = true;
    }

    /// The control's look at a body: how it is damped until the next one, per characteristic time.
    pub fn damp(&mut self, id: BodyId, damping: f64) {
        self.controlled.insert(id, damping);
        self.is_stale = true;
    }

    /// These bodies, ascending, are jammed above a gap: without friction they slip down onto the bodies below. All
    /// others have their own friction.
    pub fn unjam(&mut self, world: &mut World, jammed: &[BodyId]) {
        for id in world.present().collect::<Vec<_>>() {
            world.set_slippery(id, jammed.binary_search(&id).is_ok());
        }
        self.jammed = jammed.to_vec();
    }

    /// From now on every released body is damped by this much, per characteristic time, except those that the control
    /// looks at, for which it goes on to choose; `None`: no longer.
    pub fn set_quiet(&mut self, quiet: Option<f64>) {
        self.quiet = quiet;
        self.controlled.clear();
        self.is_stale = true;
    }

    pub fn quiet(&self) -> Option<f64> {
        self.quiet
    }

    /// As [`Policy::set_quiet`], for the gentle end of the control, which chooses no more.
    pub fn set_gentle(&mut self, gentle: Option<f64>) {
        self.gentle = gentle;
        self.controlled.clear();
        self.is_stale = true;
    }

    /// Physics alone: no body is damped, waits, is frozen or may fall asleep.
    pub fn leave_to_physics(&mut self, world: &mut World) {
        *self = Policy { jammed: std::mem::take(&mut self.jammed), ..Policy::new(0.0) };
        for id in world.present().filter(|&id| !world.bodies()[id].role.stands()).collect::<Vec<_>>() {
            world.set_role(id, Role::Free);
            world.set_damping(id, 0.0);
            world.keep_awake(id);
        }
    }

    /// Damping of a free body, per characteristic time: that of every released body, or more where there is a reason.
    /// The control's look at a body precedes the quiet of all; its gentle end precedes that look.
    fn damping(&self, id: BodyId) -> f64 {
        match (self.gentle, self.controlled.get(&id)) {
            (Some(gentle), _) => gentle.max(self.base),
            (None, Some(&controlled)) => controlled.max(self.base),
            (None, None) => self.quiet.unwrap_or(0.0).max(self.base),
        }
    }

    /// Brings the damping of all free bodies up to date.
    pub fn apply(&mut self, world: &mut World) {
        if !std::mem::take(&mut self.is_stale) {
            return;
        }
        for id in world.present().collect::<Vec<_>>() {
            if world.bodies()[id].role == Role::Free {
                world.set_damping(id, self.damping(id));
            }
        }
        if invariants::are_checked() {
            self.validate(world);
        }
    }

    /// Panics where a body is treated otherwise than its reasons ask for.
    fn validate(&self, world: &World) {
        for id in world.present() {
            let role = world.bodies()[id].role;
            let damping = world.damping(id).filter(|_| role == Role::Free);
            assert!(
                damping.is_none_or(|damping| damping == self.damping(id) as f32),
                "body {id} is damped by {damping:?}"
            );
            let is_jammed = self.jammed.binary_search(&id).is_ok();
            assert_eq!(world.is_slippery(id), is_jammed, "body {id} has no friction only where it is jammed");
            assert!(role != Role::Frozen || self.gentle.is_none(), "body {id} is frozen, though the control has ended");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Policy;

    #[test]
    fn damping_follows_its_reasons() {
        let mut policy = Policy::new(0.5);
        let of = |policy: &Policy| [0, 1].map(|id| policy.damping(id));
        assert_eq!(of(&policy), [0.5, 0.5], "every released body");
        policy.damp(0, 6.0);
        assert_eq!(of(&policy), [6.0, 0.5], "the control's look at one");
        policy.damp(0, 0.0);
        assert_eq!(of(&policy), [0.5, 0.5], "no look goes below the base");
        policy.set_quiet(Some(2.0));
        assert_eq!(of(&policy), [2.0, 2.0]);
        policy.damp(1, 1.0);
        assert_eq!(of(&policy), [2.0, 1.0], "a look precedes the quiet of all");
        policy.join(2);
        assert_eq!(policy.damping(2), 0.5, "a new body flies freely");
        policy.set_gentle(Some(16.0));
        assert_eq!(of(&policy), [16.0, 16.0]);
        policy.set_gentle(None);
        policy.set_quiet(None);
        assert_eq!(of(&policy), [0.5, 0.5], "all reasons have ended");
    }
}
