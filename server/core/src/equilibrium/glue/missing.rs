//! What contacts alone cannot carry, without any glue: [`super::super::global`] by splitting, some twenty times as fast.

use super::program::Program;
use super::splitting::{Length, Splitting, Weights};
use super::{GlueError, GlueOptions, GlueProblem, Going};
use crate::equilibrium::global::SHARPEN;

const PLAIN: GlueOptions = GlueOptions { friction_factor: 1.0, normal_price: 0.0, strength: None };
/// Whether forces have been found is looked at after so many iterations, this often: first with even weights, then in the
/// rounds that settle ties.
const LOOK: Length = Length { least: 100, most: 100 };
const LOOKS: [usize; 3] = [4, 2, 2];

/// What the best contact forces found leave unbalanced. Shape `[body]`, by substitution, in the body's weight; the forces obey
/// friction, so that no body misses less than is told only where others miss more. The search ends once no body misses more than
/// `enough`.
pub fn missing(pile: &GlueProblem, enough: f64, going: &mut Going) -> Result<Vec<f64>, GlueError> {
    let fallen = vec![false; pile.bodies.len()];
    let program = Program::new(pile, &PLAIN, &fallen)?;
    let mut weights = Weights::even(&program, 0.0, true);
    let mut splitting = Splitting::new(&program, &vec![false; pile.touches.len()], true);
    let mut best: Option<(usize, Vec<f64>)> = None;
    for (round, looks) in LOOKS.into_iter().enumerate() {
        if round > 0 {
            weights.reweight_missing(&splitting.state.missing, SHARPEN);
        }
        for _ in 0..looks {
            splitting.run(&weights, LOOK, 0.0, going)?;
            let missing = splitting.left_by_contacts();
            let count = missing.iter().filter(|e| **e > enough).count();
            if best.as_ref().is_none_or(|(fewest, _)| count <= *fewest) {
                best = Some((count, missing));
            }
            if count == 0 {
                return Ok(best.map_or(Vec::new(), |(_, missing)| missing));
            }
        }
    }
    Ok(best.map_or(Vec::new(), |(_, missing)| missing))
}
