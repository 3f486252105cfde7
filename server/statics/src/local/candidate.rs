//! Which bodies in local equilibrium may be held (Hsu & Keyser 2012, section 3.3).
//!
//! A body in equilibrium is a candidate if it keeps a **reserve of friction** (Eq. 5), has **enough contacts** (three),
//! and these have **spread** (Eq. 6).
//!
//! # Reserve of friction
//!
//! Eq. 5 asks |f_t| < mu_k f_n at each contact, mu_k < mu_s, of *the* forces. But forces are not unique, and the answer
//! then depends on the solver. Both readings are kept:
//!
//! - [`ReserveRule::Paper`]: the forces of the interior-point solver are tested. It ends near the center of the
//!   feasible set, where friction is near its limit at some contact for no physical reason: most standing bodies fail.
//! - [`ReserveRule::Sharp`]: *some* forces satisfy mu_k. That is equilibrium with mu_k in place of mu_s, it depends on
//!   nothing but the body, and it implies Eq. 2 to 4.
//!
//! # Spread
//!
//! Eq. 6 sums the areas of the triangles (p_i, p_i-1, p_i-2). The sum depends on the order of the points, grows with
//! their number, and is zero for some well-spread sets, as the paper says. [`SpreadRule::Relative`] measures what the
//! sum is meant to measure, an area that vanishes if the points are close together or on a line:
//!
//! *the area of the convex hull of the contacts, projected onto the plane of the longest chord between two of them and
//! the contact farthest from that chord.*
//!
//! It does not depend on the points' order or repetition. For three points it equals Eq. 6; for coplanar points it is
//! the area of their hull (for the corners of a rectangle in turn, Eq. 6 again). In general neither bounds the other: a
//! round support of many points has a large hull and slender triangles, repeated zigzags add up in Eq. 6 only.

use super::analyser::{Analyser, Start};
use super::scaled::SolverOutcome;
use super::{LocalProblem, Options, PROOF_TOLERANCE, ProblemError, Solver};
use glam::{DVec2, DVec3};

/// Contacts nearer to each other than this share of the body's radius support like one. Contact points of a
/// single-precision engine repeat within 1e-6; contacts 1e-4 R apart resist no tilt worth the name.
pub const DISTINCT: f64 = 1e-4;

/// Eq. 5, in its two readings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ReserveRule {
    /// The interior-point solver's forces satisfy mu_k. Always asks Clarabel, at its price: the reading has no meaning
    /// without the interior point.
    Paper,
    /// Forces exist that satisfy mu_k.
    #[default]
    Sharp,
}

/// Eq. 6, in its two readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SpreadRule {
    /// Eq. 6 in the order of the contacts, at least this many m^2 (alpha, 0.5 in Table 1).
    Paper(f64),
    /// Area of the contacts' hull, at least this `share` of `area` (such as the body's own smallest face area).
    Relative { share: f64, area: f64 },
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CandidateRules {
    pub reserve: ReserveRule,
    /// mu_k / mu_s, 0 to 1. Table 1: 6/7.
    pub kinetic_ratio: f64,
    pub spread: SpreadRule,
    /// Distinct contacts needed. The paper: 3.
    pub contacts: usize,
}

/// Whether a body may be held, or the first rule that forbids it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Candidacy {
    Candidate,
    /// Not in local equilibrium.
    Unstable,
    /// In equilibrium, but not at kinetic friction (Eq. 5).
    NoReserve,
    /// Fewer than the distinct contacts needed.
    FewContacts,
    /// Contacts close together or in a line (Eq. 6).
    NoSpread,
    /// There is no gravity to stand against.
    Weightless,
}

impl Candidacy {
    /// In local equilibrium, candidate or not.
    pub fn is_stable(self) -> bool {
        self != Candidacy::Unstable
    }
}

impl Analyser {
    /// May this body be held (section 3.3)? Equilibrium is judged first, so that `Unstable` means what it says.
    pub fn candidate(
        &mut self,
        problem: &LocalProblem,
        options: &Options,
        rules: &CandidateRules,
    ) -> Result<Candidacy, ProblemError> {
        self.scaled.set(problem, options.friction_law)?;
        if self.scaled.target() == [0.0; 6] {
            return Ok(Candidacy::Weightless);
        }
        let refusal = match rules.reserve {
            ReserveRule::Sharp => self.sharp(options.solver, rules.kinetic_ratio),
            ReserveRule::Paper => self.paper(rules.kinetic_ratio),
        };
        if let Some(refusal) = refusal {
            return Ok(refusal);
        }
        if distinct(problem, &mut self.points) < rules.contacts {
            return Ok(Candidacy::FewContacts);
        }
        let spread = match rules.spread {
            SpreadRule::Paper(alpha) => triangles(problem) >= alpha,
            SpreadRule::Relative { share, area } => hull_area(&mut self.points) >= share * area,
        };
        Ok(if spread { Candidacy::Candidate } else { Candidacy::NoSpread })
    }

    /// mu_k first: it implies mu_s, and most bodies that stand pass.
    fn sharp(&mut self, solver: Solver, ratio: f64) -> Option<Candidacy> {
        self.scaled.friction_scale = if ratio > 0.0 { ratio.min(1.0) } else { 0.0 };
        let with_reserve = self.decide(solver, Start::Cold);
        self.scaled.friction_scale = 1.0;
        if let SolverOutcome::Stable { .. } = with_reserve {
            self.count(&with_reserve);
            return None;
        }
        // The generators loaded at mu_k lie within mu_s, too.
        let start = if solver == Solver::Fast { Start::Loaded } else { Start::Cold };
        let outcome = self.decide(solver, start);
        self.count(&outcome);
        Some(if let SolverOutcome::Stable { .. } = outcome { Candidacy::NoReserve } else { Candidacy::Unstable })
    }

    fn paper(&mut self, ratio: f64) -> Option<Candidacy> {
        let outcome = self.decide(Solver::Clarabel, Start::Cold);
        self.count(&outcome);
        if let SolverOutcome::Unstable(_) = outcome {
            return Some(Candidacy::Unstable);
        }
        let keeps = self.scaled.contacts().iter().zip(&self.forces).all(|(contact, f)| {
            let normal = f.dot(contact.n);
            let limit = ratio * contact.mu * normal;
            normal <= PROOF_TOLERANCE || (f.dot(contact.t1).abs() < limit && f.dot(contact.t2).abs() < limit)
        });
        (!keeps).then_some(Candidacy::NoReserve)
    }
}

/// Eq. 6, in the order given, in the problem's unit of area.
pub fn triangles(problem: &LocalProblem) -> f64 {
    problem.contacts.windows(3).map(|w| (w[2].point - w[1].point).cross(w[2].point - w[0].point).length() / 2.0).sum()
}

/// Gathers the distinct points, and counts them. The first of a cluster stands for it.
fn distinct(problem: &LocalProblem, points: &mut Vec<DVec3>) -> usize {
    let near = DISTINCT * problem.radius;
    points.clear();
    for c in problem.contacts {
        if points.iter().all(|p| p.distance(c.point) > near) {
            points.push(c.point);
        }
    }
    points.len()
}

/// The area of [`SpreadRule::Relative`]. Uses the points up.
pub fn hull_area(points: &mut [DVec3]) -> f64 {
    // By value, so that the choice between equally long chords is the same in every order.
    points.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    let Some(((a, b), _)) = pairs(points).reduce(|best, next| if next.1 > best.1 { next } else { best }) else {
        return 0.0;
    };
    let Some(along) = (b - a).try_normalize() else { return 0.0 };
    let offset = |p: DVec3| (p - a) - (p - a).dot(along) * along;
    let far = points
        .iter()
        .map(|p| offset(*p))
        .fold(DVec3::ZERO, |m, o| if o.length_squared() > m.length_squared() { o } else { m });
    let Some(across) = far.try_normalize() else { return 0.0 };
    // From here on x and y are coordinates in the plane.
    for p in points.iter_mut() {
        let d = *p - a;
        *p = DVec3::new(d.dot(along), d.dot(across), 0.0);
    }
    points.sort_unstable_by(|p, q| p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)));
    half_area(points.iter().map(|p| p.truncate())) + half_area(points.iter().rev().map(|p| p.truncate()))
}

fn pairs(points: &[DVec3]) -> impl Iterator<Item = ((DVec3, DVec3), f64)> {
    points
        .iter()
        .enumerate()
        .flat_map(move |(i, a)| points[i + 1..].iter().map(move |b| ((*a, *b), a.distance_squared(*b))))
}

/// Shoelace sum along the hull's right-hand side, for points sorted along the chord: gift wrapping, which stores
/// nothing.
fn half_area(points: impl Iterator<Item = DVec2> + Clone) -> f64 {
    let mut rest = points;
    let Some(mut corner) = rest.next() else { return 0.0 };
    let mut sum = 0.0;
    loop {
        let mut next: Option<(DVec2, _)> = None;
        let mut ahead = rest.clone();
        while let Some(p) = ahead.next() {
            if next.as_ref().is_none_or(|(q, _)| (*q - corner).perp_dot(p - corner) <= 0.0) {
                next = Some((p, ahead.clone()));
            }
        }
        let Some((q, after)) = next else { return sum };
        sum += corner.perp_dot(q) / 2.0;
        (corner, rest) = (q, after);
    }
}
