//! Supports keep candidates in place. A kind of support is one file here, and its parameters in the schema.

mod freeze;
mod nails;

use super::counters::ControlCounters;
use crate::policy::Policy;
use cairn_engine::world::{BodyId, ContactPair, PairSide, World};
use cairn_input::params::{Control as ControlParams, ControlMode, Neighbours};
use std::collections::BTreeMap;

/// The verdicts of a cycle, as supports see them.
pub struct Verdicts<'v> {
    /// Number of the cycle.
    pub cycle: u64,
    pub pairs: &'v [ContactPair],
    /// Passed the analysis and the candidate rules. Shape `[body]`.
    pub candidates: &'v [bool],
    /// Bodies freed before a hit, and the first cycle that may hold them again.
    pub shaken: &'v BTreeMap<BodyId, u64>,
}

/// Lifetime of a support.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lifetime {
    /// Until the next cycle begins, which places all again (paper, 3.3).
    Cycle,
    /// Until a verdict takes it away.
    Verdict,
}

/// A kind of support. The control calls, in this order: [`Support::lift`] at the beginning of a cycle where its
/// lifetime asks for that, [`Support::place`] after the verdicts, [`Support::break_overloaded`] after every step,
/// [`Support::end`] once.
pub trait Support {
    fn lifetime(&self) -> Lifetime;

    /// Takes all of it away.
    fn lift(&mut self, world: &mut World, policy: &mut Policy);

    /// Chooses the bodies to hold, and holds them.
    fn place(&mut self, verdicts: &Verdicts, world: &mut World, policy: &mut Policy, counters: &mut ControlCounters);

    /// Breaks the supports that carry more than `limit`, in weights of the body that they hold. Returns the bodies that
    /// may move again.
    fn break_overloaded(
        &mut self,
        limit: f64,
        world: &mut World,
        policy: &mut Policy,
        counters: &mut ControlCounters,
    ) -> Vec<BodyId>;

    /// The bodies that it holds now. Shape `[body]`.
    fn held(&self, world: &World) -> Vec<bool>;

    /// Takes all of it away for good.
    fn end(&mut self, world: &mut World, policy: &mut Policy) {
        self.lift(world, policy);
    }
}

/// The support that the parameters ask for; `None` where the control is off.
pub fn of(params: &ControlParams, seed: u64) -> Option<Box<dyn Support>> {
    match params.mode {
        ControlMode::Off => None,
        ControlMode::Nails => Some(Box::new(nails::NailSupport::new(params, seed))),
        ControlMode::Hold => Some(Box::new(freeze::FreezeSupport::new(params))),
    }
}

/// The candidates that may be held by the rule for their neighbors. Shape `[body]`.
fn supportable(rule: Neighbours, verdicts: &Verdicts) -> Vec<bool> {
    let mut may = verdicts.candidates.to_vec();
    if rule == Neighbours::Either {
        return may;
    }
    // All bodies in contact with a body must be candidates, too (S_c a subset of C).
    for t in verdicts.pairs {
        if let PairSide::Body(b) = t.b {
            for (x, y) in [(t.a, b), (b, t.a)] {
                may[x] &= verdicts.candidates[y];
            }
        }
    }
    may
}
