//! The reference: the same question as a cone program for Clarabel.
//!
//! Unknowns x = (fn_i, ft1_i, ft2_i) per contact, in the basis (n_i, t1_i, t2_i), forces by mg.
//!
//! ```text
//! find x with   A x = b                                     (Eq. 1; 6 rows, zero cone)
//! cone:         (mu fn_i, ft1_i, ft2_i) in the second-order cone, fn_i >= 0
//! pyramid:      m_k . ft_i <= apothem mu fn_i, fn_i >= 0     (Eq. 2 to 4; one row per side: a linear program)
//! ```
//!
//! The objective is zero: an interior-point method then ends near the middle of the feasible set. If there is no x,
//! the multiplier of the six equations is Farkas' certificate, minus the separator z of the module's documentation.

use super::scaled::{ScaledProblem, SolverOutcome, Tolerances, Vec6, norm};
use super::{FrictionLaw, PROOF_TOLERANCE};
use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{NonnegativeConeT, SecondOrderConeT, ZeroConeT};
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus};
use glam::DVec3;

/// Decides with Clarabel. `None`: no decision, or a decision that does not pass substitution.
pub(super) fn solve(scaled: &ScaledProblem, tolerances: Tolerances, forces: &mut Vec<DVec3>) -> Option<SolverOutcome> {
    let n = scaled.len();
    if n == 0 {
        return None;
    }
    let (rows, cones, height) = constraints(scaled);
    let mut b = vec![0.0; height];
    b[..6].copy_from_slice(&scaled.target());
    let a = CscMatrix::new_from_triplets(
        height,
        3 * n,
        rows.iter().map(|t| t.0).collect(),
        rows.iter().map(|t| t.1).collect(),
        rows.iter().map(|t| t.2).collect(),
    );
    let settings = DefaultSettings {
        verbose: false,
        presolve_enable: false,
        tol_feas: PROOF_TOLERANCE,
        tol_infeas_abs: PROOF_TOLERANCE,
        tol_infeas_rel: PROOF_TOLERANCE,
        max_threads: 1,
        ..DefaultSettings::default()
    };
    let p = CscMatrix::zeros((3 * n, 3 * n));
    let mut solver = DefaultSolver::new(&p, &vec![0.0; 3 * n], &a, &b, &cones, settings).ok()?;
    solver.solve();
    match solver.solution.status {
        SolverStatus::Solved | SolverStatus::AlmostSolved => stable(scaled, &solver.solution.x, tolerances, forces),
        SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => {
            unstable(scaled, &solver.solution.z, tolerances)
        }
        _ => None,
    }
}

fn stable(scaled: &ScaledProblem, x: &[f64], t: Tolerances, forces: &mut Vec<DVec3>) -> Option<SolverOutcome> {
    forces.clear();
    forces.extend(scaled.contacts().iter().zip(x.chunks_exact(3)).map(|(r, f)| f[0] * r.n + f[1] * r.t1 + f[2] * r.t2));
    let residual = scaled.residual_of(forces);
    (scaled.balances(residual, forces, t) && scaled.obeys_friction(forces, t))
        .then_some(SolverOutcome::Stable { residual })
}

fn unstable(scaled: &ScaledProblem, multipliers: &[f64], t: Tolerances) -> Option<SolverOutcome> {
    let y: Vec6 = std::array::from_fn(|k| -multipliers[k]);
    if !(norm(&y) > 0.0 && norm(&y).is_finite()) {
        return None;
    }
    let certificate = scaled.certificate(y);
    certificate.proves(t).then_some(SolverOutcome::Unstable(certificate))
}

/// (row, column, value).
type Triplet = (usize, usize, f64);
type Cone = clarabel::solver::SupportedConeT<f64>;

/// Clarabel's form, A x + s = b with s in the cones: A, the cones, and the number of rows.
fn constraints(scaled: &ScaledProblem) -> (Vec<Triplet>, Vec<Cone>, usize) {
    let mut t: Vec<Triplet> = Vec::new();
    let mut cones: Vec<Cone> = vec![ZeroConeT(6)];
    let mut row = 6;
    for (i, c) in scaled.contacts().iter().enumerate() {
        for (k, axis) in [c.n, c.t1, c.t2].into_iter().enumerate() {
            let w = c.wrench(axis);
            t.extend((0..6).map(|m| (m, 3 * i + k, w[m])));
        }
        let mu = scaled.mu(c);
        t.push((row, 3 * i, -1.0));
        cones.push(NonnegativeConeT(1));
        row += 1;
        match scaled.law() {
            _ if mu == 0.0 => {
                t.push((row, 3 * i + 1, 1.0));
                t.push((row + 1, 3 * i + 2, 1.0));
                cones.push(ZeroConeT(2));
                row += 2;
            }
            FrictionLaw::Cone => {
                t.push((row, 3 * i, -mu));
                t.push((row + 1, 3 * i + 1, -1.0));
                t.push((row + 2, 3 * i + 2, -1.0));
                cones.push(SecondOrderConeT(3));
                row += 3;
            }
            FrictionLaw::Pyramid { .. } => {
                let faces = scaled.polygon().faces();
                for m in faces {
                    t.push((row, 3 * i, -scaled.polygon().apothem * mu));
                    t.push((row, 3 * i + 1, m[0]));
                    t.push((row, 3 * i + 2, m[1]));
                    row += 1;
                }
                cones.push(NonnegativeConeT(faces.len()));
            }
        }
    }
    (t, cones, row)
}
