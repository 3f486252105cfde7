//! The weight that contacts alone cannot carry, without any glue: [`crate::global`] by splitting, about twenty times as
//! fast.

use super::admm::{Admm, GlueWeights, IterationLimits};
use super::factor::ACCURATE;
use super::program::GlueProgram;
use super::{GlueError, GlueProblem, Going, UNBOUNDED};
use crate::global::SHARPEN;

/// Iterations between two looks at the imbalance.
const LOOK: IterationLimits = IterationLimits { least: 100, most: 100 };
/// Looks at most: first with even weights, then in the rounds that settle ties.
const LOOKS: [usize; 3] = [40, 20, 20];
/// A round ends once this many looks in a row find the same number of unsupported bodies, which settles long before
/// their imbalance does; or once the total imbalance changes by no larger share than [`ACCURATE`].
const STEADY: usize = 10;

/// The imbalance of the best contact forces found, and the iterations. Shape `[body]`, by substitution, in the body's
/// weight. The forces obey friction, so that a body's imbalance could only be smaller if others' were larger. The
/// search ends once no body's imbalance exceeds `enough`.
pub fn missing(pile: &GlueProblem, enough: f64, going: &mut Going) -> Result<(Vec<f64>, u64), GlueError> {
    let fallen = vec![false; pile.bodies.len()];
    let program = GlueProgram::new(pile, &UNBOUNDED, &fallen)?;
    let mut weights = GlueWeights::even(&program, 0.0, true);
    let mut admm = Admm::new(&program, &vec![false; pile.sites.len()], true);
    let mut best: Option<(usize, Vec<f64>)> = None;
    for (round, looks) in LOOKS.into_iter().enumerate() {
        if round > 0 {
            weights.reweight_missing(&admm.state.missing, SHARPEN);
        }
        let (mut last, mut last_count, mut steady) = (f64::INFINITY, usize::MAX, 0);
        for _ in 0..looks {
            admm.run(&weights, LOOK, 0.0, going)?;
            let missing = admm.left_by_contacts();
            let total: f64 = missing.iter().sum();
            let is_settled = (total - last).abs() <= ACCURATE * total;
            last = total;
            let count = missing.iter().filter(|e| **e > enough).count();
            if best.as_ref().is_none_or(|(fewest, _)| count <= *fewest) {
                best = Some((count, missing));
            }
            steady = if count == last_count { steady + 1 } else { 0 };
            last_count = count;
            if count > 0 && (is_settled || steady == STEADY) {
                break;
            }
            if count == 0 {
                return Ok((best.map_or(Vec::new(), |(_, missing)| missing), admm.iterations));
            }
        }
    }
    Ok((best.map_or(Vec::new(), |(_, missing)| missing), admm.iterations))
}
