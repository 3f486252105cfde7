//! Newton's method on the tangent directions of the loaded generators, for Coulomb's cone.
//!
//! Near the answer of an unstable problem each loaded contact has one generator, n + mu t(theta), and only the angles
//! theta are still wrong. Pricing improves them one at a time. Here all move at once: with lambda eliminated, half the
//! squared distance as a function of the angles has
//!
//! ```text
//! gradient_i = -lambda_i y . a_i'
//! hessian_ij = lambda_i lambda_j (P a_i') . (P a_j') + [i = j] lambda_i mu_i v_i . t_i
//! ```
//!
//! a_i' = the wrench of mu (n x t), P = the projection off the loaded generators, y and v as in [`super::projection`]. (The
//! hessian leaves out terms in y . a_i', which vanish at the answer: convergence stays quadratic.) A step that does not bring
//! the iterate nearer, or turns a coefficient negative, is taken back: pricing then goes on from where it was.

use super::projection::{Generator, MOST, Projection};
use super::scaled::{Scaled, Vec6, dot, norm, split, subtract};
use glam::DVec3;

/// Newton steps of one polish: quadratic from about 0.1 rad, they reach rounding.
const MOST_ROUNDS: u32 = 6;

/// Angles that change by less than this have converged: the work of a generator is exact to the square of it.
const ANGLE: f64 = 1e-8;

/// A contact whose point does not move along its friction force by this share of the separator carries a force inside its
/// cone, where a direction on the rim means nothing.
const SLIPS: f64 = 1e-6;

/// A step beyond this many radians is no longer Newton's territory.
const FAR: f64 = 1.0;

/// A generator whose angle may turn.
#[derive(Clone, Copy, Debug, Default)]
struct Turn {
    /// mu n x t and mu t, as forces.
    across: DVec3,
    along: DVec3,
    /// lambda times the wrench of `across`, off the loaded generators.
    swing: Vec6,
    gradient: f64,
    curvature: f64,
}

impl Projection {
    /// Moves all tangents to where they are best. Leaves everything as it was if Newton's method does not converge, or to
    /// a place that is no nearer.
    pub(super) fn polish(&mut self, scaled: &Scaled) -> bool {
        let before = self.clone();
        let (forces, n) = self.merged(scaled);
        let mut loaded = self.reload(scaled, &forces[..n]);
        for _ in 0..MOST_ROUNDS {
            if !loaded {
                break;
            }
            let Some(change) = self.turn(scaled) else { break };
            loaded = change.is_finite();
            if change < ANGLE {
                if norm(&self.left) <= norm(&before.left) {
                    return true;
                }
                break;
            }
        }
        *self = before;
        false
    }

    /// One generator per loaded contact: the direction of its force, stretched to the rim of the cone.
    fn merged(&self, scaled: &Scaled) -> ([(usize, DVec3); MOST], usize) {
        let mut out = [(0, DVec3::ZERO); MOST];
        let mut n = 0;
        for (g, lambda) in self.loaded.iter().zip(self.lambda).take(self.count) {
            match out[..n].iter_mut().find(|o| o.0 == g.contact) {
                Some(o) => o.1 += lambda * g.force,
                None => {
                    out[n] = (g.contact, lambda * g.force);
                    n += 1;
                }
            }
        }
        for (contact, force) in &mut out[..n] {
            let row = &scaled.rows()[*contact];
            let tangential = *force - force.dot(row.n) * row.n;
            *force = row.n + scaled.mu(row) * tangential.normalize_or_zero();
        }
        (out, n)
    }

    /// Loads exactly these. False if they are dependent or least squares does not load them all.
    fn reload(&mut self, scaled: &Scaled, forces: &[(usize, DVec3)]) -> bool {
        self.count = 0;
        for (contact, force) in forces {
            let wrench = scaled.rows()[*contact].wrench(*force);
            if !self.enter(Generator { contact: *contact, force: *force, wrench }) {
                return false;
            }
        }
        let wanted = self.least_squares();
        if wanted[..self.count].iter().any(|w| *w <= 0.0 || w.is_nan()) {
            return false;
        }
        self.lambda = wanted;
        self.set_left();
        true
    }

    /// One Newton step. The largest change of an angle; `None` if the step is not to be had.
    fn turn(&mut self, scaled: &Scaled) -> Option<f64> {
        let n = self.count;
        let (velocity, spin) = split(&self.left);
        let mut turns = [Turn::default(); MOST];
        for (t, (g, lambda)) in turns.iter_mut().zip(self.loaded.iter().zip(self.lambda)).take(n) {
            let row = &scaled.rows()[g.contact];
            t.along = g.force - row.n;
            t.across = row.n.cross(t.along);
            let mut swing = row.wrench(t.across).map(|k| lambda * k);
            t.gradient = -dot(&self.left, &swing);
            let slip = (velocity + spin.cross(row.r)).dot(t.along);
            if slip < SLIPS * norm(&self.left) * t.along.length() {
                return None;
            }
            t.curvature = lambda * slip;
            for q in &self.q[..n] {
                let along = dot(q, &swing);
                subtract(&mut swing, along, q);
            }
            t.swing = swing;
        }
        let angles = newton_step(&turns[..n])?;
        let largest = angles[..n].iter().fold(0.0, |m: f64, a| m.max(a.abs()));
        if largest.is_nan() || largest > FAR {
            return None;
        }
        let mut forces = [(0, DVec3::ZERO); MOST];
        for (k, (f, t)) in forces.iter_mut().zip(&turns).take(n).enumerate() {
            let row = &scaled.rows()[self.loaded[k].contact];
            let (s, c) = angles[k].sin_cos();
            let turned = c * t.along + s * t.across;
            // Rounding must not add up over the rounds: the tangent stays a tangent of length mu.
            let tangent = (turned - turned.dot(row.n) * row.n).normalize_or_zero();
            *f = (self.loaded[k].contact, row.n + scaled.mu(row) * tangent);
        }
        self.reload(scaled, &forces[..n]).then_some(largest)
    }
}

/// Solves hessian x = -gradient by Cholesky's L D L'. A generator without friction has an empty row and does not turn.
fn newton_step(turns: &[Turn]) -> Option<[f64; MOST]> {
    let n = turns.len();
    let mut h = [[0.0; MOST]; MOST];
    let mut x = [0.0; MOST];
    for i in 0..n {
        for j in 0..=i {
            h[i][j] = dot(&turns[i].swing, &turns[j].swing);
        }
        h[i][i] += turns[i].curvature;
        if turns[i].along == DVec3::ZERO {
            h[i][i] = 1.0;
        }
        x[i] = -turns[i].gradient;
    }
    for i in 0..n {
        for j in 0..i {
            let mut v = h[i][j];
            for k in 0..j {
                v -= h[i][k] * h[j][k] * h[k][k];
            }
            h[i][j] = v / h[j][j];
            x[i] -= h[i][j] * x[j];
        }
        for k in 0..i {
            h[i][i] -= h[i][k] * h[i][k] * h[k][k];
        }
        if h[i][i] <= 0.0 || h[i][i].is_nan() {
            return None;
        }
    }
    for i in (0..n).rev() {
        x[i] /= h[i][i];
        for k in i + 1..n {
            x[i] -= h[k][i] * x[k];
        }
    }
    Some(x)
}
