//! The group lasso by operator splitting (ADMM; Boyd et al. 2011, section 3): forces that balance every body, and forces that each
//! obey their own law, drawn together.

use super::factor::{Factor, Mobility, Work};
use super::program::{Program, State};
use super::{GlueError, Going};
use nalgebra::{SVector, Vector3, Vector6};

/// How long a run takes.
#[derive(Clone, Copy, Debug)]
pub struct Length {
    pub least: u64,
    pub most: u64,
}

/// The first run, from nothing, and those that go on from it.
pub const FIRST: Length = Length { least: 200, most: 1200 };
pub const NEXT: Length = Length { least: 100, most: 600 };
/// The same for piles of at most so many bodies.
pub const NEXT_SMALL: Length = Length { least: 600, most: 600 };
pub const SMALL: usize = 100;

/// A run that only chooses ends once what the forces that obey their laws leave unbalanced, on average, is less than this, in a
/// body's weight.
pub const NEAR: f64 = 2e-3;
/// Each new point is this far beyond the projection.
const RELAXATION: f64 = 1.6;
/// Iterations of conjugate gradients in each projection, and the residual that ends them.
const INNER: usize = 6;
const INNER_TOLERANCE: f64 = 0.1;
/// The penalty is looked at every so many iterations, and changed where the two residuals differ by more than this factor.
const LOOK: u64 = 50;
const UNEVEN: f64 = 5.0;

/// What each unknown costs.
pub struct Weights {
    /// Of the norm of each dot. Shape `[touch]`.
    pub dots: Vec<f64>,
    /// Of each normal force. Shape `[contact]`.
    pub normals: Vec<f64>,
    /// Of the norm of what each body misses, shape `[body]`; empty: nothing may be missing.
    pub missing: Vec<f64>,
}

impl Weights {
    pub fn even(program: &Program, normal: f64, may_miss: bool) -> Weights {
        let missing = vec![1.0; if may_miss { program.target.len() } else { 0 }];
        let normals = vec![normal; program.contacts.len()];
        Weights { dots: vec![1.0; program.touches.len()], normals, missing }
    }

    /// The problem's own prices, normal forces at a share of theirs.
    pub fn of(program: &Program, share: f64) -> Weights {
        let mut weights = Weights::even(program, 0.0, false);
        weights.price(program, share);
        weights
    }

    /// Normal forces cost a share of their price.
    pub fn price(&mut self, program: &Program, share: f64) {
        self.normals.iter_mut().zip(&program.contacts).for_each(|(weight, contact)| *weight = contact.price * share);
    }

    /// What carries little costs more.
    pub fn reweight(&mut self, dots: &[Vector6<f64>], e: f64) {
        self.dots.iter_mut().zip(dots).for_each(|(weight, dot)| *weight = e / (dot.norm() + e));
    }

    /// What misses little is to miss nothing.
    pub fn reweight_missing(&mut self, missing: &[Vector6<f64>], e: f64) {
        self.missing.iter_mut().zip(missing).for_each(|(weight, missing)| *weight = e / (missing.norm() + e));
    }
}

/// A solve under way.
pub struct Splitting<'p> {
    pub program: &'p Program<'p>,
    may: Vec<bool>,
    factor: Factor,
    /// Obeys every law.
    pub state: State,
    /// What has been asked for in vain, in sum.
    dual: State,
    /// State less dual.
    point: State,
    /// Multipliers of the balance.
    multipliers: Vec<Vector6<f64>>,
    penalty: f64,
    pub iterations: u64,
    is_elastic: bool,
    work: Work,
    left: Vec<Vector6<f64>>,
}

impl<'p> Splitting<'p> {
    /// `may`: which touches may be glued, shape `[touch]`. `is_elastic`: bodies may miss something.
    pub fn new(program: &'p Program<'p>, may: &[bool], is_elastic: bool) -> Splitting<'p> {
        let mobility = Mobility {
            contacts: vec![1.0; program.pile.contacts.len()],
            dots: may.iter().map(|&may| f64::from(u8::from(may))).collect(),
            missing: f64::from(u8::from(is_elastic)),
        };
        Splitting {
            program,
            may: may.to_vec(),
            factor: Factor::new(program, &mobility),
            state: program.empty_state(),
            dual: program.empty_state(),
            point: program.empty_state(),
            multipliers: vec![Vector6::zeros(); program.target.len()],
            penalty: 1.0,
            iterations: 0,
            is_elastic,
            work: Work::default(),
            left: Vec::new(),
        }
    }

    /// Begins at a state.
    pub fn take(&mut self, state: State) {
        self.state = state;
        for (dot, _) in self.state.dots.iter_mut().zip(&self.may).filter(|(_, may)| !**may) {
            *dot = Vector6::zeros();
        }
        self.state.missing.fill(Vector6::zeros());
    }

    /// Goes on until the forces leave less than `near` unbalanced, on average over the bodies.
    pub fn run(&mut self, weights: &Weights, length: Length, near: f64, going: &mut Going) -> Result<(), GlueError> {
        for k in 1..=length.most {
            if going().is_break() {
                return Err(GlueError::Cancelled);
            }
            let (apart, moved) = self.iterate(weights);
            if k % LOOK == 0 {
                self.even_out(apart, moved * self.penalty);
                if k >= length.least && self.unbalanced() < near {
                    break;
                }
            }
        }
        Ok(())
    }

    /// Touches whose dot carries more than this, rising.
    pub fn dots(&self, least: f64) -> Vec<usize> {
        let dots = &self.state.dots;
        (0..dots.len()).filter(|&touch| dots[touch].norm() > least).collect()
    }

    /// Mean over the bodies of what the state leaves unbalanced.
    fn unbalanced(&mut self) -> f64 {
        self.program.imbalance(&self.state, &mut self.left);
        self.left.iter().map(|e| e.norm()).sum::<f64>() / self.left.len().max(1) as f64
    }

    /// What the contact forces leave each body without. Shape `[body]`.
    pub fn left_by_contacts(&mut self) -> Vec<f64> {
        self.program.imbalance(&self.state, &mut self.left);
        self.left.iter().zip(&self.state.missing).map(|(left, missing)| (left + missing).norm()).collect()
    }

    /// Bodies that miss more than `least`, and at least half as much as the one that misses most.
    pub fn missing(&self, least: f64) -> Vec<usize> {
        let missing = || self.state.missing.iter().map(|e| e.norm()).enumerate();
        let most = missing().map(|(_, e)| e).fold(0.0, f64::max);
        missing().filter(|(_, e)| *e > least && *e >= 0.5 * most).map(|(body, _)| body).collect()
    }

    /// One iteration; returns how far apart the two kinds of forces are, and how far those that obey their laws have moved.
    fn iterate(&mut self, weights: &Weights) -> (f64, f64) {
        self.iterations += 1;
        // The projection of w = z - u onto balance is w + A^T l with M l = target - A w.
        let Splitting { program, state, dual, point, multipliers, penalty, .. } = self;
        let (program, penalty) = (*program, *penalty);
        difference(&mut point.contacts, &state.contacts, &dual.contacts);
        difference(&mut point.dots, &state.dots, &dual.dots);
        difference(&mut point.missing, &state.missing, &dual.missing);
        program.imbalance(point, &mut self.left);
        self.factor.solve(&self.left, multipliers, INNER_TOLERANCE, INNER, &mut self.work);
        let (mut of_contacts, mut of_dots) = (Ways::default(), Ways::default());
        let contact = |at: usize, step: Vector3<f64>| {
            let (x, z, u) = (point.contacts[at] + step, &mut state.contacts[at], &mut dual.contacts[at]);
            let relaxed = x * RELAXATION + *z * (1.0 - RELAXATION) + *u;
            let next = onto_cone(relaxed, weights.normals[at] / penalty, program.contacts[at].friction);
            of_contacts.add((x - next).norm_squared(), (*z - next).norm_squared());
            (*u, *z) = (relaxed - next, next);
        };
        let dot = |t: usize, step: Vector6<f64>| {
            let (x, z, u) = (point.dots[t] + step, &mut state.dots[t], &mut dual.dots[t]);
            let relaxed = x * RELAXATION + *z * (1.0 - RELAXATION) + *u;
            let next = capped(shrunk(relaxed, weights.dots[t] / penalty), program.touches[t].strength);
            of_dots.add((x - next).norm_squared(), (*z - next).norm_squared());
            (*u, *z) = (relaxed - next, next);
        };
        program.velocities(multipliers, &self.may, contact, dot);
        of_contacts.add(of_dots.apart, of_dots.moved);
        let ways = &mut of_contacts;
        if self.is_elastic {
            for ((body, step), cost) in multipliers.iter().enumerate().zip(&weights.missing) {
                let (x, z, u) = (point.missing[body] + step, &mut state.missing[body], &mut dual.missing[body]);
                let relaxed = x * RELAXATION + *z * (1.0 - RELAXATION) + *u;
                let next = shrunk(relaxed, cost / penalty);
                ways.add((x - next).norm_squared(), (*z - next).norm_squared());
                (*u, *z) = (relaxed - next, next);
            }
        }
        (ways.apart.sqrt(), ways.moved.sqrt())
    }

    /// A higher penalty draws the two kinds of forces together, a lower one lets the costs decide.
    fn even_out(&mut self, apart: f64, moved: f64) {
        let factor = match () {
            () if apart > UNEVEN * moved => 2.0,
            () if moved > UNEVEN * apart => 0.5,
            () => return,
        };
        self.set_penalty(self.penalty * factor);
    }

    /// How much balance weighs against the costs.
    pub fn set_penalty(&mut self, penalty: f64) {
        let factor = penalty / self.penalty;
        self.penalty = penalty;
        self.dual.contacts.iter_mut().for_each(|u| *u /= factor);
        self.dual.dots.iter_mut().for_each(|u| *u /= factor);
        self.dual.missing.iter_mut().for_each(|u| *u /= factor);
    }
}

/// Sums of squares: how far the two kinds of forces are apart, and how far those that obey their laws have moved.
#[derive(Default)]
struct Ways {
    apart: f64,
    moved: f64,
}

impl Ways {
    fn add(&mut self, apart: f64, moved: f64) {
        self.apart += apart;
        self.moved += moved;
    }
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

fn shrunk(dot: Vector6<f64>, by: f64) -> Vector6<f64> {
    let norm = dot.norm();
    if norm > by { dot * (1.0 - by / norm) } else { Vector6::zeros() }
}

pub fn capped(dot: Vector6<f64>, most: f64) -> Vector6<f64> {
    let norm = dot.norm();
    if norm > most { dot * (most / norm) } else { dot }
}
