//! The reference: the same programs for Clarabel, an interior-point method. Slower; the splitting method is compared
//! with it.
//!
//! In the dual, the unknown is a virtual motion of the bodies against gravity, six numbers for each; the forces are its
//! multipliers:
//!
//! ```text
//! maximise   work of that motion against gravity
//! such that  at each contact   price + its velocity is in the dual of the friction cone
//!            at each joint       |velocity| <= w
//! ```
//!
//! A joint of bounded strength may move faster, at the price of its strength.

use super::program::{GlueForces, GlueProgram};
use super::{GlueError, GlueOptions, GluePlacement, GlueProblem, Going, NOTHING, ROUNDS};
use crate::global::{BALANCED, GlobalProblemError};
use crate::local::PROOF_TOLERANCE;
use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{self, NonnegativeConeT, SecondOrderConeT};
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver};
use nalgebra::{Vector3, Vector6};

/// Price of joints and normal forces where they only have to balance.
pub(super) const PRICE: f64 = 1e-3;

/// Chooses the joints as [`super::place`] does, with no bound on their strength.
pub fn place(pile: &GlueProblem, options: &GlueOptions, going: &mut Going) -> Result<GluePlacement, GlueError> {
    let program = GlueProgram::new(pile, &GlueOptions { strength: None, ..*options }, &vec![false; pile.bodies.len()])?;
    let allowed = program.allowed_sites();
    let mut weights = vec![1.0; allowed.len()];
    let mut state = solve(&program, &allowed, &weights, &|at| program.contacts[at].price, BALANCED)?;
    for e in ROUNDS {
        if going().is_break() {
            return Err(GlueError::Cancelled);
        }
        weights.iter_mut().zip(&state.joints).for_each(|(weight, joint)| *weight = e / (joint.norm() + e));
        state = solve(&program, &allowed, &weights, &|at| program.contacts[at].price * e, BALANCED)?;
    }
    balanced(&program, &state.joints.iter().map(|joint| joint.norm() > NOTHING).collect::<Vec<_>>())
}

/// The placement of joints at these sites and no others; it stands if they suffice.
pub fn place_at(pile: &GlueProblem, options: &GlueOptions, joints: &[usize]) -> Result<GluePlacement, GlueError> {
    let program = GlueProgram::new(pile, options, &vec![false; pile.bodies.len()])?;
    balanced(&program, &(0..program.sites.len()).map(|site| joints.contains(&site)).collect::<Vec<_>>())
}

fn balanced(program: &GlueProgram, allowed: &[bool]) -> Result<GluePlacement, GlueError> {
    let state = balance(program, allowed)?;
    let mut left = Vec::new();
    program.imbalance(&state, &mut left);
    Ok(GluePlacement {
        joints: (0..allowed.len()).filter(|&site| allowed[site]).map(|site| program.joint(site, &state)).collect(),
        at_least: 0,
        fallen: Vec::new(),
        forces: program.forces(&state),
        imbalance: left.iter().map(|e| e.norm()).sum(),
        by_cone_program: true,
        iterations: 0,
    })
}

/// Forces that balance, with joints only where they may be. Shape of `allowed`: `[site]`.
pub(super) fn balance(program: &GlueProgram, allowed: &[bool]) -> Result<GlueForces, GlueError> {
    solve(program, allowed, &vec![PRICE; allowed.len()], &|_| PRICE, PROOF_TOLERANCE)
}

fn solve(
    program: &GlueProgram,
    allowed: &[bool],
    weights: &[f64],
    price: &dyn Fn(usize) -> f64,
    tolerance: f64,
) -> Result<GlueForces, GlueError> {
    let width = 6 * program.target.len();
    let is_joint = |t: usize| allowed[t] && program.sites[t].strength > 0.0;
    let mut bounded = Vec::new();
    let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
    let (mut rhs, mut cones): (Vec<f64>, Vec<SupportedConeT<f64>>) = (Vec::new(), Vec::new());
    let mut row = |entries: &mut dyn Iterator<Item = (usize, Vector6<f64>)>, bound: f64, rhs: &mut Vec<f64>| {
        for (body, column) in entries {
            for k in 0..6 {
                rows.push(rhs.len());
                columns.push(6 * body + k);
                values.push(column[k]);
            }
        }
        rhs.push(bound);
    };
    for (t, site) in program.sites.iter().enumerate().filter(|(_, site)| !site.ends().is_empty()) {
        for at in site.contacts.clone() {
            let mu = program.contacts[at].friction;
            for k in 0..if mu > 0.0 { 3 } else { 1 } {
                let scale = if k == 0 { 1.0 } else { mu };
                let ends = site.ends().iter().enumerate();
                let mut entries = ends
                    .map(|(number, end)| (end.body, program.lever(site, number, at).column(k).into_owned() * scale));
                row(&mut entries, if k == 0 { price(at) } else { 0.0 }, &mut rhs);
            }
            cones.push(if mu > 0.0 { SecondOrderConeT(3) } else { NonnegativeConeT(1) });
        }
        if is_joint(t) {
            if site.strength.is_finite() {
                bounded.push((rhs.len(), site.strength));
            }
            row(&mut std::iter::empty(), weights[t], &mut rhs);
            for k in 0..6 {
                let mut entries = site.ends().iter().map(|end| (end.body, end.joint_lever().column(k).into_owned()));
                row(&mut entries, 0.0, &mut rhs);
            }
            cones.push(SecondOrderConeT(7));
        }
    }
    let mut state = program.empty_state();
    if rhs.is_empty() || width == 0 {
        return Ok(state);
    }
    let mut q: Vec<f64> = program.target.iter().flat_map(|b| b.iter().map(|b| -b).collect::<Vec<_>>()).collect();
    for &(row, strength) in &bounded {
        rows.extend([row, rhs.len()]);
        columns.extend([q.len(), q.len()]);
        values.extend([-1.0, -1.0]);
        rhs.push(0.0);
        q.push(strength);
    }
    cones.push(NonnegativeConeT(bounded.len()));
    let width = q.len();
    let matrix = CscMatrix::new_from_triplets(rhs.len(), width, rows, columns, values);
    let settings = DefaultSettings {
        verbose: false,
        presolve_enable: false,
        tol_feas: tolerance,
        tol_gap_abs: tolerance,
        tol_gap_rel: tolerance,
        max_threads: 1,
        ..DefaultSettings::default()
    };
    let mut solver = DefaultSolver::new(&CscMatrix::zeros((width, width)), &q, &matrix, &rhs, &cones, settings)
        .map_err(|e| GlobalProblemError::Solver(e.to_string()))?;
    solver.solve();
    let mut z = solver.solution.z.iter().map(|z| if z.is_finite() { *z } else { 0.0 });
    let mut next = || z.next().unwrap_or(0.0);
    for (t, site) in program.sites.iter().enumerate().filter(|(_, site)| !site.ends().is_empty()) {
        for at in site.contacts.clone() {
            let mu = program.contacts[at].friction;
            let force =
                if mu > 0.0 { Vector3::new(next(), mu * next(), mu * next()) } else { Vector3::new(next(), 0.0, 0.0) };
            // An interior point may end a rounding outside its cone.
            state.contacts[at] = super::admm::onto_cone(force, 0.0, mu);
        }
        if is_joint(t) {
            next();
            state.joints[t] = super::admm::capped(Vector6::from_fn(|_, _| next()), site.strength);
        }
    }
    Ok(state)
}
