//! Forces that balance the chosen dots, and prove it by substitution.
//!
//! The splitting method gets near, and then creeps. From there, corrections that move each force in proportion to its own size
//! (affine scaling; Dikin 1967) keep it within its law, and reach balance in a few solves where the forces leave any room at all.

use super::factor::{Factor, Mobility, Work};
use super::program::{Program, State};
use super::splitting::{Length, Splitting, Weights, capped, onto_cone};
use super::{GlueError, Going, oracle};
use crate::equilibrium::global::BALANCED;
use nalgebra::{Vector3, Vector6};

/// What balances.
pub struct Balanced {
    /// Where the dots are.
    pub touches: Vec<usize>,
    pub state: State,
    /// Sum over the bodies of what it leaves unbalanced.
    pub imbalance: f64,
    pub by_cone_program: bool,
    pub iterations: u64,
}

/// How long the splitting method is given before a correction, and how near it is to get, on average over the bodies.
const APPROACH: Length = Length { least: 50, most: 600 };
const NEAR: f64 = 3e-4;
/// Price of a normal force meanwhile.
const PRICE: f64 = 1e-3;
/// Corrections, the residual of each, and the iterations that it may take.
const CORRECTIONS: usize = 12;
const RESIDUAL: f64 = 1e-3;
const INNER: usize = 400;
/// No force is less movable than one of this size, in weights; nor a dot than one of that size.
const LEAST_CONTACT: f64 = 1e-4;
const LEAST_DOT: f64 = 1.0;
/// Beyond so many bodies, Clarabel takes longer than all the rest.
pub const MOST_BODIES: usize = 2000;

/// Forces for the dots at these touches, from a state nearby; with the help of Clarabel where that is allowed and needed. `tight`: the
/// same pile with less friction, which leaves room for corrections.
pub fn balance(
    program: &Program,
    tight: &Program,
    from: State,
    chosen: &[usize],
    by_cone_program: bool,
    going: &mut Going,
) -> Result<Balanced, GlueError> {
    let mut may = vec![false; program.touches.len()];
    chosen.iter().for_each(|&touch| may[touch] = true);
    let mut splitting = Splitting::new(tight, &may, false);
    splitting.take(from);
    let mut weights = Weights::even(program, PRICE, false);
    weights.dots.fill(0.0);
    splitting.run(&weights, APPROACH, NEAR, going)?;
    let iterations = splitting.iterations;
    let (state, imbalance) = correct(program, splitting.state, &may, going)?;
    let bodies = program.target.len();
    let exact = if by_cone_program && imbalance > BALANCED && bodies <= MOST_BODIES {
        oracle::balance(program, &may).ok()
    } else {
        None
    };
    let exact = exact.map(|state| (unbalanced(program, &state), state));
    let touches = chosen.to_vec();
    if let Some((exact, state)) = exact.filter(|(exact, _)| *exact < imbalance) {
        return Ok(Balanced { touches, state, imbalance: exact, by_cone_program: true, iterations });
    }
    Ok(Balanced { touches, state, imbalance, by_cone_program: false, iterations })
}

/// The best state found, and what it leaves unbalanced.
fn correct(program: &Program, from: State, may: &[bool], going: &mut Going) -> Result<(State, f64), GlueError> {
    let mut best = (from.clone(), unbalanced(program, &from));
    let mut state = from;
    let (mut left, mut work) = (Vec::new(), Work::default());
    for _ in 0..CORRECTIONS {
        if best.1 <= BALANCED {
            break;
        }
        if going().is_break() {
            return Err(GlueError::Cancelled);
        }
        let size = |normal: f64, least: f64| normal.max(least).powi(2);
        let mobility = Mobility {
            contacts: state.contacts.iter().map(|f| size(f[0], LEAST_CONTACT)).collect(),
            dots: state
                .dots
                .iter()
                .zip(may)
                .map(|(g, &may)| if may { size(g.norm(), LEAST_DOT) } else { 0.0 })
                .collect(),
            missing: 0.0,
        };
        program.imbalance(&state, &mut left);
        let mut multipliers = vec![Vector6::zeros(); left.len()];
        Factor::new(program, &mobility).solve(&left, &mut multipliers, RESIDUAL, INNER, &mut work);
        let State { contacts, dots, .. } = &mut state;
        let contact = |at: usize, step: Vector3<f64>| {
            contacts[at] = onto_cone(contacts[at] + step * mobility.contacts[at], 0.0, program.contacts[at].friction);
        };
        let dot = |t: usize, step: Vector6<f64>| {
            dots[t] = capped(dots[t] + step * mobility.dots[t], program.touches[t].strength);
        };
        program.velocities(&multipliers, may, contact, dot);
        let now = unbalanced(program, &state);
        if now < best.1 {
            best = (state.clone(), now);
        }
    }
    Ok(best)
}

/// Sum over the bodies of what forces leave unbalanced.
fn unbalanced(program: &Program, state: &State) -> f64 {
    let mut left = Vec::new();
    program.imbalance(state, &mut left);
    left.iter().map(|e| e.norm()).sum()
}

/// The body that misses most.
pub fn worst(program: &Program, state: &State) -> usize {
    let mut left = Vec::new();
    program.imbalance(state, &mut left);
    (0..left.len()).max_by(|&a, &b| left[a].norm().total_cmp(&left[b].norm())).unwrap_or(0)
}
