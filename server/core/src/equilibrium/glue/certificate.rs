//! Forces that balance the chosen dots, and prove it by substitution.
//!
//! The splitting method gets near, and then creeps. From there, corrections that move each force in proportion to its own size
//! (affine scaling; Dikin 1967) keep it within its law, and reach balance in a few solves where the forces leave any room at all. Where
//! few bodies are left without balance, each needs a dot that was too small to be seen among all the others: it gets one.

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
    /// Sum over the bodies of what it leaves unbalanced, in a large pile for each [`COUNTED`] of them.
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
/// Corrections in a row that may bring less than a tenth.
const STALLS: usize = 3;
/// A force that has met its bound, and lost more than [`CUT_BACK`] of its correction there, is so much less movable in the next one;
/// after each that it could follow, by [`FREED`] more again.
const CUT_BACK: f64 = 0.1;
const BOUND: f64 = 0.1;
const FREED: f64 = 2.0;
/// A body is short of a dot if it misses at least this share of what the worst one misses. Where no more bodies are short of one than
/// this number, and this share of all, they get it, so many times.
const SHORT: f64 = 0.1;
const FEW: usize = 2;
const FEW_OF: f64 = 0.02;
const ADDITIONS: usize = 8;
/// As many bodies as [`BALANCED`] is meant for.
const COUNTED: f64 = 1000.0;
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
    let nearly = correct(program, splitting.state, &may, going)?;
    let (state, imbalance) = add_where_short(program, nearly, &mut may, going)?;
    let bodies = program.target.len();
    let exact = if by_cone_program && imbalance > BALANCED && bodies <= MOST_BODIES {
        oracle::balance(program, &may).ok()
    } else {
        None
    };
    let exact = exact.map(|state| (unbalanced(program, &state), state));
    let touches = (0..may.len()).filter(|&touch| may[touch]).collect();
    if let Some((exact, state)) = exact.filter(|(exact, _)| *exact < imbalance) {
        return Ok(Balanced { touches, state, imbalance: exact, by_cone_program: true, iterations });
    }
    Ok(Balanced { touches, state, imbalance, by_cone_program: false, iterations })
}

/// Where few bodies are short of a dot, each gets one that joins it to another such body, to what stands still, or else to what it is
/// pressed against most; as long as that balances more.
fn add_where_short(
    program: &Program,
    mut best: (State, f64),
    may: &mut [bool],
    going: &mut Going,
) -> Result<(State, f64), GlueError> {
    let mut left = Vec::new();
    for _ in 0..ADDITIONS {
        if best.1 <= BALANCED {
            break;
        }
        program.imbalance(&best.0, &mut left);
        let most = left.iter().map(|e| e.norm()).fold(0.0, f64::max);
        let is_short: Vec<bool> = left.iter().map(|e| e.norm() >= SHORT * most).collect();
        let few = FEW + (FEW_OF * left.len() as f64) as usize;
        if is_short.iter().filter(|is_short| **is_short).count() > few {
            break;
        }
        // Per body: how good the best touch is, and which.
        let mut more: Vec<Option<((u8, f64), usize)>> = vec![None; left.len()];
        for (t, touch) in program.touches.iter().enumerate().filter(|(t, touch)| touch.may && !may[*t]) {
            let sides = touch.sides();
            let rank = match sides {
                [a, b] if is_short[a.body] && is_short[b.body] => 2,
                [_] => 1,
                _ => 0,
            };
            let press: f64 = touch.contacts.clone().map(|at| best.0.contacts[at][0]).sum();
            for side in sides.iter().filter(|side| is_short[side.body]) {
                if more[side.body].is_none_or(|(good, _)| (rank, press) > good) {
                    more[side.body] = Some(((rank, press), t));
                }
            }
        }
        let more: Vec<usize> = more.into_iter().flatten().map(|(_, touch)| touch).collect();
        more.iter().for_each(|&touch| may[touch] = true);
        let found = correct(program, best.0.clone(), may, going)?;
        if found.1 >= best.1 {
            more.iter().for_each(|&touch| may[touch] = false);
            break;
        }
        best = found;
    }
    Ok(best)
}

/// The best state found, and what it leaves unbalanced.
fn correct(program: &Program, from: State, may: &[bool], going: &mut Going) -> Result<(State, f64), GlueError> {
    let mut best = (from.clone(), unbalanced(program, &from));
    let mut state = from;
    let (mut left, mut work) = (Vec::new(), Work::default());
    // Beside the force's own size. Shape `[contact]`.
    let mut movable = vec![1.0f64; state.contacts.len()];
    let mut stalls = 0;
    for _ in 0..CORRECTIONS {
        if best.1 <= BALANCED || stalls >= STALLS {
            break;
        }
        if going().is_break() {
            return Err(GlueError::Cancelled);
        }
        let size = |normal: f64, least: f64| normal.max(least).powi(2);
        let mobility = Mobility {
            contacts: state.contacts.iter().zip(&movable).map(|(f, by)| size(f[0], LEAST_CONTACT) * by).collect(),
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
            let step = step * mobility.contacts[at];
            let wanted = contacts[at] + step;
            contacts[at] = onto_cone(wanted, 0.0, program.contacts[at].friction);
            let is_cut_back = (wanted - contacts[at]).norm() > CUT_BACK * step.norm();
            movable[at] = if is_cut_back { movable[at] * BOUND } else { (movable[at] * FREED).min(1.0) };
        };
        let dot = |t: usize, step: Vector6<f64>| {
            dots[t] = capped(dots[t] + step * mobility.dots[t], program.touches[t].strength);
        };
        program.velocities(&multipliers, may, contact, dot);
        let now = unbalanced(program, &state);
        stalls = if now > 0.9 * best.1 { stalls + 1 } else { 0 };
        if now < best.1 {
            best = (state.clone(), now);
        }
    }
    Ok(best)
}

/// Sum over the bodies of what forces leave unbalanced; in a large pile for each [`COUNTED`] of them.
fn unbalanced(program: &Program, state: &State) -> f64 {
    let mut left = Vec::new();
    program.imbalance(state, &mut left);
    left.iter().map(|e| e.norm()).sum::<f64>() / (left.len() as f64 / COUNTED).max(1.0)
}

/// The body that misses most.
pub fn worst(program: &Program, state: &State) -> usize {
    let mut left = Vec::new();
    program.imbalance(state, &mut left);
    (0..left.len()).max_by(|&a, &b| left[a].norm().total_cmp(&left[b].norm())).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::equilibrium::global::{GlobalBody, GlobalContact};
    use crate::equilibrium::glue::{GlueOptions, GlueProblem, GlueTouch};
    use glam::DVec3;
    use std::ops::ControlFlow;

    /// Bodies beside each other on four contacts each, the last one with its weight beyond them: no dot was chosen, and it is the only
    /// one that is short of one.
    #[test]
    fn only_a_body_that_is_short_of_a_dot_gets_one() {
        let count = 8;
        let center = |body: usize| DVec3::new(if body + 1 < count { 0.0 } else { 0.25 }, 0.2, body as f64);
        let bodies: Vec<GlobalBody> =
            (0..count).map(|body| GlobalBody { mass: 1.0, center_of_mass: center(body), radius: 0.5 }).collect();
        let contact = |body: usize, x: f64, z: f64| GlobalContact {
            body,
            other: None,
            point: DVec3::new(x, 0.0, body as f64 + z),
            normal: DVec3::Y,
            friction: 0.5,
        };
        let corners = [(-0.2, -0.2), (-0.2, 0.2), (0.2, -0.2), (0.2, 0.2)];
        let contacts: Vec<GlobalContact> =
            (0..count).flat_map(|body| corners.map(|(x, z)| contact(body, x, z))).collect();
        let touch = |body: usize| GlueTouch {
            body,
            other: None,
            contacts: body * 4..body * 4 + 4,
            center: DVec3::new(0.0, 0.0, body as f64),
            arm: 0.125,
            may: true,
            normal_price: 0.0,
        };
        let touches: Vec<GlueTouch> = (0..count).map(touch).collect();
        let problem = GlueProblem {
            bodies: &bodies,
            contacts: &contacts,
            touches: &touches,
            gravity: DVec3::new(0.0, -9.81, 0.0),
        };
        let options = GlueOptions { friction_factor: 0.5, normal_price: 0.02, strength: None, rounds: 7 };
        let program = Program::new(&problem, &options, &vec![false; count]).expect("a valid pile");
        let mut going = || ControlFlow::Continue(());
        let from = program.empty_state();
        let balanced = balance(&program, &program, from, &[], false, &mut going).expect("it goes on");
        assert!(balanced.imbalance <= BALANCED, "{}", balanced.imbalance);
        assert_eq!(balanced.touches, [count - 1]);
    }
}
