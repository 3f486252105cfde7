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

/// A contact whose point moves tangentially by less than this share of the separator sticks: its force lies inside its cone, where
/// a direction on the rim means nothing.
const SLIPS: f64 = 1e-6;

/// A step beyond this many radians is no longer Newton's territory.
const FAR: f64 = 1.0;

/// A generator to be loaded.
#[derive(Clone, Copy, Debug, Default)]
struct Load {
    contact: usize,
    force: DVec3,
    /// Its contact slips along the separator: its tangent may turn.
    slips: bool,
}

/// A generator whose angle may turn; all zero if it may not.
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
        let (mut loads, n) = self.merged(scaled);
        let mut loaded = self.reload(scaled, &loads[..n]);
        for _ in 0..MOST_ROUNDS {
            if !loaded {
                break;
            }
            let Some(change) = self.turn(scaled, &mut loads[..n]) else { break };
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

    /// What is to be loaded: of a contact that slips, one generator, the direction of its force, stretched to the rim of the
    /// cone; of a contact that sticks, what it has.
    fn merged(&self, scaled: &Scaled) -> ([Load; MOST], usize) {
        let (velocity, spin) = split(&self.left);
        let still = SLIPS * norm(&self.left);
        let mut out = [Load::default(); MOST];
        let mut n = 0;
        for (g, lambda) in self.loaded.iter().zip(self.lambda).take(self.count) {
            let row = &scaled.rows()[g.contact];
            let v = velocity + spin.cross(row.r);
            let slips = (v - v.dot(row.n) * row.n).length() > still && scaled.mu(row) > 0.0;
            if slips && let Some(o) = out[..n].iter_mut().find(|o| o.contact == g.contact) {
                o.force += lambda * g.force;
                continue;
            }
            out[n] = Load { contact: g.contact, force: if slips { lambda * g.force } else { g.force }, slips };
            n += 1;
        }
        for load in out[..n].iter_mut().filter(|o| o.slips) {
            let row = &scaled.rows()[load.contact];
            let tangential = load.force - load.force.dot(row.n) * row.n;
            load.force = row.n + scaled.mu(row) * tangential.normalize_or_zero();
        }
        (out, n)
    }

    /// Loads exactly these. False if they are dependent or least squares does not load them all.
    fn reload(&mut self, scaled: &Scaled, loads: &[Load]) -> bool {
        self.count = 0;
        for load in loads {
            let wrench = scaled.rows()[load.contact].wrench(load.force);
            if !self.enter(Generator { contact: load.contact, force: load.force, wrench }) {
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
    fn turn(&mut self, scaled: &Scaled, loads: &mut [Load]) -> Option<f64> {
        let (velocity, spin) = split(&self.left);
        let mut turns = [Turn::default(); MOST];
        for (k, (t, load)) in turns.iter_mut().zip(loads.iter()).enumerate().filter(|(_, (_, load))| load.slips) {
            let row = &scaled.rows()[load.contact];
            t.along = load.force - row.n;
            t.across = row.n.cross(t.along);
            let mut swing = row.wrench(t.across).map(|x| self.lambda[k] * x);
            t.gradient = -dot(&self.left, &swing);
            t.curvature = self.lambda[k] * (velocity + spin.cross(row.r)).dot(t.along);
            for q in &self.q[..self.count] {
                let along = dot(q, &swing);
                subtract(&mut swing, along, q);
            }
            t.swing = swing;
        }
        let angles = newton_step(&turns[..loads.len()])?;
        let largest = angles.iter().fold(0.0, |m: f64, a| m.max(a.abs()));
        if largest.is_nan() || largest > FAR {
            return None;
        }
        for ((load, t), angle) in loads.iter_mut().zip(&turns).zip(angles).filter(|((load, _), _)| load.slips) {
            let row = &scaled.rows()[load.contact];
            let (s, c) = angle.sin_cos();
            let turned = c * t.along + s * t.across;
            // Rounding must not add up over the rounds: the tangent stays a tangent of length mu.
            let tangent = (turned - turned.dot(row.n) * row.n).normalize_or_zero();
            load.force = row.n + scaled.mu(row) * tangent;
        }
        self.reload(scaled, loads).then_some(largest)
    }
}

/// Solves hessian x = -gradient by Cholesky's L D L'. A generator that may not turn has an empty row.
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
