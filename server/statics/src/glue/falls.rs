//! Bodies that glue cannot hold: it is too weak, or not allowed where it would help.

use super::admm::{Admm, FIRST, GlueWeights, IterationLimits, NEAR};
use super::certificate::MOST_BODIES;
use super::program::GlueProgram;
use super::{GlueError, GlueOptions, GlueProblem, Going};
use crate::global::SHARPEN;

const LIMITS: IterationLimits = IterationLimits { most: 2000, ..FIRST };

/// Outcome of [`fall`].
pub struct Fall {
    /// A body fell.
    pub any: bool,
    pub iterations: u64,
}

/// Marks the bodies that lack most support where glue is free as fallen, until the others lack none. Where none lacks
/// any from the start, although the cone program found no balance, `worst` falls.
pub fn fall(
    pile: &GlueProblem,
    options: &GlueOptions,
    fallen: &mut [bool],
    worst: usize,
    going: &mut Going,
) -> Result<Fall, GlueError> {
    let (mut any, mut iterations) = (false, 0);
    loop {
        let program = GlueProgram::new(pile, options, fallen)?;
        let allowed = program.allowed_sites();
        let mut weights = GlueWeights::even(&program, 0.0, true);
        weights.joints.fill(0.0);
        let mut admm = Admm::new(&program, &allowed, true);
        admm.run(&weights, LIMITS, NEAR, going)?;
        iterations += admm.iterations;
        let missing = admm.missing(SHARPEN);
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
