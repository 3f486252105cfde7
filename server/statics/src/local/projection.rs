//! The fast solver: projection of a wrench onto the cone of all wrenches that the contacts can exert.
//!
//! # Method
//!
//! Lawson & Hanson's non-negative least squares (1974), with generators made when they are needed. The iterate is
//! sum lambda_j a_j over at most six *loaded* generators a_j (wrenches of forces of unit normal component), all
//! lambda_j > 0, and is the least-squares answer over their span. One step:
//!
//! 1. y = the rest of the target, orthogonal to all loaded generators.
//! 2. **Price**: seen as a virtual velocity, y moves contact i with v = y_f + y_t x r_i. The force of unit normal
//!    component that does most work is n_i + mu v_t/|v_t| on Coulomb's cone (in closed form, the whole circle at once),
//!    and the best corner on a pyramid. The contact that offers most is entered. If none offers positive work, y is a
//!    separator and the iterate the projection: done.
//! 3. **Solve** least squares over the loaded generators. Where a lambda turns negative, go only as far as all stay
//!    non-negative, unload the generator that reached zero, and solve again.
//!
//! Each step brings the iterate strictly nearer, so that no set of generators comes twice. On a pyramid there are
//! finitely many of them, and the method ends with the exact answer. On the cone each new tangent direction comes from
//! a separator that is exact to second order in the spacing of the tangents, so that few are needed: on average three
//! more steps than on the pyramid, rarely thirty. (Newton's method on all tangents at once was tried on top: fewer
//! steps, the same time.)
//!
//! # Numerics
//!
//! The loaded generators are kept as Q R, Q from Gram-Schmidt with one re-orthogonalisation ("twice is enough":
//! orthogonal to rounding for any condition), R updated by Givens rotations when a generator leaves. y is taken as the
//! part of the target orthogonal to Q, also twice: near the boundary of stability |y| may be 1e-9, and b - A lambda
//! would be a direction accurate to 1e-7 only, whereas the twice orthogonalised y remains orthogonal to the loaded
//! generators to rounding. This is what makes certificates possible down to 1e-10.

use super::scaled::{ScaledProblem, TIE, Vec6, dot, norm, split, subtract};
use super::{EXCLUDED_FORCE, FORCE_ROUNDING, INDEPENDENT, MOST_ITERATIONS, PROOF_TOLERANCE, STABLE_RESIDUAL};
use glam::DVec3;

/// The span of seven wrenches is the span of six of them.
const MOST: usize = 6;

/// Of the tolerance of a certificate, the share that the solver uses up; the rest is for the substitution's rounding.
const SHARE: f64 = 0.25;

/// Steps that may fail to bring the iterate nearer before the projection ends. They are legitimate at the level of
/// rounding, where a step may only turn the separator.
const MOST_STALLS: u32 = 12;

/// A force of unit normal component, and its wrench.
#[derive(Clone, Copy, Debug, Default)]
struct Generator {
    contact: usize,
    force: DVec3,
    wrench: Vec6,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Projection {
    target: Vec6,
    /// Loaded generators: the first `count` of each array.
    count: usize,
    loaded: [Generator; MOST],
    lambda: [f64; MOST],
    /// Orthonormal columns with the span of the loaded generators.
    q: [Vec6; MOST],
    /// `r[j][..=j]`: generator j in terms of q.
    r: [[f64; MOST]; MOST],
    /// The part of the target outside their span.
    left: Vec6,
    accuracy: StopRule,
}

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub(super) struct StopRule {
    /// Left over less than this, the target is reached.
    pub reached: f64,
    /// No generator does more work than this with the unit separator.
    pub violation: f64,
    /// No admissible forces whose normal components sum to less than this, in mg, balance the body.
    pub excluded_force: f64,
}

impl Default for StopRule {
    fn default() -> Self {
        StopRule {
            reached: STABLE_RESIDUAL / 100.0,
            violation: SHARE * PROOF_TOLERANCE,
            excluded_force: EXCLUDED_FORCE / SHARE,
        }
    }
}

impl Projection {
    /// Projects `target`; returns the number of steps.
    pub fn run(&mut self, scaled: &ScaledProblem, target: Vec6) -> u32 {
        self.target = target;
        self.accuracy = StopRule::default();
        self.count = 0;
        self.iterate(scaled)
    }

    /// Projects another target, from the generators that are loaded. They stay valid if the contacts are the same and
    /// friction has not shrunk.
    pub fn resume(&mut self, scaled: &ScaledProblem, target: Vec6, accuracy: StopRule) -> u32 {
        self.target = target;
        self.accuracy = accuracy;
        self.solve();
        self.iterate(scaled)
    }

    /// Projects `target`, from forces that were near the answer for similar contacts (in mg; zero where unknown).
    pub fn run_from(&mut self, scaled: &ScaledProblem, target: Vec6, forces: &[DVec3]) -> u32 {
        self.count = 0;
        for (index, (contact, f)) in scaled.contacts().iter().zip(forces).enumerate() {
            let normal = f.dot(contact.n);
            if !(normal > PROOF_TOLERANCE && f.is_finite()) || self.count == MOST {
                continue;
            }
            let force = scaled.within_friction(contact, *f / normal);
            if self.enter(Generator { contact: index, force, wrench: contact.wrench(force) }) {
                let j = self.count - 1;
                self.lambda[j] = normal;
                // A generator that adds nothing to the span of the others is left to pricing.
                if self.r[j][j] < INDEPENDENT {
                    self.count = j;
                }
            }
        }
        self.resume(scaled, target, StopRule::default())
    }

    fn iterate(&mut self, scaled: &ScaledProblem) -> u32 {
        let mut least = f64::INFINITY;
        let mut stalls = 0;
        for step in 0..MOST_ITERATIONS {
            self.set_left();
            let left = norm(&self.left);
            if left <= self.accuracy.reached || self.count == MOST || stalls > MOST_STALLS {
                return step;
            }
            stalls += u32::from(left >= least);
            least = left.min(least);
            let allowed = (left / self.accuracy.excluded_force).min(self.accuracy.violation);
            let Some(best) = self.price(scaled, left * allowed.max(FORCE_ROUNDING)) else { return step };
            if !self.enter(best) || !self.solve_entered() {
                return step;
            }
        }
        MOST_ITERATIONS
    }

    /// Forces per contact of the current iterate.
    pub fn forces(&self, contacts: usize, out: &mut Vec<DVec3>) {
        out.clear();
        out.resize(contacts, DVec3::ZERO);
        for (g, lambda) in self.loaded.iter().zip(self.lambda).take(self.count) {
            out[g.contact] += lambda * g.force;
        }
    }

    /// The direction that separates the target from all wrenches; `None` if the target is in the span of the
    /// loaded generators.
    pub fn separator(&self) -> Option<Vec6> {
        (norm(&self.left) > 0.0).then_some(self.left)
    }

    fn set_left(&mut self) {
        self.left = self.target;
        for _ in 0..2 {
            for q in &self.q[..self.count] {
                let along = dot(q, &self.left);
                subtract(&mut self.left, along, q);
            }
        }
    }

    /// The generator that does most work with `left`, if it does more than `threshold`.
    fn price(&self, scaled: &ScaledProblem, threshold: f64) -> Option<Generator> {
        let (velocity, spin) = split(&self.left);
        let mut bar = threshold;
        let mut best = None;
        for (index, contact) in scaled.contacts().iter().enumerate() {
            if let Some(work) = scaled.offer(contact, velocity + spin.cross(contact.r), bar) {
                bar = bar.max(work * TIE);
                best = Some((index, contact));
            }
        }
        best.map(|(index, contact)| {
            let force = scaled.best_force(contact, velocity + spin.cross(contact.r));
            Generator { contact: index, force, wrench: contact.wrench(force) }
        })
    }

    /// Appends a generator to Q R, unloaded. False if it lies in their span.
    fn enter(&mut self, g: Generator) -> bool {
        let j = self.count;
        let mut rest = g.wrench;
        let mut column = [0.0; MOST];
        for _ in 0..2 {
            for (q, c) in self.q[..j].iter().zip(&mut column) {
                let along = dot(q, &rest);
                *c += along;
                subtract(&mut rest, along, q);
            }
        }
        let length = norm(&rest);
        if length == 0.0 {
            return false;
        }
        column[j] = length;
        self.q[j] = rest.map(|k| k / length);
        self.r[j] = column;
        self.loaded[j] = g;
        self.lambda[j] = 0.0;
        self.count += 1;
        true
    }

    /// [`Projection::solve`] after a generator was entered. The first answer is the old one plus a change in proportion
    /// to the new generator's share of `left`. From scratch, a share of 1e-16 would be rounding of either sign; like
    /// this the new generator's coefficient is positive whatever its size. False if rounding has been reached all the
    /// same.
    fn solve_entered(&mut self) -> bool {
        let new = self.count - 1;
        let mut wanted = [0.0; MOST];
        wanted[new] = dot(&self.q[new], &self.left);
        self.back_substitute(&mut wanted);
        if wanted[new] <= 0.0 {
            self.leave(new);
            return false;
        }
        for (w, lambda) in wanted.iter_mut().zip(&self.lambda).take(self.count) {
            *w += lambda;
        }
        if !self.accept(&wanted) {
            self.solve();
        }
        true
    }

    /// Least squares over the loaded generators, unloading until all are positive.
    fn solve(&mut self) {
        while self.count > 0 {
            let wanted = self.least_squares();
            if self.accept(&wanted) {
                return;
            }
        }
    }

    /// Takes the coefficients wanted if all are positive. Otherwise goes as far towards them as all stay non-negative,
    /// and unloads the one that stops it.
    fn accept(&mut self, wanted: &[f64; MOST]) -> bool {
        let mut share = 1.0;
        let mut leaves = None;
        for (j, (lambda, wanted)) in self.lambda.iter().zip(wanted).take(self.count).enumerate() {
            if *wanted <= 0.0 {
                let descent = lambda - wanted;
                let s = if descent > 0.0 { lambda / descent } else { 0.0 };
                if leaves.is_none() || s * TIE < share {
                    share = s;
                    leaves = Some(j);
                }
            }
        }
        let Some(j) = leaves else {
            self.lambda[..self.count].copy_from_slice(&wanted[..self.count]);
            return true;
        };
        for (lambda, wanted) in self.lambda.iter_mut().zip(wanted).take(self.count) {
            *lambda = (*lambda + share * (wanted - *lambda)).max(0.0);
        }
        self.leave(j);
        false
    }

    /// R lambda = Q' target.
    fn least_squares(&self) -> [f64; MOST] {
        let mut x = [0.0; MOST];
        for (x, q) in x.iter_mut().zip(&self.q).take(self.count) {
            *x = dot(q, &self.target);
        }
        self.back_substitute(&mut x);
        x
    }

    /// x = R^-1 x.
    fn back_substitute(&self, x: &mut [f64; MOST]) {
        for j in (0..self.count).rev() {
            x[j] /= self.r[j][j];
            let value = x[j];
            for (k, xk) in x[..j].iter_mut().enumerate() {
                *xk -= self.r[j][k] * value;
            }
        }
    }

    /// Takes generator j out of Q R: its column goes, Givens rotations make R triangular again.
    fn leave(&mut self, j: usize) {
        let n = self.count;
        for k in j + 1..n {
            self.loaded[k - 1] = self.loaded[k];
            self.lambda[k - 1] = self.lambda[k];
            self.r[k - 1] = self.r[k];
        }
        self.count = n - 1;
        for k in j..n - 1 {
            let (a, b) = (self.r[k][k], self.r[k][k + 1]);
            // b > 0: it is the length of what generator k + 1 added to the span.
            let h = (a * a + b * b).sqrt();
            let (c, s) = (a / h, b / h);
            for column in &mut self.r[k..n - 1] {
                let (u, v) = (column[k], column[k + 1]);
                column[k] = c * u + s * v;
                column[k + 1] = c * v - s * u;
            }
            for m in 0..6 {
                let (u, v) = (self.q[k][m], self.q[k + 1][m]);
                self.q[k][m] = c * u + s * v;
                self.q[k + 1][m] = c * v - s * u;
            }
        }
    }
}
