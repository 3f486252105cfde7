//! The group lasso by operator splitting (ADMM; Boyd et al. 2011, section 3): forces that balance every body and forces
//! that each obey their own law are drawn together.

use super::factor::{Factor, Mobility, Workspace};
use super::program::{GlueForces, GlueProgram};
use super::{GlueError, Going, MINOR};
use nalgebra::{SVector, Vector3, Vector6};

/// Iterations of a run.
#[derive(Clone, Copy, Debug)]
pub struct IterationLimits {
    pub least: u64,
    pub most: u64,
}

/// The first run, from zero, and those that continue from it.
pub const FIRST: IterationLimits = IterationLimits { least: 200, most: 1200 };
pub const NEXT: IterationLimits = IterationLimits { least: 100, most: 600 };
/// [`NEXT`] for piles of at most [`SMALL`] bodies.
pub const NEXT_SMALL: IterationLimits = IterationLimits { least: 600, most: 600 };
/// In a pile of no more bodies, balance does not show whether the choice is settled.
pub const SMALL: usize = 100;
/// A run that only chooses looks at its choice after so many iterations, and ends once at most [`CHANGED`] of the
/// joints have come or gone in each of [`STEADY`] looks in a row: the choice settles long before the forces balance.
const LOOK_AT_CHOICE: u64 = 25;
const CHANGED: f64 = 0.01;
const STEADY: u32 = 2;

/// A run that only chooses ends once the mean imbalance of the forces that obey their laws is less than this, in a
/// body's weight.
pub const NEAR: f64 = 2e-3;
/// Each new point is this far beyond the projection.
const RELAXATION: f64 = 1.6;
/// Iterations of conjugate gradients in each projection, which end by [`MINOR`]: the next one starts from its answer.
const INNER: usize = 6;
/// Iterations between two looks at the residuals and the balance: each takes time of its own.
const LOOK: u64 = 50;
/// The penalty is changed where the two residuals differ by more than this factor (Boyd et al. 2011, section 3.4.1).
const UNEVEN: f64 = 5.0;

/// The price of each unknown.
pub struct GlueWeights {
    /// Of the norm of each joint. Shape `[site]`.
    pub joints: Vec<f64>,
    /// Of each normal force. Shape `[contact]`.
    pub normals: Vec<f64>,
    /// Of half the square of each contact force.
    pub squares: f64,
    /// Of the norm of each body's missing support, shape `[body]`; empty: every body must be balanced.
    pub missing: Vec<f64>,
}

impl GlueWeights {
    pub fn even(program: &GlueProgram, normal: f64, may_miss: bool) -> GlueWeights {
        let missing = vec![1.0; if may_miss { program.target.len() } else { 0 }];
        let normals = vec![normal; program.contacts.len()];
        GlueWeights { joints: vec![1.0; program.sites.len()], normals, squares: 0.0, missing }
    }

    /// The problem's own prices, normal forces at a share of theirs.
    pub fn of(program: &GlueProgram, share: f64) -> GlueWeights {
        let mut weights = GlueWeights::even(program, 0.0, false);
        weights.price(program, share);
        weights
    }

    /// Normal forces cost a share of their price.
    pub fn price(&mut self, program: &GlueProgram, share: f64) {
        self.normals.iter_mut().zip(&program.contacts).for_each(|(weight, contact)| *weight = contact.price * share);
    }

    /// The less a joint carries, the higher its price.
    pub fn reweight(&mut self, joints: &[Vector6<f64>], e: f64) {
        self.joints.iter_mut().zip(joints).for_each(|(weight, joint)| *weight = e / (joint.norm() + e));
    }

    /// The less support a body misses, the higher its price.
    pub fn reweight_missing(&mut self, missing: &[Vector6<f64>], e: f64) {
        self.missing.iter_mut().zip(missing).for_each(|(weight, missing)| *weight = e / (missing.norm() + e));
    }
}

/// A solve under way.
pub struct Admm<'p> {
    pub program: &'p GlueProgram<'p>,
    allowed: Vec<bool>,
    factor: Factor,
    /// Obeys every law.
    pub state: GlueForces,
    /// Scaled dual variable: the sum of the differences between the two kinds of forces.
    dual: GlueForces,
    /// Forces minus the scaled dual: the right-hand side of the projection.
    point: GlueForces,
    /// Multipliers of the balance.
    multipliers: Vec<Vector6<f64>>,
    penalty: f64,
    pub iterations: u64,
    is_elastic: bool,
    work: Workspace,
    left: Vec<Vector6<f64>>,
}

impl<'p> Admm<'p> {
    /// `allowed`: which sites may be glued, shape `[site]`. `is_elastic`: bodies may miss support.
    pub fn new(program: &'p GlueProgram<'p>, allowed: &[bool], is_elastic: bool) -> Admm<'p> {
        let mobility = Mobility {
            contacts: vec![1.0; program.pile.contacts.len()],
            joints: allowed.iter().map(|&is_allowed| f64::from(u8::from(is_allowed))).collect(),
            missing: f64::from(u8::from(is_elastic)),
        };
        Admm {
            program,
            allowed: allowed.to_vec(),
            factor: Factor::new(program, &mobility),
            state: program.empty_state(),
            dual: program.empty_state(),
            point: program.empty_state(),
            multipliers: vec![Vector6::zeros(); program.target.len()],
            penalty: 1.0,
            iterations: 0,
            is_elastic,
            work: Workspace::default(),
            left: Vec::new(),
        }
    }

    /// Begins at a state.
    pub fn take(&mut self, state: GlueForces) {
        self.state = state;
        for (joint, _) in self.state.joints.iter_mut().zip(&self.allowed).filter(|(_, is_allowed)| !**is_allowed) {
            *joint = Vector6::zeros();
        }
        self.state.missing.fill(Vector6::zeros());
    }

    /// Iterates until the mean imbalance of the bodies is less than `near`.
    pub fn run(
        &mut self,
        weights: &GlueWeights,
        limits: IterationLimits,
        near: f64,
        going: &mut Going,
    ) -> Result<(), GlueError> {
        self.run_until(weights, limits, near, |_, _| false, going)
    }

    /// Iterates until the joints that carry more than `least` are settled, or as [`Admm::run`] to [`NEAR`].
    pub fn settle(
        &mut self,
        weights: &GlueWeights,
        limits: IterationLimits,
        least: f64,
        going: &mut Going,
    ) -> Result<(), GlueError> {
        let (mut before, mut steady) = (self.joints(least), 0);
        let is_settled = |admm: &Self, k: u64| {
            if !k.is_multiple_of(LOOK_AT_CHOICE) {
                return false;
            }
            let now = admm.joints(least);
            let changed = different(&before, &now);
            steady = if changed as f64 <= CHANGED * now.len() as f64 { steady + 1 } else { 0 };
            before = now;
            steady == STEADY
        };
        self.run_until(weights, limits, NEAR, is_settled, going)
    }

    /// As [`Admm::run`], or until `ends` after that many iterations.
    fn run_until(
        &mut self,
        weights: &GlueWeights,
        limits: IterationLimits,
        near: f64,
        mut ends: impl FnMut(&Self, u64) -> bool,
        going: &mut Going,
    ) -> Result<(), GlueError> {
        for k in 1..=limits.most {
            if going().is_break() {
                return Err(GlueError::Cancelled);
            }
            let (apart, moved) = self.iterate(weights);
            if k % LOOK == 0 {
                self.even_out(apart, moved * self.penalty);
                if k >= limits.least && self.unbalanced() < near {
                    break;
                }
            }
            if ends(self, k) {
                break;
            }
        }
        Ok(())
    }

    /// Sites whose joint carries more than this, ascending.
    pub fn joints(&self, least: f64) -> Vec<usize> {
        let joints = &self.state.joints;
        (0..joints.len()).filter(|&site| joints[site].norm() > least).collect()
    }

    /// Mean imbalance of the bodies.
    fn unbalanced(&mut self) -> f64 {
        self.program.imbalance(&self.state, &mut self.left);
        self.left.iter().map(|e| e.norm()).sum::<f64>() / self.left.len().max(1) as f64
    }

    /// Imbalance of each body on the contact forces alone. Shape `[body]`.
    pub fn left_by_contacts(&mut self) -> Vec<f64> {
        self.program.imbalance(&self.state, &mut self.left);
        self.left.iter().zip(&self.state.missing).map(|(left, missing)| (left + missing).norm()).collect()
    }

    /// Bodies that miss more support than `least`, and at least half as much as the one that misses most.
    pub fn missing(&self, least: f64) -> Vec<usize> {
        let missing = || self.state.missing.iter().map(|e| e.norm()).enumerate();
        let most = missing().map(|(_, e)| e).fold(0.0, f64::max);
        missing().filter(|(_, e)| *e > least && *e >= 0.5 * most).map(|(body, _)| body).collect()
    }

    /// One iteration; returns the distance between the two kinds of forces, and how far those that obey their laws have
    /// moved.
    fn iterate(&mut self, weights: &GlueWeights) -> (f64, f64) {
        self.iterations += 1;
        // The projection of w = z - u onto balance is w + A^T l with M l = target - A w.
        let Admm { program, state, dual, point, multipliers, penalty, .. } = self;
        let (program, penalty) = (*program, *penalty);
        difference(&mut point.contacts, &state.contacts, &dual.contacts);
        difference(&mut point.joints, &state.joints, &dual.joints);
        difference(&mut point.missing, &state.missing, &dual.missing);
        program.imbalance(point, &mut self.left);
        self.factor.solve(&self.left, multipliers, MINOR, INNER, &mut self.work);
        let (mut of_contacts, mut of_joints) = (Residuals::default(), Residuals::default());
        let less = penalty / (penalty + weights.squares);
        let contact = |at: usize, step: Vector3<f64>| {
            let (x, z, u) = (point.contacts[at] + step, &mut state.contacts[at], &mut dual.contacts[at]);
            let relaxed = x * RELAXATION + *z * (1.0 - RELAXATION) + *u;
            let next = onto_cone(relaxed * less, weights.normals[at] * less / penalty, program.contacts[at].friction);
            of_contacts.add((x - next).norm_squared(), (*z - next).norm_squared());
            (*u, *z) = (relaxed - next, next);
        };
        let joint = |t: usize, step: Vector6<f64>| {
            let (x, z, u) = (point.joints[t] + step, &mut state.joints[t], &mut dual.joints[t]);
            let relaxed = x * RELAXATION + *z * (1.0 - RELAXATION) + *u;
            let next = capped(shrunk(relaxed, weights.joints[t] / penalty), program.sites[t].strength);
            of_joints.add((x - next).norm_squared(), (*z - next).norm_squared());
            (*u, *z) = (relaxed - next, next);
        };
        program.velocities(multipliers, &self.allowed, contact, joint);
        of_contacts.add(of_joints.apart, of_joints.moved);
        let residuals = &mut of_contacts;
        if self.is_elastic {
            for ((body, step), cost) in multipliers.iter().enumerate().zip(&weights.missing) {
                let (x, z, u) = (point.missing[body] + step, &mut state.missing[body], &mut dual.missing[body]);
                let relaxed = x * RELAXATION + *z * (1.0 - RELAXATION) + *u;
                let next = shrunk(relaxed, cost / penalty);
                residuals.add((x - next).norm_squared(), (*z - next).norm_squared());
                (*u, *z) = (relaxed - next, next);
            }
        }
        (residuals.apart.sqrt(), residuals.moved.sqrt())
    }

    /// Adapts the penalty: a higher one draws the two kinds of forces together, a lower one lets the prices decide.
    fn even_out(&mut self, apart: f64, moved: f64) {
        let factor = match () {
            () if apart > UNEVEN * moved => 2.0,
            () if moved > UNEVEN * apart => 0.5,
            () => return,
        };
        self.set_penalty(self.penalty * factor);
    }

    /// Sets the weight of balance against the prices.
    pub fn set_penalty(&mut self, penalty: f64) {
        let factor = penalty / self.penalty;
        self.penalty = penalty;
        self.dual.contacts.iter_mut().for_each(|u| *u /= factor);
        self.dual.joints.iter_mut().for_each(|u| *u /= factor);
        self.dual.missing.iter_mut().for_each(|u| *u /= factor);
    }
}

/// Sums of squares: the distance between the two kinds of forces, and how far those that obey their laws have moved.
#[derive(Default)]
struct Residuals {
    apart: f64,
    moved: f64,
}

impl Residuals {
    fn add(&mut self, apart: f64, moved: f64) {
        self.apart += apart;
        self.moved += moved;
    }
}

/// The number of entries that only one of two ascending lists has.
fn different(a: &[usize], b: &[usize]) -> usize {
    let only = |a: &[usize], b: &[usize]| a.iter().filter(|site| b.binary_search(site).is_err()).count();
    only(a, b) + only(b, a)
}

fn difference<const N: usize>(point: &mut [SVector<f64, N>], state: &[SVector<f64, N>], dual: &[SVector<f64, N>]) {
    point.iter_mut().zip(state.iter().zip(dual)).for_each(|(p, (z, u))| *p = z - u);
}

/// The nearest contact force within friction, after the normal force has paid its price.
pub fn onto_cone(f: Vector3<f64>, price: f64, friction: f64) -> Vector3<f64> {
    let (normal, tangent) = (f[0] - price, (f[1] * f[1] + f[2] * f[2]).sqrt());
    if normal >= 0.0 && tangent <= friction * normal {
        return Vector3::new(normal, f[1], f[2]);
    }
    if friction * tangent <= -normal {
        return Vector3::zeros();
    }
    let onto = (normal + friction * tangent) / (1.0 + friction * friction);
    let scale = if tangent > 0.0 { friction * onto / tangent } else { 0.0 };
    Vector3::new(onto, f[1] * scale, f[2] * scale)
}

fn shrunk(joint: Vector6<f64>, by: f64) -> Vector6<f64> {
    let norm = joint.norm();
    if norm > by { joint * (1.0 - by / norm) } else { Vector6::zeros() }
}

pub fn capped(joint: Vector6<f64>, most: f64) -> Vector6<f64> {
    let norm = joint.norm();
    if norm > most { joint * (most / norm) } else { joint }
}
