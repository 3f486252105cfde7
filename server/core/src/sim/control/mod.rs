//! The control (paper, 3): each cycle analyses the local equilibrium of the bodies, finds candidates among them, and supports those
//! until the next verdict.
//!
//! `analysis` judges bodies, `eligibility` says who is judged at all, `support` holds, `impact` lets go what is about to be hit.

mod analysis;
mod eligibility;
mod impact;
mod state;
pub mod support;
mod tally;

pub use eligibility::is_inside;
pub use tally::{BodyProblem, ControlCounters};

use super::policy::Policy;
use crate::geometry::region::DistanceGrid;
use crate::input::params::Control as ControlParams;
use crate::prepare::effects::{EffectName, Resolved};
use crate::world::{BodyId, ContactPair, Role, World};
use analysis::Analysis;
use eligibility::Eligibility;
use impact::Impact;
use support::{Lifetime, Support, Verdicts};

/// Late in the hold slow bodies are damped this many times as much. What lacks support still falls, at 1/20 of d per natural time:
/// five times what counts as rest.
const LATE_DAMPING: f64 = 3.0;

/// The control and its memory.
pub struct Control<'a> {
    params: &'a ControlParams,
    /// What is about to be hit is let go before.
    looks_out: bool,
    /// What carries too much lets go.
    breaks: bool,
    /// Force per mass at which a support breaks, in weights.
    break_limit: f64,
    analysis: Analysis<'a>,
    eligibility: Eligibility<'a>,
    impact: Impact,
    /// `None`: the control is off.
    support: Option<Box<dyn Support>>,
    tally: ControlCounters,
    /// It has ended for good.
    ended: bool,
}

impl<'a> Control<'a> {
    /// `region` in engine units; `None`: the control acts everywhere. `step_length`: natural times.
    pub fn new(
        params: &'a ControlParams,
        resolved: &Resolved,
        gravity: f64,
        seed: u64,
        step_length: f64,
        region: Option<&'a DistanceGrid>,
    ) -> Control<'a> {
        Control {
            params,
            looks_out: resolved.is_on(EffectName::Impact),
            breaks: resolved.is_on(EffectName::Breaking),
            break_limit: params.break_limit(gravity),
            analysis: Analysis::new(params, resolved.is_on(EffectName::KeptVerdicts)),
            eligibility: Eligibility::new(region.filter(|_| resolved.is_on(EffectName::Region))),
            impact: Impact::new(f64::from(params.period) * step_length),
            support: support::of(params, seed).filter(|_| resolved.is_on(EffectName::Control)),
            tally: ControlCounters::default(),
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

    /// A body falls or flies in.
    pub fn drop_in(&mut self, id: BodyId) {
        self.eligibility.drop_in(id);
    }

    /// A body was placed by hand, maybe into another one.
    pub fn place(&mut self, id: BodyId) {
        self.eligibility.place(id);
    }

    /// A waiting body is let go: it may move now, and counts as a support.
    pub fn release(&mut self, id: BodyId) {
        self.analysis.stir(id);
    }

    /// Bodies that passed the latest cycle.
    pub fn candidates(&self) -> &[bool] {
        &self.analysis.candidates
    }

    /// What it has done so far.
    pub fn counters(&self) -> ControlCounters {
        ControlCounters {
            region_tests: self.eligibility.region_tests(),
            impact_looks: self.impact.looks,
            shaken: self.impact.count,
            undecided: self.analysis.undecided(),
            ..self.tally
        }
    }

    /// The local problems that a cycle would now pose, of all released bodies with contacts: for tools that compare
    /// solvers on real piles.
    pub fn local_problems(&self, world: &World) -> Vec<BodyProblem> {
        self.analysis.problems(world)
    }

    /// Before each step: lets go what is about to be hit.
    pub fn look_out(&mut self, world: &mut World, policy: &mut Policy) {
        if !self.looks_out || !self.is_on() {
            return;
        }
        let freed = self.impact.look(world, policy, &self.analysis.touches, self.tally.cycles);
        freed.into_iter().for_each(|id| self.analysis.stir(id));
    }

    /// One cycle: everything that was held is judged anew.
    pub fn cycle(&mut self, world: &mut World, policy: &mut Policy) {
        let Some(support) = &mut self.support else { return };
        self.tally.cycles += 1;
        if support.lifetime() == Lifetime::Cycle {
            support.lift(world, policy);
        }
        let touches = self.analysis.touch(world);
        let barred = self.eligibility.barred(world, &touches);
        self.analysis.judge_all(world, &touches, &barred, &self.eligibility, &mut self.tally);
        let hanging = self.eligibility.hanging(world, &touches, self.params.speed);
        hanging.iter().for_each(|&id| self.analysis.candidates[id] = false);
        let verdicts = Verdicts {
            cycle: self.tally.cycles,
            touches: &touches,
            candidates: &self.analysis.candidates,
            shaken: &self.impact.shaken,
        };
        support.place(&verdicts, world, policy, &mut self.tally);
        self.damp(world, policy, &touches);
        self.tally.unjammed += hanging.len() as u64;
        policy.unjam(world, &hanging);
        self.analysis.note(world, touches);
    }

    /// After each step: what carries more than kappa allows lets go.
    pub fn break_overloaded(&mut self, world: &mut World, policy: &mut Policy) {
        if !self.is_on() || !self.breaks {
            return;
        }
        let Some(support) = &mut self.support else { return };
        self.tally.break_checks += 1;
        let freed = support.break_overloaded(self.break_limit, world, policy, &mut self.tally);
        freed.into_iter().for_each(|id| self.analysis.stir(id));
    }

    /// Ends the control: nothing is held, damped or slippery any more.
    pub fn end(&mut self, world: &mut World, policy: &mut Policy) {
        self.ended = true;
        if let Some(support) = &mut self.support {
            support.end(world, policy);
            policy.unjam(world, &[]);
        }
    }

    /// Slow bodies that are not candidates lose speed, so that near contacts close gently and rest can be candidates;
    /// a falling body falls.
    fn damp(&self, world: &World, policy: &mut Policy, touches: &[ContactPair]) {
        if self.params.damping == 0.0 {
            return;
        }
        let flying = self.eligibility.flying(touches);
        let quiet = policy.quiet();
        let slowly = if quiet.is_some() { LATE_DAMPING } else { 1.0 } * self.params.damping;
        for id in (0..world.bodies().len()).filter(|&id| world.bodies()[id].role == Role::Free) {
            let judged = quiet.is_some() || self.eligibility.is_inside(world, id);
            let damping = match world.speed(id) < self.params.speed {
                _ if !judged || self.impact.is_shaken(id, self.tally.cycles) || flying.contains(&id) => 0.0,
                true => slowly,
                false => quiet.unwrap_or(0.0),
            };
            policy.damp(id, damping);
        }
    }
}
