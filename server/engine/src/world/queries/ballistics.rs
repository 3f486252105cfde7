//! Whether bodies that touch nothing fall as gravity makes them fall.

use crate::world::{BodyId, PairSide, World};
use cairn_geometry::contact::REAL_CONTACT;
use glam::DVec3;
use rapier3d::prelude::ContactPair;

/// A deviation below this share of gravity is the engine's rounding.
const ROUNDING: f64 = 1e-3;

impl World {
    /// Velocity of the rigid body that each free body leads; `None`: it is not free, does not lead, or a nail holds it.
    /// Shape `[body]`.
    pub fn free_velocities(&self) -> Vec<Option<DVec3>> {
        let nailed = self.nailed();
        let is_nailed = |id: BodyId| self.bodies.glued_with(id).iter().any(|&member| nailed[member]);
        let mut velocities = vec![None; self.bodies().len()];
        for (id, body) in self.bodies.free().filter(|&(id, _)| self.bodies.leads(id) && !is_nailed(id)) {
            velocities[id] = Some(self.engine.bodies[body.carrier].linvel().as_dvec3());
        }
        velocities
    }

    /// After a step: the largest deviation of the acceleration of a body that touched nothing from that of gravity, as
    /// a share of it. `before`: [`World::free_velocities`] before the step.
    pub fn ballistic_error(&self, before: &[Option<DVec3>]) -> f64 {
        let gravity = self.engine.gravity.as_dvec3();
        let error = |(id, now): (BodyId, Option<DVec3>)| {
            let gained = (now? - before.get(id).copied().flatten()?) / self.step_length();
            let error = (gained - gravity).length() / gravity.length();
            let touches_nothing = || self.pressed_by(id).next().is_none() && !self.touches(id);
            (error > ROUNDING && touches_nothing()).then_some(error)
        };
        self.free_velocities().into_iter().enumerate().filter_map(error).fold(0.0, f64::max)
    }

    /// Whether a body, or one that is glued to it, has a contact now, up to the widest gap that counts as one.
    fn touches(&self, id: BodyId) -> bool {
        let members = self.bodies.glued_with(id);
        let is_other = |side: PairSide| !matches!(side, PairSide::Body(b) if members.contains(&b));
        let has_contact = |&member: &BodyId| {
            let mut near = self.near(member, REAL_CONTACT).into_iter().filter(|&(side, _)| is_other(side));
            near.any(|(side, other)| self.pair(member, side, other, REAL_CONTACT).is_some())
        };
        members.iter().any(has_contact)
    }

    /// What pressed on a body, or on one that is glued to it, in the latest step.
    pub fn pressed_by(&self, id: BodyId) -> impl Iterator<Item = PairSide> + '_ {
        self.met_by(id, |pair| pair.total_impulse_magnitude() > 0.0)
    }

    /// What a body, or one that is glued to it, touched in the latest step, whether it pressed or not.
    pub fn touched_by(&self, id: BodyId) -> impl Iterator<Item = PairSide> + '_ {
        self.met_by(id, |pair| pair.has_any_active_contact())
    }

    fn met_by(&self, id: BodyId, counts: impl Fn(&ContactPair) -> bool + Copy) -> impl Iterator<Item = PairSide> {
        self.bodies.glued_with(id).iter().flat_map(move |&member| {
            let collider = self.bodies[member].collider;
            let pairs = self.engine.narrow_phase.contact_pairs_with(collider);
            pairs.filter(move |&pair| counts(pair)).filter_map(move |pair| {
                let other = if pair.collider1 == collider { pair.collider2 } else { pair.collider1 };
                self.side_of(self.engine.colliders.get(other)?)
            })
        })
    }
}
