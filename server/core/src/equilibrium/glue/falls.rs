//! What glue cannot hold: it is too weak, or may not be where it would help.

use super::certificate::MOST_BODIES;
use super::program::Program;
use super::splitting::{FIRST, Length, NEAR, Splitting, Weights};
use super::{GlueError, GlueOptions, GlueProblem, Going};

/// A body that misses more than this, in its weight, has no support.
const MISSING: f64 = 0.01;
const LENGTH: Length = Length { most: 2000, ..FIRST };

/// What has happened.
pub struct Fall {
    pub any: bool,
    pub iterations: u64,
}

/// Lets fall what misses most where glue costs nothing, until nothing is missed. Where nothing is from the beginning, and the cone
/// program had its say, `worst` falls.
pub fn fall(
    pile: &GlueProblem,
    options: &GlueOptions,
    fallen: &mut [bool],
    worst: usize,
    going: &mut Going,
) -> Result<Fall, GlueError> {
    let (mut any, mut iterations) = (false, 0);
    loop {
        let program = Program::new(pile, options, fallen)?;
        let may: Vec<bool> = program.touches.iter().map(|touch| touch.may).collect();
        let mut weights = Weights::even(&program, 0.0, true);
        weights.dots.fill(0.0);
        let mut splitting = Splitting::new(&program, &may, true);
        splitting.run(&weights, LENGTH, NEAR, going)?;
        iterations += splitting.iterations;
        let missing = splitting.missing(MISSING);
        if missing.is_empty() {
            break;
        }
        any = true;
        missing.into_iter().for_each(|body| fallen[body] = true);
    }
    if !any && fallen.len() <= MOST_BODIES {
        any = !std::mem::replace(&mut fallen[worst], true);
    }
    Ok(Fall { any, iterations })
}
