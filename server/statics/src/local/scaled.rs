//! The problem without units, and the substitution checks that every verdict must pass.
//!
//! Forces are in mg, lever arms in bounding radii R; a wrench is (force, torque about the centre of mass). This file
//! knows the friction laws and nothing of how the solvers work.

use super::{EXCLUDED_FORCE, FORCE_ROUNDING, Fit, FrictionLaw, PROOF_TOLERANCE};
use super::{LocalProblem, ProblemError, REFERENCE_EXCLUDED_FORCE, REFERENCE_RESIDUAL, STABLE_RESIDUAL, Wrench};
use glam::DVec3;

/// Largest number of sides of a friction pyramid.
pub const MAX_SIDES: u32 = 64;

/// The square of a larger number overflows, that of its inverse underflows: a lever arm of more radii, and a normal
/// that is shorter than the inverse, are refused.
const LARGEST: f64 = 1e150;

/// Choices whose worth differs by less count as equal, and the first wins: rounding, which differs from unit system to
/// unit system, then does not choose between the two halves of a symmetric body.
pub(super) const TIE: f64 = 1.0 + 1e-9;

/// A velocity this near to a contact's normal, relatively, has a tangential part of rounding only, without direction.
const NO_TANGENT: f64 = 1e-14;

/// (force, torque).
pub(super) type Vec6 = [f64; 6];

pub(super) fn dot(a: &Vec6, b: &Vec6) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5]
}

/// a -= along b.
pub(super) fn subtract(a: &mut Vec6, along: f64, b: &Vec6) {
    for (a, b) in a.iter_mut().zip(b) {
        *a -= along * b;
    }
}

pub(super) fn norm(a: &Vec6) -> f64 {
    dot(a, a).sqrt()
}

pub(super) fn join(force: DVec3, torque: DVec3) -> Vec6 {
    [force.x, force.y, force.z, torque.x, torque.y, torque.z]
}

pub(super) fn split(w: &Vec6) -> (DVec3, DVec3) {
    (DVec3::new(w[0], w[1], w[2]), DVec3::new(w[3], w[4], w[5]))
}

/// One contact without units.
#[derive(Clone, Copy, Debug)]
pub(super) struct ScaledContact {
    /// Lever arm, in R.
    pub r: DVec3,
    pub n: DVec3,
    pub t1: DVec3,
    pub t2: DVec3,
    pub mu: f64,
}

impl ScaledContact {
    pub fn wrench(&self, force: DVec3) -> Vec6 {
        join(force, self.r.cross(force))
    }
}

/// The friction polygon of a pyramid, in units of mu f_n: corners, and faces `normal . f_t <= apothem`.
#[derive(Clone, Debug)]
pub(super) struct Polygon {
    sides: usize,
    corners: [[f64; 2]; MAX_SIDES as usize],
    faces: [[f64; 2]; MAX_SIDES as usize],
    pub apothem: f64,
}

impl Polygon {
    /// Without sides, until a pyramid is asked for.
    const NONE: Polygon = Polygon {
        sides: 0,
        corners: [[0.0; 2]; MAX_SIDES as usize],
        faces: [[0.0; 2]; MAX_SIDES as usize],
        apothem: 1.0,
    };

    fn set(&mut self, sides: u32, fit: Fit) {
        self.sides = sides as usize;
        let half = std::f64::consts::PI / f64::from(sides);
        let reach = match fit {
            Fit::Inscribed => 1.0,
            Fit::Circumscribed => 1.0 / libm::cos(half),
        };
        self.apothem = reach * libm::cos(half);
        // Face 0 looks along t1, so that four circumscribed sides are the paper's |f_t1|, |f_t2| <= mu f_n.
        for k in 0..self.sides {
            let (s, c) = libm::sincos(2.0 * half * k as f64);
            self.faces[k] = [c, s];
            let (s, c) = libm::sincos(2.0 * half * (k as f64 + 0.5));
            self.corners[k] = [reach * c, reach * s];
        }
    }

    fn corners(&self) -> &[[f64; 2]] {
        &self.corners[..self.sides]
    }

    pub fn faces(&self) -> &[[f64; 2]] {
        &self.faces[..self.sides]
    }

    /// The least mu f_n that allows this tangential force.
    fn uses(&self, f1: f64, f2: f64) -> f64 {
        self.faces().iter().map(|m| m[0] * f1 + m[1] * f2).fold(0.0, f64::max) / self.apothem
    }
}

/// Tolerances of a proof.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tolerances {
    pub residual: f64,
    pub friction: f64,
    pub certificate: f64,
    pub excluded_force: f64,
}

impl Tolerances {
    pub const OWN: Tolerances = Tolerances {
        residual: STABLE_RESIDUAL,
        friction: PROOF_TOLERANCE,
        certificate: PROOF_TOLERANCE,
        excluded_force: EXCLUDED_FORCE,
    };
    /// An interior point stops at about 1e-8 of everything, before its multipliers are scaled to length one.
    pub const REFERENCE: Tolerances = Tolerances {
        residual: REFERENCE_RESIDUAL,
        friction: REFERENCE_RESIDUAL,
        certificate: 1e-6,
        excluded_force: REFERENCE_EXCLUDED_FORCE,
    };
    /// For the reference where the fast solver found no proof: it may not say "stable" on weaker grounds than the fast
    /// solver, whose verdicts reach nearer to the boundary than an interior point's.
    pub const FALLBACK: Tolerances =
        Tolerances { residual: STABLE_RESIDUAL, friction: PROOF_TOLERANCE, ..Tolerances::REFERENCE };
}

/// A unit wrench as a proof of instability, and the result of its substitution.
#[derive(Clone, Copy, Debug)]
pub(super) struct Certificate {
    pub z: Vec6,
    /// z . b.
    pub residual: f64,
    /// Largest work that a contact force of unit normal component does with z; <= 0 in exact arithmetic.
    pub violation: f64,
}

impl Certificate {
    pub fn proves(&self, t: Tolerances) -> bool {
        self.residual > t.residual
            && self.violation <= t.certificate
            && self.violation * t.excluded_force <= self.residual
    }

    pub fn wrench(&self) -> Wrench {
        let (force, torque) = split(&self.z);
        Wrench { force, torque }
    }
}

/// Outcome of a solver, after substitution.
#[derive(Clone, Copy, Debug)]
pub(super) enum SolverOutcome {
    /// The analyser's `forces` are the proof.
    Stable {
        residual: f64,
    },
    Unstable(Certificate),
}

#[derive(Clone, Debug)]
pub(super) struct ScaledProblem {
    contacts: Vec<ScaledContact>,
    law: FrictionLaw,
    polygon: Polygon,
    /// Factor on every friction coefficient.
    pub friction_scale: f64,
    /// The wrench that the contacts must exert: against gravity, of length one (or zero, without gravity).
    target: Vec6,
}

impl Default for ScaledProblem {
    fn default() -> Self {
        ScaledProblem {
            contacts: Vec::new(),
            law: FrictionLaw::Cone,
            polygon: Polygon::NONE,
            friction_scale: 1.0,
            target: [0.0; 6],
        }
    }
}

impl ScaledProblem {
    /// Removes the units, and refuses input without physical meaning.
    pub fn set(&mut self, p: &LocalProblem, law: FrictionLaw) -> Result<(), ProblemError> {
        if !(p.mass > 0.0 && p.mass.is_finite()) {
            return Err(ProblemError::Mass(p.mass));
        }
        if !(p.radius > 0.0 && p.radius.is_finite()) {
            return Err(ProblemError::Radius(p.radius));
        }
        if !p.center_of_mass.is_finite() {
            return Err(ProblemError::CenterOfMass);
        }
        if !p.gravity.is_finite() {
            return Err(ProblemError::Gravity);
        }
        self.set_law(law)?;
        self.friction_scale = 1.0;
        self.target = join(-direction(p.gravity).unwrap_or(DVec3::ZERO), DVec3::ZERO);
        self.contacts.clear();
        self.contacts.reserve(p.contacts.len());
        for (index, c) in p.contacts.iter().enumerate() {
            let r = (c.point - p.center_of_mass) / p.radius;
            if !(r.is_finite() && r.abs().max_element() <= LARGEST) {
                return Err(ProblemError::Point(index));
            }
            let n = direction(c.normal).ok_or(ProblemError::Normal(index))?;
            if !(c.friction >= 0.0 && c.friction.is_finite()) {
                return Err(ProblemError::Friction { index, friction: c.friction });
            }
            let (t1, t2) = n.any_orthonormal_pair();
            self.contacts.push(ScaledContact { r, n, t1, t2, mu: c.friction });
        }
        Ok(())
    }

    fn set_law(&mut self, law: FrictionLaw) -> Result<(), ProblemError> {
        if let FrictionLaw::Pyramid { sides, fit } = law
            && self.law != law
        {
            if !(3..=MAX_SIDES).contains(&sides) {
                return Err(ProblemError::Sides(sides));
            }
            self.polygon.set(sides, fit);
        }
        self.law = law;
        Ok(())
    }

    pub fn len(&self) -> usize {
        self.contacts.len()
    }

    pub fn contacts(&self) -> &[ScaledContact] {
        &self.contacts
    }

    pub fn law(&self) -> FrictionLaw {
        self.law
    }

    pub fn polygon(&self) -> &Polygon {
        &self.polygon
    }

    /// The friction coefficient that counts.
    pub fn mu(&self, contact: &ScaledContact) -> f64 {
        contact.mu * self.friction_scale
    }

    pub fn target(&self) -> Vec6 {
        self.target
    }

    /// Of all forces at this contact with normal component one, the work that the best does at virtual velocity `v`;
    /// `None` if that is no more than `bar`.
    pub fn offer(&self, contact: &ScaledContact, v: DVec3, bar: f64) -> Option<f64> {
        let along = v.dot(contact.n);
        let mu = self.mu(contact);
        let missing = bar - along;
        if self.law == FrictionLaw::Cone {
            let speed2 = (v - along * contact.n).length_squared();
            // Most contacts are settled without the root.
            if missing >= 0.0 && mu * mu * speed2 <= missing * missing {
                return None;
            }
            return Some(along + mu * speed2.sqrt());
        }
        let (v1, v2) = (v.dot(contact.t1), v.dot(contact.t2));
        let most = self.polygon.corners().iter().map(|c| c[0] * v1 + c[1] * v2).fold(0.0, f64::max);
        (mu * most > missing).then_some(along + mu * most)
    }

    /// The force that does the work of [`ScaledProblem::offer`].
    pub fn best_force(&self, contact: &ScaledContact, v: DVec3) -> DVec3 {
        let mu = self.mu(contact);
        if self.law == FrictionLaw::Cone {
            let along = v.dot(contact.n);
            let tangential = v - along * contact.n;
            let speed = tangential.length();
            if speed <= NO_TANGENT * along.abs() {
                return contact.n;
            }
            // The subtraction above leaves a normal part of the size of rounding; relative to a small tangential part
            // it matters.
            let t = tangential / speed;
            return contact.n + mu * (t - t.dot(contact.n) * contact.n);
        }
        let (v1, v2) = (v.dot(contact.t1), v.dot(contact.t2));
        let mut best = 0.0;
        let mut tangent = DVec3::ZERO;
        for c in self.polygon.corners() {
            let work = c[0] * v1 + c[1] * v2;
            if work > best * TIE {
                best = work;
                tangent = c[0] * contact.t1 + c[1] * contact.t2;
            }
        }
        contact.n + mu * tangent
    }

    /// `force`, of unit normal component, with its tangential part shortened to the friction limit.
    pub fn within_friction(&self, contact: &ScaledContact, force: DVec3) -> DVec3 {
        let mu = self.mu(contact);
        let tangential = force - contact.n;
        let used = match self.law {
            FrictionLaw::Cone => tangential.length(),
            FrictionLaw::Pyramid { .. } => self.polygon.uses(force.dot(contact.t1), force.dot(contact.t2)),
        };
        if used > mu { contact.n + tangential * (mu / used) } else { force }
    }

    /// Substitutes forces (by mg) into Eq. 1: the norm of the wrench left over.
    pub fn residual_of(&self, forces: &[DVec3]) -> f64 {
        let mut left = self.target;
        for (contact, f) in self.contacts.iter().zip(forces) {
            let w = contact.wrench(*f);
            subtract(&mut left, 1.0, &w);
        }
        norm(&left)
    }

    /// Is this residual small enough, for forces of this size?
    pub fn balances(&self, residual: f64, forces: &[DVec3], t: Tolerances) -> bool {
        let total: f64 = self.contacts.iter().zip(forces).map(|(contact, f)| f.dot(contact.n).abs()).sum();
        residual <= t.residual + FORCE_ROUNDING * total
    }

    /// Substitutes forces into Eq. 2 to 4.
    pub fn obeys_friction(&self, forces: &[DVec3], t: Tolerances) -> bool {
        self.contacts.iter().zip(forces).all(|(contact, f)| {
            let normal = f.dot(contact.n);
            let mu = self.mu(contact);
            let used = match self.law {
                FrictionLaw::Cone => (*f - normal * contact.n).length(),
                FrictionLaw::Pyramid { .. } => self.polygon.uses(f.dot(contact.t1), f.dot(contact.t2)),
            };
            let excess = used - mu * normal;
            normal >= -t.friction && excess <= t.friction * (1.0 + normal.abs())
        })
    }

    /// Substitutes a direction: does it prove that no forces exist?
    pub fn certificate(&self, y: Vec6) -> Certificate {
        let scale = 1.0 / norm(&y);
        let z = y.map(|k| k * scale);
        let (velocity, spin) = split(&z);
        let mut violation = f64::NEG_INFINITY;
        for contact in &self.contacts {
            let work = self.offer(contact, velocity + spin.cross(contact.r), f64::NEG_INFINITY);
            violation = violation.max(work.unwrap_or(f64::NEG_INFINITY));
        }
        Certificate { z, residual: dot(&z, &self.target), violation }
    }
}

/// Unit vector along `v`, without overflow; `None` if there is none.
fn direction(v: DVec3) -> Option<DVec3> {
    let largest = v.abs().max_element();
    (v.is_finite() && largest > 1.0 / LARGEST).then(|| (v / largest).normalize())
}
