//! Rest by regions. The engine lets an island of bodies sleep as a whole, and a pile is one island: a single body that rocks keeps
//! thousands awake. Here each body rests that has been slow for as long as the engine asks for, if all that it touches has, too: what
//! moves keeps a layer around it awake, and the rest of the pile costs nothing.

use super::clusters::kind;
use super::creep::WINDOW;
use super::{BodyId, Role, World};
use rapier3d::prelude::*;

/// What rests is woken by a body that touches it and is faster than this, d per natural time: the speed above which nothing sleeps.
const WAKING_SPEED: f64 = super::bodies::SLEEP_SPEED;

/// Which bodies rest.
#[derive(Default)]
pub struct Resting {
    /// Engine time since the last look.
    time: f64,
    /// Shape `[body]`; may be shorter. Of what moves as one, its first body tells.
    rests: Vec<bool>,
    count: usize,
}

impl Resting {
    fn has(&self, leader: BodyId) -> bool {
        self.rests.get(leader).is_some_and(|&rests| rests)
    }

    /// Returns whether that is news.
    fn set(&mut self, leader: BodyId, rests: bool) -> bool {
        if self.has(leader) == rests {
            return false;
        }
        if self.rests.len() <= leader {
            self.rests.resize(leader + 1, false);
        }
        self.rests[leader] = rests;
        self.count = if rests { self.count + 1 } else { self.count - 1 };
        true
    }
}

impl World {
    /// Before a step of a pile to which nothing happens any more: what rests amid what rests is not simulated.
    pub fn rest_by_regions(&mut self) {
        self.wake_what_is_touched();
        self.resting.time += self.step_length();
        if self.resting.time >= WINDOW {
            self.resting.time = 0.0;
            self.look_at_regions();
        }
        self.counters.resting_body_steps += self.resting.count as u64;
    }

    /// Everything is simulated again.
    pub fn end_rest(&mut self) {
        for id in 0..self.resting.rests.len() {
            self.rest(id, false);
        }
        self.resting.time = 0.0;
    }

    /// Whoever changes what moves a body has its say.
    pub(super) fn forget_rest(&mut self, leader: BodyId) {
        self.resting.set(leader, false);
    }

    fn leader(&self, id: BodyId) -> BodyId {
        self.glued_with(id)[0]
    }

    fn wake_what_is_touched(&mut self) {
        if self.resting.count == 0 {
            return;
        }
        let moves = |id: &BodyId| self.is_awake(*id) && self.speed(*id) > WAKING_SPEED;
        let touched: Vec<BodyId> = self.present().filter(moves).flat_map(|id| self.touched_by(id)).collect();
        touched.into_iter().for_each(|id| self.rest(self.leader(id), false));
    }

    /// Bodies with which the engine has a contact.
    fn touched_by(&self, id: BodyId) -> impl Iterator<Item = BodyId> + '_ {
        let me = self.bodies[id].collider;
        let pairs = self.engine.narrow_phase.contact_pairs_with(me).filter(|pair| pair.has_any_active_contact());
        pairs.filter_map(move |pair| self.body_of(if pair.collider1 == me { pair.collider2 } else { pair.collider1 }))
    }

    fn look_at_regions(&mut self) {
        // Of what moves as one, shape `[body]`: whether it may sleep; whether all that it touches may, too.
        let may: Vec<bool> = (0..self.bodies.len()).map(|id| self.may_rest(id)).collect();
        let mut settled = may.clone();
        for pair in self.engine.narrow_phase.contact_pairs().filter(|pair| pair.has_any_active_contact()) {
            let (Some(a), Some(b)) = (self.body_of(pair.collider1), self.body_of(pair.collider2)) else { continue };
            let (a, b) = (self.leader(a), self.leader(b));
            settled[a] &= may[b];
            settled[b] &= may[a];
        }
        for (id, settled) in settled.into_iter().enumerate() {
            if self.bodies[id].role == Role::Free && self.leads(id) {
                self.rest(id, settled);
            }
        }
    }

    fn may_rest(&self, id: BodyId) -> bool {
        self.bodies[id].role != Role::Free
            || self.resting.has(id)
            || self.rigid(id).activation().is_eligible_for_sleep()
    }

    fn rest(&mut self, leader: BodyId, rests: bool) {
        if !self.is_present(leader) || !self.resting.set(leader, rests) {
            return;
        }
        let body = &mut self.engine.bodies[self.bodies[leader].handle];
        if rests {
            body.set_linvel(Vector::ZERO, false);
            body.set_angvel(Vector::ZERO, false);
            body.set_body_type(RigidBodyType::Fixed, true);
        } else {
            body.set_body_type(kind(self.bodies[leader].role), true);
            body.activation_mut().time_since_can_sleep = 0.0;
        }
    }
}
