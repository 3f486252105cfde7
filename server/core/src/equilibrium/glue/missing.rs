//! What contacts alone cannot carry, without any glue: [`super::super::global`] by splitting, some twenty times as fast.

use super::program::Program;
use super::splitting::{Length, Splitting, Weights};
use super::{GlueError, GlueOptions, GlueProblem, Going, MOST_ROUNDS};
use crate::equilibrium::global::SHARPEN;

const PLAIN: GlueOptions = GlueOptions { friction_factor: 1.0, normal_price: 0.0, strength: None, rounds: MOST_ROUNDS };
/// Whether forces have been found is looked at after so many iterations.
const LOOK: Length = Length { least: 100, most: 100 };
/// Looks at most: first with even weights, then in the rounds that settle ties.
const LOOKS: [usize; 3] = [40, 20, 20];
/// A round ends once a look finds what is missing in all changed by no larger share, or so many looks in a row have found as many
/// bodies that miss something: what these miss changes for long, and that they do does not.
const SETTLED: f64 = 0.001;
const STEADY: usize = 10;

/// What the best contact forces found leave unbalanced. Shape `[body]`, by substitution, in the body's weight; the forces obey
/// friction, so that no body misses less than is told only where others miss more. The search ends once no body misses more than
/// `enough`. Also tells its iterations.
pub fn missing(pile: &GlueProblem, enough: f64, going: &mut Going) -> Result<(Vec<f64>, u64), GlueError> {
    let fallen = vec![false; pile.bodies.len()];
    let program = Program::new(pile, &PLAIN, &fallen)?;
    let mut weights = Weights::even(&program, 0.0, true);
    let mut splitting = Splitting::new(&program, &vec![false; pile.touches.len()], true);
    let mut best: Option<(usize, Vec<f64>)> = None;
    for (round, looks) in LOOKS.into_iter().enumerate() {
        if round > 0 {
            weights.reweight_missing(&splitting.state.missing, SHARPEN);
        }
        let (mut last, mut last_count, mut steady) = (f64::INFINITY, usize::MAX, 0);
        for _ in 0..looks {
            splitting.run(&weights, LOOK, 0.0, going)?;
            let missing = splitting.left_by_contacts();
            let total: f64 = missing.iter().sum();
            let is_settled = (total - last).abs() <= SETTLED * total;
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
                return Ok((best.map_or(Vec::new(), |(_, missing)| missing), splitting.iterations));
            }
        }
    }
    Ok((best.map_or(Vec::new(), |(_, missing)| missing), splitting.iterations))
}
