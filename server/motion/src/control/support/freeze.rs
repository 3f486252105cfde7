//! Freezing: a held body takes no part in the solver until its next verdict. It does not move, and carries like
//! scenery.

use super::{Lifetime, Support, Verdicts, supportable};
use crate::control::counters::ControlCounters;
use crate::policy::Policy;
use cairn_engine::world::{BodyId, Role, World};
use cairn_input::params::{Control as ControlParams, Neighbours};
use std::collections::BTreeMap;

pub struct FreezeSupport {
    neighbours: Neighbours,
    /// Bodies that broke loose. Ordered, so that nothing depends on the order of a hash map.
    broken: BTreeMap<BodyId, BreakRecord>,
    /// Cycles so far.
    cycle: u64,
}

/// A body that broke loose under its load is squeezed between its neighbours: frozen again at once, it would only break
/// loose again, and rattle forever. It stays free for a while, each time twice as long, so that the squeeze can ease,
/// and after the last attempt for good.
#[derive(Clone, Copy, Debug)]
struct BreakRecord {
    breaks: u32,
    /// The first cycle that may freeze it again.
    free_until: u64,
}

impl BreakRecord {
    const ATTEMPTS: u32 = 4;

    fn again(before: Option<&BreakRecord>, cycle: u64) -> BreakRecord {
        let breaks = before.map_or(1, |s| s.breaks + 1);
        let free_until = if breaks < BreakRecord::ATTEMPTS { cycle + (1 << breaks) } else { u64::MAX };
        BreakRecord { breaks, free_until }
    }
}

impl FreezeSupport {
    pub fn new(params: &ControlParams) -> FreezeSupport {
        FreezeSupport { neighbours: params.neighbours, broken: BTreeMap::new(), cycle: 0 }
    }

    /// Bodies to freeze. Shape `[body]`.
    fn choose(&self, verdicts: &Verdicts) -> Vec<bool> {
        let is_free = |until: Option<u64>| until.is_some_and(|until| verdicts.cycle < until);
        let mut chosen = supportable(self.neighbours, verdicts);
        for (id, chosen) in chosen.iter_mut().enumerate() {
            let broken = is_free(self.broken.get(&id).map(|record| record.free_until));
            *chosen &= !broken && !is_free(verdicts.shaken.get(&id).copied());
        }
        chosen
    }
}

impl Support for FreezeSupport {
    fn lifetime(&self) -> Lifetime {
        Lifetime::Verdict
    }

    fn lift(&mut self, world: &mut World, policy: &mut Policy) {
        for id in world.present().collect::<Vec<_>>() {
            if world.bodies()[id].role == Role::Frozen {
                policy.thaw(world, id);
            }
        }
    }

    fn place(&mut self, verdicts: &Verdicts, world: &mut World, policy: &mut Policy, counters: &mut ControlCounters) {
        self.cycle = verdicts.cycle;
        for (id, freeze) in self.choose(verdicts).into_iter().enumerate() {
            match world.bodies()[id].role {
                Role::Free if freeze => policy.freeze(world, id),
                Role::Frozen if !freeze => policy.thaw(world, id),
                _ => {}
            }
        }
        counters.held_peak = counters.held_peak.max(world.count(Role::Frozen) as u64);
    }

    fn break_overloaded(
        &mut self,
        limit: f64,
        world: &mut World,
        policy: &mut Policy,
        counters: &mut ControlCounters,
    ) -> Vec<BodyId> {
        let broken = world.overloaded(limit);
        for &id in &broken {
            policy.thaw(world, id);
            let record = BreakRecord::again(self.broken.get(&id), self.cycle);
            self.broken.insert(id, record);
        }
        counters.holds_broken += broken.len() as u64;
        broken
    }

    fn held(&self, world: &World) -> Vec<bool> {
        world.bodies().iter().map(|body| body.role == Role::Frozen).collect()
    }
}
