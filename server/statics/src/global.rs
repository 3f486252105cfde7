//! Equilibrium of a whole pile, as one sparse cone program.
//!
//! The local analysis asks of each body alone whether its fixed neighbours could carry it. This asks whether *all*
//! bodies stand at once, each force on one body being the opposite force on its neighbour. It is the truth that the
//! local analysis is compared with, and costs two to three orders of magnitude more (Hsu & Keyser 2012, 3.2).
//!
//! # Formulation
//!
//! Unknown: a force f_c per contact c, acting on the contact's first body and reversed on its second (or on the
//! ground). Each body b has the imbalance
//!
//! ```text
//! e_b = ( g m_b + sum of forces,  sum of (p_c - c_b) x force / R_b ) / (m_b |g|)        in mg and mgR, R^6
//! ```
//!
//! (Eq. 1 for every body), and each f_c lies in Coulomb's cone (Eq. 2 to 4; exact, second-order). Equilibrium is e_b =
//! 0 for all b. A solver's tolerance decides nothing here: the program minimises imbalance, always has an answer, and
//! the answer is compared with [`BALANCED`].
//!
//! # Which imbalance is least: [`Objective`]
//!
//! - [`Objective::LeastSquares`], sum |e_b|^2. Unique, smooth, and it **smears**: a weight of 1 mg that nothing carries
//!   is shared among all bodies that touch each other under it; ten of them miss 0.1 mg each, and none seems at fault.
//!   As an upper threshold on each body's imbalance it is dishonest.
//! - [`Objective::SumOfNorms`], sum |e_b| (a group lasso). Its value is the total weight for which there is no support,
//!   in body weights, and cannot be made smaller by sharing. It sets most e_b to zero exactly. Where several bodies
//!   could equally well be the one at fault it leaves the choice open, and an interior point then answers with the
//!   middle. `sharpen` rounds of reweighting (weights 1/(|e_b| + [`SHARPEN`]); Candes, Wakin & Boyd 2008) settle such
//!   ties on few bodies.
//!
//! For "what share of the bodies is not supported" use `SumOfNorms` with two rounds, and report the total of the first
//! solve beside it: the total is unique, the share depends (within ties) on the rounds.
//!
//! # Certificate
//!
//! The multipliers u_b of the equations for e_b are a virtual motion of the whole pile: every admissible contact force
//! does work >= 0 with it, and gravity does work equal to the least imbalance. If that is positive there is no
//! equilibrium, and the motion is how the collapse begins. [`Balance::bound`] is that work by substitution: a lower
//! bound on the total imbalance of any distribution of forces (whose normal forces do not sum to more than those
//! found).

use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{self, NonnegativeConeT, SecondOrderConeT, ZeroConeT};
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus};
use glam::DVec3;

use crate::program::{Triplets, clip};

/// A pile whose total imbalance (sum of |e_b|) is at most this is in equilibrium. An interior point on a thousand
/// bodies reaches 1e-7 with room; a boundary that matters (a hundredth of a block's overhang) lies at 1e-3.
pub const BALANCED: f64 = 1e-5;

/// In a round of [`Objective::SumOfNorms`], imbalances well below this (in mg) count as zero.
pub const SHARPEN: f64 = 1e-2;

/// A body of the pile that has to be carried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlobalBody {
    /// > 0.
    pub mass: f64,
    pub center_of_mass: DVec3,
    /// Bounding radius, > 0.
    pub radius: f64,
}

/// A contact point between two bodies, or a body and the ground (or anything else that is fixed).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlobalContact {
    /// Index of the body that `normal` points into.
    pub body: usize,
    /// The other body; `None` for the ground.
    pub other: Option<usize>,
    pub point: DVec3,
    pub normal: DVec3,
    /// Coulomb's coefficient, >= 0.
    pub friction: f64,
}

/// The pile. Any consistent unit system.
#[derive(Clone, Copy, Debug)]
pub struct GlobalProblem<'a> {
    pub bodies: &'a [GlobalBody],
    pub contacts: &'a [GlobalContact],
    pub gravity: DVec3,
}

/// The function that the best distribution of forces minimises.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Objective {
    /// Sum of squared imbalances.
    LeastSquares,
    /// Sum of imbalances, then this number of rounds of reweighting.
    SumOfNorms { sharpen: u32 },
}

impl Default for Objective {
    fn default() -> Self {
        Objective::SumOfNorms { sharpen: 0 }
    }
}

/// The best distribution of forces, and its imbalance.
#[derive(Clone, Debug, PartialEq)]
pub struct Balance {
    /// Per body |e_b|, by substitution of the forces; a body in free fall has 1.
    pub imbalance: Vec<f64>,
    /// Per contact, on its `body`, in newtons (or the unit of mass times gravity). Within friction to rounding.
    pub forces: Vec<DVec3>,
    /// Sum of `imbalance` before any round of sharpening.
    pub total: f64,
    /// Lower bound on the total imbalance of any forces, by the certificate; zero where it proves nothing.
    pub bound: f64,
    /// False if the solver stopped short of its tolerance; the figures above are substituted and hold all the same, but
    /// better forces may exist (compare `total` and `bound`).
    pub converged: bool,
}

impl Balance {
    /// Every body is in equilibrium.
    pub fn stands(&self) -> bool {
        self.total <= BALANCED
    }

    /// Share of the bodies whose imbalance exceeds `threshold`, in mg.
    pub fn unsupported_fraction(&self, threshold: f64) -> f64 {
        let unsupported = self.imbalance.iter().filter(|e| **e > threshold).count();
        if unsupported == 0 { 0.0 } else { unsupported as f64 / self.imbalance.len() as f64 }
    }

    /// The body that misses most: the first to fail. `None` if the pile stands.
    pub fn worst(&self) -> Option<usize> {
        let largest = self.imbalance.iter().copied().fold(0.0, f64::max);
        if self.stands() { None } else { self.imbalance.iter().position(|e| *e == largest) }
    }
}

/// Input without physical meaning; bodies and contacts by index.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GlobalProblemError {
    #[error("gravity is zero or not finite")]
    Gravity,
    #[error("body {0}: mass or radius is not a positive number, or its centre is not finite")]
    Body(usize),
    #[error("contact {0}: point, normal or friction is not finite, the normal is zero, or friction is negative")]
    Contact(usize),
    #[error("contact {0} names a body that does not exist, or one body twice")]
    Index(usize),
    #[error("the cone solver refused the program: {0}")]
    Solver(String),
}

/// Finds the best distribution of contact forces.
pub fn analyse(pile: &GlobalProblem, objective: Objective) -> Result<Balance, GlobalProblemError> {
    let program = BalanceProgram::new(pile)?;
    let mut weights = vec![1.0; pile.bodies.len()];
    let mut report = program.solve(objective, &weights)?;
    if let Objective::SumOfNorms { sharpen } = objective {
        for _ in 0..sharpen {
            if report.stands() {
                break;
            }
            for (w, e) in weights.iter_mut().zip(&report.imbalance) {
                *w = SHARPEN / (e + SHARPEN);
            }
            let sharper = program.solve(objective, &weights)?;
            report = Balance { total: report.total, bound: report.bound, ..sharper };
        }
    }
    Ok(report)
}

/// A contact without units: normal component and two tangents, and the lever arms on both ends.
pub(crate) struct LinkEnd {
    pub body: usize,
    /// +1 for the body that the normal points into, -1 for the other.
    pub sign: f64,
    /// In radii of that body.
    pub lever: DVec3,
    /// Force unit / this body's weight.
    pub scale: f64,
}

pub(crate) struct Link {
    pub axes: [DVec3; 3],
    pub mu: f64,
    /// The unit of this contact's force: the lighter body's weight, so that the columns are of one size.
    pub unit: f64,
    pub ends: Vec<LinkEnd>,
}

pub(crate) struct BalanceProgram<'a> {
    pile: &'a GlobalProblem<'a>,
    pub links: Vec<Link>,
    /// Unit vector of gravity.
    down: DVec3,
}

/// Refuses a pile without physical meaning.
pub fn check(pile: &GlobalProblem) -> Result<(), GlobalProblemError> {
    BalanceProgram::new(pile).map(|_| ())
}

impl<'a> BalanceProgram<'a> {
    pub fn new(pile: &'a GlobalProblem<'a>) -> Result<Self, GlobalProblemError> {
        let g = pile.gravity.length();
        if !(g > 0.0 && g.is_finite()) {
            return Err(GlobalProblemError::Gravity);
        }
        for (i, b) in pile.bodies.iter().enumerate() {
            let positive = |x: f64| x > 0.0 && x.is_finite();
            if !(positive(b.mass) && positive(b.mass * g) && positive(b.radius) && b.center_of_mass.is_finite()) {
                return Err(GlobalProblemError::Body(i));
            }
        }
        let links = pile.contacts.iter().enumerate().map(|(i, c)| link(pile, g, i, c)).collect::<Result<_, _>>()?;
        Ok(BalanceProgram { pile, links, down: pile.gravity / g })
    }

    /// Unknowns: forces (3 per contact), then e (6 per body), then for the sum of norms t (1 per body), t_b >= |e_b|.
    fn solve(&self, objective: Objective, weights: &[f64]) -> Result<Balance, GlobalProblemError> {
        let (contacts, bodies) = (self.links.len(), weights.len());
        if bodies == 0 {
            return Ok(Balance { imbalance: vec![], forces: vec![], total: 0.0, bound: 0.0, converged: true });
        }
        let norms = objective != Objective::LeastSquares;
        let (e0, t0) = (3 * contacts, 3 * contacts + 6 * bodies);
        let width = t0 + if norms { bodies } else { 0 };
        let mut a = Triplets::default();
        let mut cones: Vec<SupportedConeT<f64>> = vec![ZeroConeT(6 * bodies)];
        let b = self.balance(&mut a, e0);
        self.friction(&mut a, &mut cones);
        let mut q = vec![0.0; width];
        let p = if norms {
            for (k, weight) in weights.iter().enumerate() {
                a.push(a.height, t0 + k, -1.0);
                (0..6).for_each(|m| a.push(a.height + 1 + m, e0 + 6 * k + m, -1.0));
                a.height += 7;
                cones.push(SecondOrderConeT(7));
                q[t0 + k] = *weight;
            }
            CscMatrix::zeros((width, width))
        } else {
            let diagonal: Vec<usize> = (e0..t0).collect();
            CscMatrix::new_from_triplets(width, width, diagonal.clone(), diagonal, vec![1.0; t0 - e0])
        };
        let mut rhs = b;
        rhs.resize(a.height, 0.0);
        let matrix = CscMatrix::new_from_triplets(a.height, width, a.rows, a.columns, a.values);
        let settings =
            DefaultSettings { verbose: false, presolve_enable: false, max_threads: 1, ..DefaultSettings::default() };
        let mut solver = DefaultSolver::new(&p, &q, &matrix, &rhs, &cones, settings)
            .map_err(|e| GlobalProblemError::Solver(e.to_string()))?;
        solver.solve();
        let converged = matches!(solver.solution.status, SolverStatus::Solved);
        Ok(self.report(&solver.solution.x, &solver.solution.z, converged))
    }

    /// Rows e_b - (forces) = weight, for all bodies; returns the right-hand end.
    fn balance(&self, a: &mut Triplets, e0: usize) -> Vec<f64> {
        let bodies = self.pile.bodies.len();
        let mut b = vec![0.0; 6 * bodies];
        for k in 0..bodies {
            (0..6).for_each(|m| a.push(6 * k + m, e0 + 6 * k + m, 1.0));
            b[6 * k..6 * k + 3].copy_from_slice(&self.down.to_array());
        }
        self.contact_forces(a);
        b
    }

    /// What the contact forces do to each body, with the sign of the left-hand side.
    pub fn contact_forces(&self, a: &mut Triplets) {
        for (i, link) in self.links.iter().enumerate() {
            for end in &link.ends {
                for (k, axis) in link.axes.iter().enumerate() {
                    let force = end.sign * end.scale * *axis;
                    let torque = end.lever.cross(force);
                    for m in 0..3 {
                        a.push(6 * end.body + m, 3 * i + k, -force[m]);
                        a.push(6 * end.body + 3 + m, 3 * i + k, -torque[m]);
                    }
                }
            }
        }
        a.height = 6 * self.pile.bodies.len();
    }

    /// (mu fn, ft1, ft2) in the second-order cone; without friction fn >= 0 and ft = 0.
    pub fn friction(&self, a: &mut Triplets, cones: &mut Vec<SupportedConeT<f64>>) {
        for (i, link) in self.links.iter().enumerate() {
            let row = a.height;
            a.push(row, 3 * i, if link.mu > 0.0 { -link.mu } else { -1.0 });
            a.push(row + 1, 3 * i + 1, -1.0);
            a.push(row + 2, 3 * i + 2, -1.0);
            if link.mu > 0.0 {
                cones.push(SecondOrderConeT(3));
            } else {
                cones.extend([NonnegativeConeT(1), ZeroConeT(2)]);
            }
            a.height += 3;
        }
    }

    /// Clips the forces into their cones and substitutes; checks the multipliers the same way.
    fn report(&self, x: &[f64], z: &[f64], converged: bool) -> Balance {
        let (forces, imbalance, normal_forces) = self.substituted(x);
        let total = imbalance.iter().sum();
        Balance { bound: self.bound(z, normal_forces).clamp(0.0, total), imbalance, forces, total, converged }
    }

    /// The forces, clipped into their cones; what they leave of each body, in its weight; the sum of the normal forces,
    /// each in the weight of the lighter body.
    pub fn substituted(&self, x: &[f64]) -> (Vec<DVec3>, Vec<f64>, f64) {
        let bodies = self.pile.bodies.len();
        let mut left: Vec<(DVec3, DVec3)> = vec![(self.down, DVec3::ZERO); bodies];
        let mut normal_forces = 0.0;
        let mut forces = Vec::with_capacity(self.links.len());
        for (i, link) in self.links.iter().enumerate() {
            let f = clip(&x[3 * i..3 * i + 3], link.mu);
            normal_forces += f[0];
            let force = f[0] * link.axes[0] + f[1] * link.axes[1] + f[2] * link.axes[2];
            for end in &link.ends {
                let on_body = end.sign * end.scale * force;
                left[end.body].0 += on_body;
                left[end.body].1 += end.lever.cross(on_body);
            }
            forces.push(link.unit * force);
        }
        let imbalance = left.iter().map(|(f, t)| (f.length_squared() + t.length_squared()).sqrt()).collect();
        (forces, imbalance, normal_forces)
    }

    /// Substitutes the multipliers. For any u with |u_b| <= 1, sum |e_b| >= sum u_b . e_b = gravity's work + the
    /// contacts' work; the latter is at least `worst` times the sum of normal forces, `worst` being zero in exact
    /// arithmetic.
    fn bound(&self, z: &[f64], normal_forces: f64) -> f64 {
        let multiplier = |c: &[f64]| (-DVec3::from_slice(c), -DVec3::from_slice(&c[3..]));
        let u: Vec<(DVec3, DVec3)> = z[..6 * self.pile.bodies.len()].chunks_exact(6).map(multiplier).collect();
        let largest = u.iter().map(|(f, t)| (f.length_squared() + t.length_squared()).sqrt()).fold(0.0, f64::max);
        if !(largest > 0.0 && z.iter().all(|z| z.is_finite())) {
            return 0.0;
        }
        let gravity: f64 = u.iter().map(|(f, _)| f.dot(self.down)).sum();
        (gravity + self.worst_work(&u) * normal_forces) / largest
    }

    /// The least work, at most 0, that a contact's force of normal component 1 may do with a motion of the bodies:
    /// velocity, and angular velocity by the radius.
    pub fn worst_work(&self, motion: &[(DVec3, DVec3)]) -> f64 {
        let work = self.links.iter().map(|link| {
            let of = |s: &LinkEnd| s.sign * s.scale * (motion[s.body].0 + motion[s.body].1.cross(s.lever));
            let velocity: DVec3 = link.ends.iter().map(of).sum();
            let normal = velocity.dot(link.axes[0]);
            normal - link.mu * (velocity - normal * link.axes[0]).length()
        });
        work.fold(0.0, f64::min)
    }
}

fn link(pile: &GlobalProblem, g: f64, index: usize, c: &GlobalContact) -> Result<Link, GlobalProblemError> {
    let exists = |b: usize| b < pile.bodies.len();
    if !exists(c.body) || c.other.is_some_and(|o| !exists(o) || o == c.body) {
        return Err(GlobalProblemError::Index(index));
    }
    let normal = c.normal.try_normalize().ok_or(GlobalProblemError::Contact(index))?;
    if !(c.point.is_finite() && c.friction >= 0.0 && c.friction.is_finite()) {
        return Err(GlobalProblemError::Contact(index));
    }
    let weight = |b: usize| pile.bodies[b].mass * g;
    let unit = c.other.map_or(weight(c.body), |o| weight(o).min(weight(c.body)));
    let end = |body: usize, sign: f64| LinkEnd {
        body,
        sign,
        lever: (c.point - pile.bodies[body].center_of_mass) / pile.bodies[body].radius,
        scale: unit / weight(body),
    };
    let ends: Vec<LinkEnd> = std::iter::once(end(c.body, 1.0)).chain(c.other.map(|o| end(o, -1.0))).collect();
    if ends.iter().any(|s: &LinkEnd| !s.lever.is_finite()) {
        return Err(GlobalProblemError::Contact(index));
    }
    let (t1, t2) = normal.any_orthonormal_pair();
    Ok(Link { axes: [normal, t1, t2], mu: c.friction, unit, ends })
}
