//! The factor by which a load may grow until a pile falls: limit analysis (Livesley 1978), with Coulomb's cones.
//!
//! # Formulation
//!
//! Each body b carries a *dead* load d_b and a *live* load l_b, each a force and a moment about its centre of mass.
//! With the contact forces f_c of [`crate::global`],
//!
//! ```text
//! maximise    t
//! such that   contact forces + d_b + t l_b = 0  for every body,   f_c in Coulomb's cone,   t <= most
//! ```
//!
//! The forces that balance t1 and those that balance t2 balance all between in their mean: what stands at 0 and at t
//! stands everywhere between. A tilt of the ground is a live load: [`shake`].
//!
//! # Two proofs
//!
//! The dual is a virtual motion v of all bodies, at which no contact closes or slips against its friction and the live
//! load does work. It proves that no forces carry more than t = -(work of d) / (work of l) (the kinematic theorem), and
//! the forces prove that the pile stands up to t (the static theorem). Both are substituted: [`Limit::stands_to`] by
//! the balance that the forces leave, [`Limit::falls_from`] by the work at each contact. Clarabel's word counts for
//! neither.
//!
//! Coulomb's law is not associated: a block that slides does not rise by the friction angle, as v does. So forces up to
//! t prove that the pile *can* stand, not that it must (it may depend on how its contacts were loaded before), while
//! above t nothing can stand.
//!
//! A normal force has a small price ([`PRICE`]), so that a wedge, whose forces may be as large as they like, has an
//! answer.

use crate::global::{BALANCED, BalanceProgram, GlobalBody, GlobalContact, GlobalProblem, GlobalProblemError};
use crate::program::{Triplets, clip};
use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{self, NonnegativeConeT, SecondOrderConeT};
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver};
use glam::DVec3;

/// Price of a normal force of a body's weight, where a factor of 1 is worth the number of bodies. Forces beyond the
/// inverse of this are not found.
pub const PRICE: f64 = 1e-6;

/// A motion does work with a load if it is more than this share of the load's weight: less is rounding.
const WORKS: f64 = 1e-4;

/// Accuracy that is asked of Clarabel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Accuracy {
    /// As much as it has: for many bodies.
    #[default]
    Fine,
    /// Half the time. What it leaves unbalanced is substituted all the same.
    Fast,
}

impl Accuracy {
    fn settings(self) -> DefaultSettings<f64> {
        let usual = DefaultSettings { verbose: false, presolve_enable: false, max_threads: 1, ..Default::default() };
        let of = |tolerance: f64| DefaultSettings {
            tol_feas: tolerance,
            tol_gap_abs: tolerance,
            tol_gap_rel: tolerance,
            ..usual.clone()
        };
        match self {
            Accuracy::Fine => of(1e-9),
            // Its own corrections of each linear solve take most of its time.
            Accuracy::Fast => DefaultSettings {
                iterative_refinement_max_iter: 3,
                iterative_refinement_reltol: 1e-10,
                iterative_refinement_abstol: 1e-10,
                max_iter: 60,
                ..of(1e-8)
            },
        }
    }
}

/// A force, and a moment about the centre of mass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load {
    pub force: DVec3,
    pub moment: DVec3,
}

impl Load {
    /// In the body's weight, and weight times radius.
    pub(crate) fn in_weights(&self, body: &GlobalBody, gravity: f64) -> Load {
        let weight = body.mass * gravity;
        Load { force: self.force / weight, moment: self.moment / (weight * body.radius) }
    }
}

/// A pile with its loads; any consistent unit system. Gravity is a unit here, and no load.
#[derive(Clone, Copy, Debug)]
pub struct LimitProblem<'a> {
    pub bodies: &'a [GlobalBody],
    pub contacts: &'a [GlobalContact],
    /// Length of gravity, > 0.
    pub gravity: f64,
    /// Shape `[body]`.
    pub dead: &'a [Load],
    pub live: &'a [Load],
    /// Larger factors are not sought.
    pub most: f64,
    pub accuracy: Accuracy,
}

/// The limit, between its two proofs.
#[derive(Clone, Debug, PartialEq)]
pub struct Limit {
    /// The pile stands under this factor, by `forces`; `None` where no forces balance it.
    pub stands_to: Option<f64>,
    /// Under a larger factor it cannot stand, by `motion`; infinite where nothing proves that.
    pub falls_from: f64,
    /// On each contact's `body`.
    pub forces: Vec<DVec3>,
    /// Sum over the bodies of what these leave, in each body's weight.
    pub imbalance: f64,
    /// How each body begins to move at the limit: velocity, and angular velocity by its radius; the fastest has 1.
    /// Zero where nothing moves.
    pub motion: Vec<(DVec3, DVec3)>,
}

/// A body whose motion is less than this share of the fastest one's does not take part in a collapse.
const TAKES_PART: f64 = 1e-3;

impl Limit {
    /// Bodies that move at the limit, ascending.
    pub fn moving(&self) -> impl Iterator<Item = usize> + '_ {
        let moves = |(v, w): &(DVec3, DVec3)| v.length().max(w.length()) > TAKES_PART;
        self.motion.iter().enumerate().filter(move |(_, motion)| moves(motion)).map(|(body, _)| body)
    }

    /// The work of a load with the motion, in each body's weight times the fastest motion.
    pub fn work(&self, bodies: &[GlobalBody], gravity: f64, load: &[Load]) -> f64 {
        let work = |((body, load), (v, w)): ((&GlobalBody, &Load), &(DVec3, DVec3))| {
            (v.dot(load.force) + w.dot(load.moment) / body.radius) / (body.mass * gravity)
        };
        bodies.iter().zip(load).zip(&self.motion).map(work).sum()
    }

    /// Whether the pile is proven to stand under this factor.
    pub fn reaches(&self, factor: f64) -> bool {
        self.stands_to.is_some_and(|t| t >= factor * (1.0 - BALANCED))
    }
}

/// The weight of each body.
pub fn weights(bodies: &[GlobalBody], gravity: DVec3) -> Vec<Load> {
    bodies.iter().map(|body| Load { force: body.mass * gravity, moment: DVec3::ZERO }).collect()
}

/// A live load that pushes every body by its mass along `way`, a unit vector across gravity: the factor is then the
/// acceleration of the ground against it, in g, and the tangent of the angle by which the ground may be tilted.
pub fn shake(bodies: &[GlobalBody], gravity: f64, way: DVec3) -> Vec<Load> {
    bodies.iter().map(|body| Load { force: body.mass * gravity * way, moment: DVec3::ZERO }).collect()
}

/// Whether forces that leave so much balance a pile: as for glue, per thousand bodies where there are more.
fn is_balance(imbalance: f64, bodies: usize) -> bool {
    imbalance.is_finite() && imbalance <= BALANCED * (bodies as f64 / 1000.0).max(1.0)
}

/// Finds the limit.
pub fn find(problem: &LimitProblem) -> Result<Limit, GlobalProblemError> {
    let &LimitProblem { bodies, contacts, gravity, dead, live, most, accuracy } = problem;
    let pile = GlobalProblem { bodies, contacts, gravity: gravity * DVec3::NEG_Y };
    let program = BalanceProgram::new(&pile)?;
    let scaled = |loads: &[Load]| -> Vec<f64> {
        let scaled = |(body, load): (&GlobalBody, &Load)| {
            let Load { force, moment } = load.in_weights(body, gravity);
            [force.to_array(), moment.to_array()]
        };
        bodies.iter().zip(loads).flat_map(scaled).flatten().collect()
    };
    let (dead, live) = (scaled(dead), scaled(live));
    let width = 6 * bodies.len();
    let worth = bodies.len().max(1) as f64;

    // Unknown: v. Clarabel: b - A v in the cones.
    let mut a = Triplets::default();
    let (mut cones, mut rhs): (Vec<SupportedConeT<f64>>, Vec<f64>) = (Vec::new(), Vec::new());
    for link in &program.links {
        let rows = if link.mu > 0.0 { 3 } else { 1 };
        for (k, axis) in link.axes.iter().enumerate().take(rows) {
            let scale = if k == 0 { 1.0 } else { link.mu };
            for end in &link.ends {
                let force = end.sign * end.scale * scale * *axis;
                let torque = end.lever.cross(force);
                for m in 0..3 {
                    a.push(a.height, 6 * end.body + m, -force[m]);
                    a.push(a.height, 6 * end.body + 3 + m, -torque[m]);
                }
            }
            a.height += 1;
            rhs.push(if k == 0 { PRICE } else { 0.0 });
        }
        cones.push(if link.mu > 0.0 { SecondOrderConeT(3) } else { NonnegativeConeT(1) });
    }
    // worth - v . l >= 0; its multiplier is what is missing from `most`.
    live.iter().enumerate().filter(|(_, l)| **l != 0.0).for_each(|(k, l)| a.push(a.height, k, *l));
    a.height += 1;
    rhs.push(worth);
    cones.push(NonnegativeConeT(1));
    let q: Vec<f64> = dead.iter().zip(&live).map(|(d, l)| -d - most * l).collect();
    let matrix = CscMatrix::new_from_triplets(a.height, width, a.rows, a.columns, a.values);
    let mut solver =
        DefaultSolver::new(&CscMatrix::zeros((width, width)), &q, &matrix, &rhs, &cones, accuracy.settings())
            .map_err(|e| GlobalProblemError::Solver(e.to_string()))?;
    solver.solve();
    let factor = most - solver.solution.z.last().copied().unwrap_or(most);
    let found = if factor.is_finite() { factor.min(most) } else { 0.0 };
    let loads = |t: f64| dead.iter().zip(&live).map(move |(d, l)| d + t * l).collect::<Vec<f64>>();

    let mut left = loads(found);
    let (mut next, mut normal_forces) = (0, 0.0);
    let mut forces = Vec::with_capacity(program.links.len());
    for link in &program.links {
        let z = |k: usize| solver.solution.z.get(next + k).copied().unwrap_or(0.0);
        let f = if link.mu > 0.0 { [z(0), link.mu * z(1), link.mu * z(2)] } else { [z(0), 0.0, 0.0] };
        next += if link.mu > 0.0 { 3 } else { 1 };
        // An interior point may end a rounding outside its cone.
        let f = clip(&f, link.mu);
        normal_forces += f[0];
        let force = f[0] * link.axes[0] + f[1] * link.axes[1] + f[2] * link.axes[2];
        for end in &link.ends {
            let on_body = end.sign * end.scale * force;
            let torque = end.lever.cross(on_body);
            for m in 0..3 {
                left[6 * end.body + m] += on_body[m];
                left[6 * end.body + 3 + m] += torque[m];
            }
        }
        forces.push(link.unit * force);
    }
    let imbalance: f64 = left.chunks_exact(6).map(|e| e.iter().map(|e| e * e).sum::<f64>().sqrt()).sum();
    let stands = is_balance(imbalance, bodies.len());

    let v: Vec<(DVec3, DVec3)> =
        solver.solution.x.chunks_exact(6).map(|v| (DVec3::from_slice(v), DVec3::from_slice(&v[3..]))).collect();
    let finite = v.len() == bodies.len() && v.iter().all(|(f, t)| f.is_finite() && t.is_finite());
    let fastest = v.iter().map(|(f, t)| f.length().max(t.length())).fold(0.0, f64::max);
    let (mut falls_from, mut motion) = (f64::INFINITY, vec![(DVec3::ZERO, DVec3::ZERO); bodies.len()]);
    if finite && fastest > 0.0 {
        let worst = program.worst_work(&v);
        let work = |load: &[f64]| -> f64 {
            let parts = v.iter().zip(load.chunks_exact(6));
            parts.map(|((f, t), l)| f.dot(DVec3::from_slice(l)) + t.dot(DVec3::from_slice(&l[3..]))).sum()
        };
        let (of_dead, of_live) = (work(&dead), work(&live));
        // A motion that is all rounding proves nothing.
        if of_live > WORKS * worth {
            falls_from = (-of_dead - worst * normal_forces) / of_live;
            motion = v.iter().map(|(f, t)| (*f / fastest, *t / fastest)).collect();
        } else if of_dead - most * of_live.abs() > WORKS * worth {
            falls_from = f64::NEG_INFINITY;
            motion = v.iter().map(|(f, t)| (*f / fastest, *t / fastest)).collect();
        }
    }
    // The two proofs may cross by a rounding.
    let falls_from = if stands { falls_from.max(found) } else { falls_from };
    Ok(Limit { stands_to: stands.then_some(found), falls_from, forces, imbalance, motion })
}
