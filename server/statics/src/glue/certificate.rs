//! Forces that balance the chosen joints, and prove it by substitution.
//!
//! The splitting method gets near balance, and then converges slowly. From there, corrections that move each force in
//! proportion to its own size (affine scaling; Dikin 1967) keep it within its law, and reach balance in a few solves
//! where the forces leave any room. Where few bodies remain without balance, each lacks a joint that was too small to
//! show among all the others, and gets one.

use super::admm::{Admm, GlueWeights, IterationLimits, NEAR, capped, onto_cone};
use super::factor::{ACCURATE, Factor, Mobility, Workspace};
use super::program::{GlueForces, GlueProgram};
use super::{GlueError, Going, MINOR, NOTHING, REPAIR_SHARE, interior_point};
use crate::global::BALANCED;
use crate::local;
use nalgebra::{Vector3, Vector6};

/// A balanced state, or the best one found.
pub struct Balanced {
    /// Sites of the joints.
    pub sites: Vec<usize>,
    pub state: GlueForces,
    /// Sum of the bodies' imbalances, in a large pile for each [`COUNTED`] of them.
    pub imbalance: f64,
    pub by_cone_program: bool,
    pub iterations: u64,
}

/// Iterations of the splitting method before a correction.
const APPROACH: IterationLimits = IterationLimits { least: 50, most: 600 };
/// Bound on the corrections, and on the rounds that add joints. Each converges in a few, or stalls.
const CORRECTIONS: usize = 12;
/// Corrections in a row that may bring less than [`MINOR`].
const STALLS: usize = 3;
/// Each correction that a force follows makes it more movable again, by this factor.
const FREED: f64 = 2.0;
/// Where at most [`FEW`] bodies and this share of all lack a joint, each gets one.
const FEW_OF: f64 = 0.02;
/// See [`FEW_OF`]: of a small pile, that share is none.
const FEW: usize = 2;
/// The number of bodies that [`BALANCED`] is meant for.
const COUNTED: f64 = 1000.0;
/// Every joint is as movable as one that carries this much at least, in weights. (A contact: [`NOTHING`].)
const LEAST_JOINT: f64 = 1.0;
/// Bound on the iterations of a linear solve.
pub const MOST_INNER: usize = local::MOST_ITERATIONS as usize;
/// Beyond this many bodies, Clarabel takes longer than all other steps together.
pub const MOST_BODIES: usize = 2000;

/// Forces for the joints at these sites, from a state nearby; by Clarabel where that is allowed and needed. `tight`:
/// the same pile with less friction, which leaves room for corrections.
pub fn balance(
    program: &GlueProgram,
    tight: &GlueProgram,
    from: GlueForces,
    chosen: &[usize],
    by_cone_program: bool,
    going: &mut Going,
) -> Result<Balanced, GlueError> {
    let mut allowed = vec![false; program.sites.len()];
    chosen.iter().for_each(|&site| allowed[site] = true);
    let mut admm = Admm::new(tight, &allowed, false);
    admm.take(from);
    let mut weights = GlueWeights::even(program, interior_point::PRICE, false);
    weights.joints.fill(0.0);
    admm.run(&weights, APPROACH, NEAR * REPAIR_SHARE, going)?;
    let iterations = admm.iterations;
    let nearly = correct(program, admm.state, &allowed, MOST_INNER, going)?;
    let (state, imbalance) = add_where_short(program, nearly, &mut allowed, going)?;
    let bodies = program.target.len();
    let exact = if by_cone_program && imbalance > BALANCED && bodies <= MOST_BODIES {
        interior_point::balance(program, &allowed).ok()
    } else {
        None
    };
    let exact = exact.map(|state| (unbalanced(program, &state), state));
    let sites = (0..allowed.len()).filter(|&site| allowed[site]).collect();
    if let Some((exact, state)) = exact.filter(|(exact, _)| *exact < imbalance) {
        return Ok(Balanced { sites, state, imbalance: exact, by_cone_program: true, iterations });
    }
    Ok(Balanced { sites, state, imbalance, by_cone_program: false, iterations })
}

/// Where few bodies lack a joint, each gets one: to another such body, to the ground, or else to the body that it
/// presses most; as long as that lowers the imbalance.
fn add_where_short(
    program: &GlueProgram,
    mut best: (GlueForces, f64),
    allowed: &mut [bool],
    going: &mut Going,
) -> Result<(GlueForces, f64), GlueError> {
    let mut left = Vec::new();
    for _ in 0..CORRECTIONS {
        if best.1 <= BALANCED {
            break;
        }
        program.imbalance(&best.0, &mut left);
        let most = left.iter().map(|e| e.norm()).fold(0.0, f64::max);
        let is_short: Vec<bool> = left.iter().map(|e| e.norm() >= MINOR * most).collect();
        let few = FEW + (FEW_OF * left.len() as f64) as usize;
        if is_short.iter().filter(|is_short| **is_short).count() > few {
            break;
        }
        // Per body: the rank of its best site, and that site.
        let mut more: Vec<Option<((u8, f64), usize)>> = vec![None; left.len()];
        for (t, site) in program.sites.iter().enumerate().filter(|(t, site)| site.may_glue && !allowed[*t]) {
            let ends = site.ends();
            let rank = match ends {
                [a, b] if is_short[a.body] && is_short[b.body] => 2,
                [_] => 1,
                _ => 0,
            };
            let press: f64 = site.contacts.clone().map(|at| best.0.contacts[at][0]).sum();
            for end in ends.iter().filter(|end| is_short[end.body]) {
                if more[end.body].is_none_or(|(good, _)| (rank, press) > good) {
                    more[end.body] = Some(((rank, press), t));
                }
            }
        }
        let more: Vec<usize> = more.into_iter().flatten().map(|(_, site)| site).collect();
        more.iter().for_each(|&site| allowed[site] = true);
        let found = correct(program, best.0.clone(), allowed, MOST_INNER, going)?;
        if found.1 >= best.1 {
            more.iter().for_each(|&site| allowed[site] = false);
            break;
        }
        best = found;
    }
    Ok(best)
}

/// The best state found, and its imbalance. `most_inner`: bound on the iterations of each of its linear solves.
pub fn correct(
    program: &GlueProgram,
    from: GlueForces,
    allowed: &[bool],
    most_inner: usize,
    going: &mut Going,
) -> Result<(GlueForces, f64), GlueError> {
    let mut best = (from.clone(), unbalanced(program, &from));
    let mut state = from;
    let (mut left, mut work) = (Vec::new(), Workspace::default());
    // Factor on the mobility that the force's own size gives. Shape `[contact]`.
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
            contacts: state.contacts.iter().zip(&movable).map(|(f, by)| size(f[0], NOTHING) * by).collect(),
            joints: state
                .joints
                .iter()
                .zip(allowed)
                .map(|(g, &is_allowed)| if is_allowed { size(g.norm(), LEAST_JOINT) } else { 0.0 })
                .collect(),
            missing: 0.0,
        };
        program.imbalance(&state, &mut left);
        let mut multipliers = vec![Vector6::zeros(); left.len()];
        Factor::new(program, &mobility).solve(&left, &mut multipliers, ACCURATE, most_inner, &mut work);
        let GlueForces { contacts, joints, .. } = &mut state;
        let contact = |at: usize, step: Vector3<f64>| {
            let step = step * mobility.contacts[at];
            let wanted = contacts[at] + step;
            contacts[at] = onto_cone(wanted, 0.0, program.contacts[at].friction);
            let is_cut_back = (wanted - contacts[at]).norm() > MINOR * step.norm();
            movable[at] = if is_cut_back { movable[at] * MINOR } else { (movable[at] * FREED).min(1.0) };
        };
        let joint = |t: usize, step: Vector6<f64>| {
            joints[t] = capped(joints[t] + step * mobility.joints[t], program.sites[t].strength);
        };
        program.velocities(&multipliers, allowed, contact, joint);
        let now = unbalanced(program, &state);
        stalls = if now > (1.0 - MINOR) * best.1 { stalls + 1 } else { 0 };
        if now < best.1 {
            best = (state.clone(), now);
        }
    }
    Ok(best)
}

/// Sum of the bodies' imbalances; in a large pile for each [`COUNTED`] of them.
fn unbalanced(program: &GlueProgram, state: &GlueForces) -> f64 {
    let mut left = Vec::new();
    program.imbalance(state, &mut left);
    left.iter().map(|e| e.norm()).sum::<f64>() / (left.len() as f64 / COUNTED).max(1.0)
}

/// The body with the largest imbalance.
pub fn worst(program: &GlueProgram, state: &GlueForces) -> usize {
    let mut left = Vec::new();
    program.imbalance(state, &mut left);
    (0..left.len()).max_by(|&a, &b| left[a].norm().total_cmp(&left[b].norm())).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::global::{GlobalBody, GlobalContact};
    use crate::glue::{GlueOptions, GlueProblem, GlueSite};
    use glam::DVec3;
    use std::ops::ControlFlow;

    /// Bodies beside each other on four contacts each, the last one with its weight beyond them: no joint was chosen,
    /// and only the last body lacks one.
    #[test]
    fn only_a_body_that_lacks_a_joint_gets_one() {
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
        let site = |body: usize| GlueSite {
            body,
            other: None,
            contacts: body * 4..body * 4 + 4,
            center: DVec3::new(0.0, 0.0, body as f64),
            arm: 0.125,
            may_glue: true,
            normal_price: 0.0,
        };
        let sites: Vec<GlueSite> = (0..count).map(site).collect();
        let problem =
            GlueProblem { bodies: &bodies, contacts: &contacts, sites: &sites, gravity: DVec3::new(0.0, -9.81, 0.0) };
        let options = GlueOptions { friction_factor: 0.5, normal_price: 0.02, strength: None, rounds: 7 };
        let program = GlueProgram::new(&problem, &options, &vec![false; count]).expect("a valid pile");
        let mut going = || ControlFlow::Continue(());
        let from = program.empty_state();
        let balanced = balance(&program, &program, from, &[], false, &mut going).expect("it goes on");
        assert!(balanced.imbalance <= BALANCED, "{}", balanced.imbalance);
        assert_eq!(balanced.sites, [count - 1]);
    }
}
