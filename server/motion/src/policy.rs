//! Role, resistance and friction of each body, each from the reasons for it. Nothing else in the simulation writes one
//! of the three.

use cairn_engine::invariants;
use cairn_engine::world::{BodyId, Resistance, Role, World};
use std::collections::BTreeMap;

/// The reasons for which the contacts of bodies resist slow motion. Resistances are shares of the friction that the
/// contacts can bear ([`Resistance`]); of several reasons, the strongest counts. The control resists motion in the
/// world; the others, motion over what touches a body.
///
/// Roles and friction take effect at once, since other decisions of the same step rest on them; resistance takes effect
/// in [`Policy::apply`], once a step.
#[derive(Clone, Debug, Default)]
pub struct Policy {
    /// `release.resistance`: of every released body.
    base: f64,
    /// Late in the hold, of every released body, so that bodies that still roll or rattle come to rest.
    quiet: f64,
    /// By the control's latest look at a body.
    controlled: BTreeMap<BodyId, f64>,
    /// Bodies without friction, ascending.
    jammed: Vec<BodyId>,
    /// A reason has changed since [`Policy::apply`].
    is_stale: bool,
}

impl Policy {
    /// `base`: resistance of every released body.
    pub fn new(base: f64) -> Policy {
        Policy { base, is_stale: true, ..Policy::default() }
    }

    /// A body has come: it falls or flies freely until the control looks at it.
    pub fn join(&mut self, id: BodyId) {
        self.resist(id, 0.0);
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
        self.resist(id, 0.0);
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

    /// The control's look at a body: its resistance until the next one.
    pub fn resist(&mut self, id: BodyId, resistance: f64) {
        self.controlled.insert(id, resistance);
        self.is_stale = true;
    }

    /// These bodies, ascending, are jammed above a gap: without friction they slip down onto the bodies below. All
    /// others have their own friction.
    pub fn unjam(&mut self, world: &mut World, jammed: &[BodyId]) {
        for id in world.present().collect::<Vec<_>>() {
            world.set_slippery(id, jammed.binary_search(&id).is_ok());
        }
        self.is_stale |= self.jammed != jammed;
        self.jammed = jammed.to_vec();
    }

    /// From now on every released body has at least this resistance.
    pub fn set_quiet(&mut self, quiet: f64) {
        self.is_stale |= self.quiet != quiet;
        self.quiet = quiet;
    }

    /// The control has ended: it looks at no body.
    pub fn forget_looks(&mut self) {
        self.controlled.clear();
        self.is_stale = true;
    }

    /// Physics alone: no contact resists, no body waits, is frozen or may fall asleep.
    pub fn leave_to_physics(&mut self, world: &mut World) {
        *self = Policy { jammed: std::mem::take(&mut self.jammed), ..Policy::new(0.0) };
        for id in world.present().filter(|&id| !world.bodies()[id].role.stands()).collect::<Vec<_>>() {
            world.set_role(id, Role::Free);
            world.set_resistance(id, Resistance::default());
            world.keep_awake(id);
        }
    }

    /// Resistance of a free body. A jammed one is to slip.
    fn resistance(&self, id: BodyId) -> Resistance {
        if self.jammed.binary_search(&id).is_ok() {
            return Resistance::default();
        }
        let (always, controlled) = (self.base.max(self.quiet), self.controlled.get(&id).copied().unwrap_or(0.0));
        Resistance { share: always.max(controlled), in_world: controlled > always }
    }

    /// Brings the resistance of all free bodies up to date.
    pub fn apply(&mut self, world: &mut World) {
        if !std::mem::take(&mut self.is_stale) {
            return;
        }
        for id in world.present().collect::<Vec<_>>() {
            if world.bodies()[id].role == Role::Free {
                world.set_resistance(id, self.resistance(id));
            }
        }
        if invariants::are_checked() {
            self.validate(world);
        }
    }

    /// Panics where a body is treated otherwise than its reasons ask for.
    fn validate(&self, world: &World) {
        for id in world.present() {
            let (role, resistance) = (world.bodies()[id].role, world.bodies()[id].resistance);
            assert!(
                role != Role::Free || resistance == self.resistance(id),
                "the contacts of body {id} resist by {resistance:?}"
            );
            let is_jammed = self.jammed.binary_search(&id).is_ok();
            assert_eq!(world.is_slippery(id), is_jammed, "body {id} has no friction only where it is jammed");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Policy;

    #[test]
    fn the_strongest_reason_counts() {
        let mut policy = Policy::new(0.1);
        let of = |policy: &Policy| [0, 1].map(|id| policy.resistance(id).share);
        assert_eq!(of(&policy), [0.1, 0.1], "every released body");
        policy.resist(0, 0.5);
        assert_eq!(of(&policy), [0.5, 0.1], "the control's look at one");
        assert_eq!([0, 1].map(|id| policy.resistance(id).in_world), [true, false], "only the control's");
        policy.set_quiet(0.2);
        assert_eq!(of(&policy), [0.5, 0.2]);
        policy.forget_looks();
        policy.set_quiet(0.0);
        assert_eq!(of(&policy), [0.1, 0.1], "all reasons have ended");
    }
}
