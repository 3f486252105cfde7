//! A body that hits a held pile must be able to break it: a frozen body does not move, and would stop the other like a
//! wall.
//!
//! Before each step, the frozen bodies that are about to be hit are freed, and with them as many of those in contact
//! with them as the blow can set in motion. Momentum decides that: it is handed on from body to body until it is spread
//! over so much mass that the bodies are slow. The freed bodies stay free while the shock passes; then they are judged
//! as all others are.

use super::eligibility::neighbors;
use crate::policy::Policy;
use cairn_engine::world::{BodyId, ComingHit, ContactPair, Role, World};
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// A blow that leaves a body slower than this, in d per characteristic time, does not free it: a fall over an eighth of
/// d is as fast.
const LEAST_BLOW: f64 = 0.5;
/// Least time for which a freed body stays free, characteristic times: a fall over half of d.
const SHOCK_TIME: f64 = 1.0;

/// The bodies freed before hits.
pub struct Impact {
    /// Cycles for which a freed body stays free.
    shock_cycles: u64,
    /// Freed bodies, and the first cycle that may hold them again.
    pub shaken: BTreeMap<BodyId, u64>,
    /// Steps in which coming hits were looked for.
    pub looks: u64,
    /// Bodies freed.
    pub count: u64,
}

impl Impact {
    /// `cycle_time`: from one control cycle to the next, characteristic times.
    pub fn new(cycle_time: f64) -> Impact {
        let shock_cycles = (SHOCK_TIME / cycle_time).ceil() as u64;
        Impact { shock_cycles, shaken: BTreeMap::new(), looks: 0, count: 0 }
    }

    pub fn is_shaken(&self, id: BodyId, cycle: u64) -> bool {
        self.shaken.get(&id).is_some_and(|&until| cycle < until)
    }

    /// Frees the bodies that are about to be hit, and returns them. `pairs`: of the latest cycle, which has this
    /// number.
    pub fn free_before_hits(
        &mut self,
        world: &mut World,
        policy: &mut Policy,
        pairs: &[ContactPair],
        cycle: u64,
    ) -> Vec<BodyId> {
        self.looks += 1;
        let mass = |id: BodyId| world.bodies()[id].mass;
        let is_blow =
            |hit: &ComingHit| mass(hit.hitter) * hit.speed > LEAST_BLOW * (mass(hit.hitter) + mass(hit.frozen));
        let blows: Vec<ComingHit> = world.hits_ahead(LEAST_BLOW).into_iter().filter(is_blow).collect();
        let mut freed = Vec::new();
        if !blows.is_empty() {
            let neighbors = neighbors(world, pairs);
            for hit in blows {
                let momentum = world.bodies()[hit.hitter].mass * hit.speed;
                for id in moved_by(world, hit.frozen, momentum / LEAST_BLOW, &neighbors) {
                    self.free(world, policy, id, cycle);
                    freed.push(id);
                }
            }
        }
        if world.scenery_moves() {
            for id in world.frozen_near_moving() {
                self.free(world, policy, id, cycle);
                freed.push(id);
            }
        }
        freed
    }

    fn free(&mut self, world: &mut World, policy: &mut Policy, id: BodyId, cycle: u64) {
        self.shaken.insert(id, cycle + self.shock_cycles);
        policy.thaw(world, id);
        policy.resist(id, 0.0);
        self.count += 1;
    }
}

/// The frozen ones of the bodies nearest to `first` by contacts, up to this mass.
fn moved_by(world: &World, first: BodyId, mass: f64, neighbors: &[Vec<BodyId>]) -> Vec<BodyId> {
    let mut seen = BTreeSet::from([first]);
    let mut front = VecDeque::from([first]);
    let mut left = mass;
    let mut frozen = Vec::new();
    while let Some(id) = front.pop_front() {
        if left <= 0.0 {
            break;
        }
        left -= world.bodies()[id].mass;
        if world.bodies()[id].role == Role::Frozen {
            frozen.push(id);
        }
        let movable = |id: &BodyId| matches!(world.bodies()[*id].role, Role::Frozen | Role::Free);
        // Bodies that came after the latest cycle have no contacts yet.
        let next = neighbors.get(id).into_iter().flatten().copied().filter(movable);
        front.extend(next.filter(|&id| seen.insert(id)));
    }
    frozen
}
