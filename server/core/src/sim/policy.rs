//! How each body is treated: its role, its damping and its friction, each from the reasons that there are. Nothing else in the
//! simulation writes one of the three.

use crate::world::{BodyId, Role, World};
use std::collections::BTreeMap;

/// The reasons for which bodies of a pile are damped.
///
/// Roles and friction take effect at once, since other decisions of the same step rest on them; damping takes effect in
/// [`Policy::apply`], once a step.
#[derive(Debug, Default)]
pub struct Policy {
    /// `release.damping`: of every released body, per natural time.
    base: f64,
    /// Late in the hold: what still rolls or rattles comes to rest, anywhere; per natural time.
    quiet: Option<f64>,
    /// While the control ends gently: everything, per natural time.
    gentle: Option<f64>,
    /// What the control's latest look at a body asks for, per natural time.
    controlled: BTreeMap<BodyId, f64>,
    /// A reason has changed since [`Policy::apply`].
    is_stale: bool,
}

impl Policy {
    /// `base`: damping of every released body, per natural time.
    pub fn new(base: f64) -> Policy {
        Policy { base, is_stale: true, ..Policy::default() }
    }

    /// A body has come: it falls or flies as it will until the control looks at it.
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

    /// A body, with all that are glued to it, is glued to what stands still.
    pub fn anchor(world: &mut World, id: BodyId) {
        world.set_role(id, Role::Anchored);
    }

    /// A waiting, pinned or anchored body is let go.
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

    /// The control's look at a body: how it is damped until the next one, per natural time.
    pub fn damp(&mut self, id: BodyId, damping: f64) {
        self.controlled.insert(id, damping);
        self.is_stale = true;
    }

    /// These bodies, rising, are jammed above a gap: without friction they slip down onto what is below. All others have their own
    /// friction.
    pub fn unjam(&mut self, world: &mut World, jammed: &[BodyId]) {
        for id in world.present().collect::<Vec<_>>() {
            world.set_slippery(id, jammed.binary_search(&id).is_ok());
        }
    }

    /// From now on every released body is damped by this much, per natural time, and the control goes on to choose for those that
    /// it looks at; `None`: no longer.
    pub fn set_quiet(&mut self, quiet: Option<f64>) {
        self.quiet = quiet;
        self.controlled.clear();
        self.is_stale = true;
    }

    pub fn quiet(&self) -> Option<f64> {
        self.quiet
    }

    /// As [`Policy::set_quiet`], for the gentle end of the control, which has no say any more.
    pub fn set_gentle(&mut self, gentle: Option<f64>) {
        self.gentle = gentle;
        self.controlled.clear();
        self.is_stale = true;
    }

    /// Nothing is damped, waits or is frozen, and nothing may fall asleep: physics alone.
    pub fn leave_to_physics(&mut self, world: &mut World) {
        *self = Policy::new(0.0);
        for id in world.present().filter(|&id| !world.bodies()[id].role.stands()).collect::<Vec<_>>() {
            world.set_role(id, Role::Free);
            world.set_damping(id, 0.0);
            world.keep_awake(id);
        }
    }

    /// Damping of a free body, per natural time: what every released body has, or more where there is a reason. The control's look
    /// at a body counts for more than the quiet of all; its gentle end counts for more than that look.
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
        assert_eq!(of(&policy), [0.5, 0.5], "no look takes away what all have");
        policy.set_quiet(Some(2.0));
        assert_eq!(of(&policy), [2.0, 2.0]);
        policy.damp(1, 1.0);
        assert_eq!(of(&policy), [2.0, 1.0], "a look counts for more than the quiet of all");
        policy.join(2);
        assert_eq!(policy.damping(2), 0.5, "who comes in flies as it will");
        policy.set_gentle(Some(16.0));
        assert_eq!(of(&policy), [16.0, 16.0]);
        policy.set_gentle(None);
        policy.set_quiet(None);
        assert_eq!(of(&policy), [0.5, 0.5], "all reasons have ended");
    }
}
