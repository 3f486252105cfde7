//! The control (paper, 3): each cycle analyses the local equilibrium of the bodies, finds candidates among them, and
//! supports those until the next verdict.
//!
//! `analysis` judges bodies, `eligibility` chooses the bodies to judge, `support` holds, `impact` frees bodies that are
//! about to be hit.

mod analysis;
mod counters;
mod eligibility;
mod impact;
mod state;
pub mod support;

pub use counters::{BodyProblem, ControlCounters};
pub use eligibility::is_inside;

use super::policy::Policy;
use analysis::Analysis;
use cairn_engine::world::{BodyId, Role, World};
use cairn_geometry::interior::DistanceGrid;
use cairn_input::params::Control as ControlParams;
use cairn_prepare::effects::{EffectName, Resolved};
use eligibility::Eligibility;
use impact::Impact;
use support::{Lifetime, Support, Verdicts};

/// Bodies that have rested untouched for this long are held, characteristic times. The contacts of a pile move a little
/// all the time, and with them the verdicts: a body at the limit of its friction would be freed again long after the
/// collapse. Shorter than what counts as standing (`sim::motion`).
const HELD_AFTER: f64 = 1.5;

/// The control and its memory.
pub struct PileControl<'a> {
    params: &'a ControlParams,
    /// Bodies are freed before they are hit.
    frees_before_hits: bool,
    /// Supports that carry too much break.
    breaks: bool,
    /// Force per mass at which a support breaks, in weights.
    break_limit: f64,
    analysis: Analysis<'a>,
    eligibility: Eligibility<'a>,
    impact: Impact,
    /// `None`: the control is off.
    support: Option<Box<dyn Support>>,
    counters: ControlCounters,
    /// The control is withdrawn: bodies with their center below this height are no longer held, engine units.
    withdrawn_below: Option<f64>,
    /// It has ended for good.
    ended: bool,
}

impl<'a> PileControl<'a> {
    /// `region` in engine units; `None`: the control acts everywhere. `step_length`: characteristic times.
    pub fn new(
        params: &'a ControlParams,
        resolved: &Resolved,
        gravity: f64,
        seed: u64,
        step_length: f64,
        region: Option<&'a DistanceGrid>,
    ) -> PileControl<'a> {
        PileControl {
            params,
            frees_before_hits: resolved.is_on(EffectName::Impact),
            breaks: resolved.is_on(EffectName::Breaking),
            break_limit: params.break_limit(gravity),
            analysis: Analysis::new(params, resolved.is_on(EffectName::KeptVerdicts)),
            eligibility: Eligibility::new(region.filter(|_| resolved.is_on(EffectName::Region))),
            impact: Impact::new(f64::from(params.period) * step_length),
            support: support::of(params, seed).filter(|_| resolved.is_on(EffectName::Control)),
            counters: ControlCounters::default(),
            withdrawn_below: None,
            ended: false,
        }
    }

    pub fn is_on(&self) -> bool {
        self.support.is_some() && !self.ended
    }

    /// Whether a cycle is due before this step of the release.
    pub fn is_due(&self, step: u64) -> bool {
        self.is_on() && step.is_multiple_of(u64::from(self.params.period))
    }

    /// A body was placed by hand, maybe into another one.
    pub fn place(&mut self, id: BodyId) {
        self.eligibility.place(id);
    }

    /// A waiting body is released: it may move now, and counts as a support.
    pub fn release(&mut self, id: BodyId) {
        self.analysis.mark_moved(id);
    }

    /// Bodies that passed the latest cycle.
    pub fn candidates(&self) -> &[bool] {
        &self.analysis.candidates
    }

    pub fn counters(&self) -> ControlCounters {
        ControlCounters {
            region_tests: self.eligibility.region_tests(),
            impact_looks: self.impact.looks,
            shaken: self.impact.count,
            undecided: self.analysis.undecided(),
            ..self.counters
        }
    }

    /// The local problems that a cycle would now pose, of all released bodies with contacts: for tools that compare
    /// solvers on real piles.
    pub fn local_problems(&self, world: &World) -> Vec<BodyProblem> {
        self.analysis.problems(world)
    }

    /// Before each step: frees the bodies that are about to be hit, and returns them.
    pub fn free_before_hits(&mut self, world: &mut World, policy: &mut Policy) -> Vec<BodyId> {
        if !self.frees_before_hits || !self.is_on() {
            return Vec::new();
        }
        let freed = self.impact.free_before_hits(world, policy, &self.analysis.pairs, self.counters.cycles);
        freed.iter().for_each(|&id| self.analysis.mark_moved(id));
        freed
    }

    /// One cycle: each held body is judged again. `rested`: how long each body has been at rest untouched,
    /// characteristic times; shape `[body]`, may be shorter.
    pub fn cycle(&mut self, world: &mut World, policy: &mut Policy, rested: &[f64]) {
        let Some(support) = &mut self.support else { return };
        self.counters.cycles += 1;
        if support.lifetime() == Lifetime::Cycle {
            support.lift(world, policy);
        }
        let pairs = self.analysis.contact_pairs(world);
        let barred = self.eligibility.barred(world, &pairs);
        self.analysis.judge_all(world, &pairs, &barred, &self.eligibility, &mut self.counters);
        if support.lifetime() == Lifetime::Verdict {
            for (id, _) in rested.iter().enumerate().filter(|&(_, &time)| time >= HELD_AFTER) {
                let may = !barred.get(id).is_some_and(|&barred| barred);
                self.counters.held_at_rest += u64::from(may && !self.analysis.candidates[id]);
                self.analysis.candidates[id] |= may;
            }
        }
        let hanging = self.eligibility.hanging(world, &pairs, self.params.speed);
        hanging.iter().for_each(|&id| self.analysis.candidates[id] = false);
        if let Some(height) = self.withdrawn_below {
            let below = world.present().filter(|&id| world.pose(id).translation.y < height);
            below.for_each(|id| self.analysis.candidates[id] = false);
        }
        let verdicts = Verdicts {
            cycle: self.counters.cycles,
            pairs: &pairs,
            candidates: &self.analysis.candidates,
            shaken: &self.impact.shaken,
        };
        support.place(&verdicts, world, policy, &mut self.counters);
        self.resist(world, policy, &eligibility::carried(world, &pairs));
        self.counters.unjammed += hanging.len() as u64;
        policy.unjam(world, &hanging);
        self.analysis.remember(world, pairs);
    }

    /// After each step: supports that carry more than kappa allows break. Returns the bodies that may move again.
    pub fn break_overloaded(&mut self, world: &mut World, policy: &mut Policy) -> Vec<BodyId> {
        if !self.is_on() || !self.breaks {
            return Vec::new();
        }
        let Some(support) = &mut self.support else { return Vec::new() };
        self.counters.break_checks += 1;
        let freed = support.break_overloaded(self.break_limit, world, policy, &mut self.counters);
        freed.iter().for_each(|&id| self.analysis.mark_moved(id));
        freed
    }

    /// From now on the control resists nothing, and holds no body whose center is below this height, engine units.
    pub fn withdraw_below(&mut self, height: f64) {
        self.withdrawn_below = Some(height);
    }

    /// Ends the control: no body is held, resisted or slippery from now on.
    pub fn end(&mut self, world: &mut World, policy: &mut Policy) {
        self.ended = true;
        if let Some(support) = &mut self.support {
            support.end(world, policy);
            policy.unjam(world, &[]);
            policy.forget_looks();
        }
    }

    /// The contacts of slow bodies that are not held resist their motion, so that gaps close gently and resting bodies
    /// become candidates; a falling body falls. `carried`: bodies that moving scenery carries or pushes, which are left
    /// to it; shape `[body]`, may be shorter.
    fn resist(&self, world: &World, policy: &mut Policy, carried: &[bool]) {
        // A body that resistance stops shortly before the end would stand for a moment, and then fall.
        if self.params.resistance == 0.0 || self.withdrawn_below.is_some() {
            return;
        }
        for id in (0..world.bodies().len()).filter(|&id| world.bodies()[id].role == Role::Free) {
            let is_slow = world.speed(id) < self.params.speed && self.eligibility.is_inside(world, id);
            let is_left_alone =
                !self.impact.is_shaken(id, self.counters.cycles) && !carried.get(id).copied().unwrap_or(false);
            let is_resisted = is_slow && is_left_alone;
            policy.resist(id, if is_resisted { self.params.resistance } else { 0.0 });
        }
    }
}
