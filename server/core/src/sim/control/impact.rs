//! What hits a held pile must be able to break it: a held body does not move, and would stop the other like a wall.
//!
//! Before each step, the held bodies that are about to be hit are let go, and with them as many of those in contact with
//! them as the blow can set in motion. That is decided by momentum: it is handed on from body to body until it is spread
//! over so much mass that what is left is slow. Those bodies stay free while the shock passes; then they are judged as
//! all others are.

use super::Control;
use crate::input::params::ControlMode;
use crate::world::{BodyId, Hit, Role, Side, Touch, World};
use std::collections::{BTreeSet, VecDeque};

/// A blow that leaves a body slower than this, in d per natural time, does not let it go: a fall over an eighth of d is
/// as fast.
const LEAST_BLOW: f64 = 0.5;
/// Bodies placed by hand overlap if by more than this share of the thinner one's thickness: as much as a contact may gape.
const MOST_OVERLAP: f64 = 0.05;
/// What is deeper in another body, or in the ground, is not held there, however it came there: a hard fall, or a squeeze. The
/// fill leaves less than this.
const DEEP: f64 = 0.35;
/// How long a body that was let go stays free at least, natural times: a fall over half of d.
const SHOCK_TIME: f64 = 1.0;

impl Control<'_> {
    /// Lets go what is about to be hit.
    pub fn before_step(&mut self, world: &mut World) {
        let looks = self.params.switches.impact.is_on(self.watches_hits);
        if !(looks && self.is_on() && self.params.mode == ControlMode::Hold) {
            return;
        }
        self.tally.impact_looks += 1;
        let mass = |id: BodyId| world.bodies()[id].mass;
        let is_blow = |hit: &Hit| mass(hit.hitter) * hit.speed > LEAST_BLOW * (mass(hit.hitter) + mass(hit.held));
        let blows: Vec<Hit> = world.hits_ahead(LEAST_BLOW).into_iter().filter(is_blow).collect();
        if !blows.is_empty() {
            let joined = joined(world, &self.touches);
            for hit in blows {
                let momentum = world.bodies()[hit.hitter].mass * hit.speed;
                self.shake(world, hit.held, momentum / LEAST_BLOW, &joined);
            }
        }
        if world.scenery_moves() {
            for id in world.held_near_moving() {
                self.let_go(world, id);
            }
        }
    }

    /// Lets go the bodies nearest to `first` by contacts, up to this mass.
    fn shake(&mut self, world: &mut World, first: BodyId, mass: f64, joined: &[Vec<BodyId>]) {
        let mut seen = BTreeSet::from([first]);
        let mut front = VecDeque::from([first]);
        let mut left = mass;
        while let Some(id) = front.pop_front() {
            if left <= 0.0 {
                break;
            }
            left -= world.bodies()[id].mass;
            if world.bodies()[id].role == Role::Held {
                self.let_go(world, id);
            }
            let movable = |id: &BodyId| matches!(world.bodies()[*id].role, Role::Held | Role::Free);
            // Bodies that came after the latest cycle have no contacts yet.
            let next = joined.get(id).into_iter().flatten().copied().filter(movable);
            front.extend(next.filter(|&id| seen.insert(id)));
        }
    }

    fn let_go(&mut self, world: &mut World, id: BodyId) {
        let cycle = SHOCK_TIME / (f64::from(self.params.period) * world.step_length());
        self.shaken.insert(id, self.tally.cycles + cycle.ceil() as u64);
        world.set_role(id, Role::Free);
        world.set_damping(id, 0.0);
        self.stir(id);
        self.tally.shaken += 1;
    }

    pub(super) fn is_shaken(&self, id: BodyId) -> bool {
        self.shaken.get(&id).is_some_and(|&until| self.tally.cycles < until)
    }

    /// Dropped bodies that touch nothing.
    pub(super) fn flying(&self, touches: &[Touch]) -> BTreeSet<BodyId> {
        let mut flying = self.dropped.clone();
        for t in touches {
            flying.remove(&t.a);
            if let Side::Body(b) = t.b {
                flying.remove(&b);
            }
        }
        flying
    }

    /// Bodies that may not be held now, whatever their contacts say. Shape `[body]`; empty where there are none.
    pub(super) fn barred(&mut self, world: &World, touches: &[Touch]) -> Vec<bool> {
        let mut barred = self.carried(world, touches);
        let sunk = overlapping(world, touches, DEEP);
        if self.placed.is_empty() && sunk.is_empty() {
            return barred;
        }
        barred.resize(world.bodies().len(), false);
        sunk.into_iter().for_each(|id| barred[id] = true);
        if !self.placed.is_empty() {
            // Those of the overlapping ones that still do; once apart, a body is like all others.
            let deep = overlapping(world, touches, MOST_OVERLAP);
            self.placed.retain(|id| deep.contains(id) || world.bodies()[*id].role == Role::Waiting);
            self.placed.iter().for_each(|&id| barred[id] = true);
        }
        barred
    }

    /// Bodies that moving scenery carries or pushes, directly or through others: they move with it. Shape `[body]`; empty
    /// where none moves.
    fn carried(&self, world: &World, touches: &[Touch]) -> Vec<bool> {
        if !world.scenery_moves() {
            return Vec::new();
        }
        let mut carried = vec![false; world.bodies().len()];
        let joined = joined(world, touches);
        let mut front: Vec<BodyId> = touches.iter().filter(|t| t.b == Side::Moving).map(|t| t.a).collect();
        while let Some(id) = front.pop() {
            if !std::mem::replace(&mut carried[id], true) {
                front.extend(&joined[id]);
            }
        }
        carried
    }
}

/// Bodies deeper in something else than this share of the thinner one's thickness.
fn overlapping(world: &World, touches: &[Touch], share: f64) -> BTreeSet<BodyId> {
    let deep = touches.iter().filter(|t| t.depth() > share * world.pair_thickness(t));
    deep.flat_map(|t| [Some(t.a), if let Side::Body(b) = t.b { Some(b) } else { None }]).flatten().collect()
}

/// The bodies that each body touches. Shape `[body]`, each in order of the touches.
fn joined(world: &World, touches: &[Touch]) -> Vec<Vec<BodyId>> {
    let mut joined = vec![Vec::new(); world.bodies().len()];
    for t in touches {
        if let Side::Body(b) = t.b {
            joined[t.a].push(b);
            joined[b].push(t.a);
        }
    }
    joined
}
