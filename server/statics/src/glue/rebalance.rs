//! Contact forces that balance a pile without glue: one that has changed a little, from those before, or a new one.

use super::admm::{Admm, GlueWeights, IterationLimits, onto_cone};
use super::program::GlueProgram;
use super::{GlueError, GlueProblem, Going, UNBOUNDED, certificate};
use crate::global::BALANCED;
use crate::limit::Load;
use glam::DVec3;

/// Runs of the splitting method, each with a correction, and the iterations of one. Most piles that stand are balanced
/// in one; a run that leaves more than this share of what the best one left, which is far from balance, shows that
/// others would not help.
const RUNS: usize = 8;
const RUN: IterationLimits = IterationLimits { least: 200, most: 200 };
const BETTER: f64 = 0.9;
const NEARLY: f64 = 1e-3;

/// Price of half the square of a force, where the forces are to be even.
const EVEN: f64 = 0.1;

/// Iterations of a linear solve in a correction of forces: what needs more is hardly ever balanced in the end.
const FEW_INNER: usize = 50;

/// Forces near `forces` that balance every body under its weight and a load, and what they leave: the sum over the
/// bodies, each relative to its weight. No joints. Shapes: `[body]`, `[contact]`.
pub fn rebalance(
    pile: &GlueProblem,
    loads: &[Load],
    forces: &[DVec3],
    going: &mut Going,
) -> Result<(Vec<DVec3>, f64), GlueError> {
    let mut program = GlueProgram::new(pile, &UNBOUNDED, &vec![false; pile.bodies.len()])?;
    program.load(loads);
    let mut state = program.state_of_contacts(forces);
    for (force, contact) in state.contacts.iter_mut().zip(&program.contacts) {
        *force = onto_cone(*force, 0.0, contact.friction);
    }
    let (state, imbalance) = certificate::correct(&program, state, &vec![false; pile.sites.len()], FEW_INNER, going)?;
    Ok((program.forces(&state), imbalance))
}

/// Forces that balance every body under its weight and a load by contacts alone, not far from the smallest such forces,
/// and what they leave: the sum over the bodies, each relative to its weight; in a large pile per thousand bodies.
/// Where the pile stands, this takes a small part of the time of a cone program; where it does not, the search ends
/// soon. Shapes: `[body]`, `[contact]`.
/// `is_even`: nearer to the smallest forces, which load all contacts of a face alike, and none for nothing; slower.
pub fn balance(
    pile: &GlueProblem,
    loads: &[Load],
    is_even: bool,
    going: &mut Going,
) -> Result<(Vec<DVec3>, f64), GlueError> {
    let allowed = vec![false; pile.sites.len()];
    let mut program = GlueProgram::new(pile, &UNBOUNDED, &vec![false; pile.bodies.len()])?;
    program.load(loads);
    let mut admm = Admm::new(&program, &allowed, false);
    let squares = if is_even { EVEN } else { 0.0 };
    let weights = GlueWeights { squares, ..GlueWeights::even(&program, 0.0, false) };
    let mut best = (admm.state.clone(), f64::INFINITY);
    for _ in 0..RUNS {
        admm.run(&weights, RUN, 0.0, going)?;
        let (state, imbalance) =
            certificate::correct(&program, admm.state.clone(), &allowed, certificate::MOST_INNER, going)?;
        let is_hopeless = imbalance > BETTER * best.1 && best.1 > NEARLY;
        if imbalance < best.1 {
            best = (state, imbalance);
        }
        if best.1 <= BALANCED || is_hopeless {
            break;
        }
    }
    Ok((program.forces(&best.0), best.1))
}
