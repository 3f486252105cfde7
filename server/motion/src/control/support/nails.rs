//! Nails: breakable constraints between candidates in contact (paper, 3.3).

use super::{Lifetime, Support, Verdicts, supportable};
use crate::control::counters::ControlCounters;
use crate::policy::Policy;
use cairn_engine::world::{BodyId, ContactPoint, PairSide, World};
use cairn_input::params::{Control as ControlParams, Neighbours};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

pub struct NailSupport {
    neighbours: Neighbours,
    most_per_body: u32,
    rng: Pcg64Mcg,
}

/// A nail to be driven: between two bodies, or a body and the ground or scenery.
struct PlannedNail {
    a: BodyId,
    b: Option<BodyId>,
    at: ContactPoint,
}

impl NailSupport {
    pub fn new(params: &ControlParams, seed: u64) -> NailSupport {
        NailSupport {
            neighbours: params.neighbours,
            most_per_body: params.nails_per_body,
            rng: Pcg64Mcg::seed_from_u64(seed),
        }
    }

    /// One nail for each pair of candidates, at one of its contacts.
    fn choose(&mut self, verdicts: &Verdicts) -> Vec<PlannedNail> {
        let closed = supportable(self.neighbours, verdicts);
        let candidates = verdicts.candidates;
        let mut driven = vec![0u32; candidates.len()];
        let mut chosen = Vec::new();
        for t in verdicts.pairs {
            let (nailed, b) = match t.b {
                PairSide::Body(b) => (candidates[t.a] && candidates[b] && (closed[t.a] || closed[b]), Some(b)),
                PairSide::Ground | PairSide::Scenery => (closed[t.a], None),
                PairSide::Moving => continue,
            };
            let has_room = |id: BodyId| driven[id] < self.most_per_body;
            if nailed && has_room(t.a) && b.is_none_or(has_room) {
                [Some(t.a), b].into_iter().flatten().for_each(|id| driven[id] += 1);
                chosen.push(PlannedNail { a: t.a, b, at: t.points[self.rng.random_range(0..t.points.len())] });
            }
        }
        chosen
    }
}

impl Support for NailSupport {
    fn lifetime(&self) -> Lifetime {
        Lifetime::Cycle
    }

    fn lift(&mut self, world: &mut World, _: &mut Policy) {
        world.pull_all_nails();
    }

    fn place(&mut self, verdicts: &Verdicts, world: &mut World, _: &mut Policy, counters: &mut ControlCounters) {
        for nail in self.choose(verdicts) {
            world.drive_nail(nail.a, nail.b, nail.at.point, nail.at.normal);
            counters.nails_driven += 1;
        }
        counters.nails_peak = counters.nails_peak.max(world.nail_count() as u64);
    }

    fn break_overloaded(
        &mut self,
        limit: f64,
        world: &mut World,
        _: &mut Policy,
        counters: &mut ControlCounters,
    ) -> Vec<BodyId> {
        let (broken, load) = world.break_nails(limit);
        counters.nails_broken += broken as u64;
        counters.nail_load_max = counters.nail_load_max.max(load);
        // Nailed bodies were never taken out of the solver.
        Vec::new()
    }

    fn held(&self, world: &World) -> Vec<bool> {
        world.nailed()
    }
}
