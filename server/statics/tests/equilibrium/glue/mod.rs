//! The choice of glue joints: against known answers, Clarabel and substitution.

mod again;
mod bounded;
mod clarabel;
mod input;
mod known;
mod missing;
mod piles;
mod units;

use cairn_statics::global::{BALANCED, GlobalBody, GlobalContact};
use cairn_statics::glue::{self, GlueError, GlueOptions, GluePlacement, GlueProblem, GlueSite, interior_point};
use glam::{DQuat, DVec3};
use std::ops::ControlFlow;

pub const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);
pub const OPTIONS: GlueOptions =
    GlueOptions { friction_factor: 0.5, normal_price: 0.02, strength: None, rounds: glue::MOST_ROUNDS };

/// A pile that owns its parts, in SI units.
#[derive(Clone, Debug)]
pub struct Pile {
    pub bodies: Vec<GlobalBody>,
    pub contacts: Vec<GlobalContact>,
    pub sites: Vec<GlueSite>,
    pub gravity: DVec3,
}

impl Pile {
    pub fn new() -> Pile {
        Pile { bodies: Vec::new(), contacts: Vec::new(), sites: Vec::new(), gravity: GRAVITY }
    }

    pub fn problem(&self) -> GlueProblem<'_> {
        GlueProblem { bodies: &self.bodies, contacts: &self.contacts, sites: &self.sites, gravity: self.gravity }
    }

    /// Adds a body; returns its index.
    pub fn body(&mut self, mass: f64, center_of_mass: DVec3, radius: f64) -> usize {
        self.bodies.push(GlobalBody { mass, center_of_mass, radius });
        self.bodies.len() - 1
    }

    /// Adds a touch at these contact points, with one normal into `body`.
    pub fn site(&mut self, body: usize, other: Option<usize>, points: &[DVec3], normal: DVec3, friction: f64) {
        let begin = self.contacts.len();
        self.contacts.extend(points.iter().map(|&point| GlobalContact { body, other, point, normal, friction }));
        let center = points.iter().sum::<DVec3>() / points.len() as f64;
        let arm = self.arm(body, other);
        let contacts = begin..self.contacts.len();
        self.sites.push(GlueSite { body, other, contacts, center, arm, may_glue: true, normal_price: 0.0 });
    }

    /// Adds a touch that carries nothing but may be glued.
    pub fn peg(&mut self, body: usize, other: Option<usize>, center: DVec3) {
        let (at, arm) = (self.contacts.len(), self.arm(body, other));
        self.sites.push(GlueSite { body, other, contacts: at..at, center, arm, may_glue: true, normal_price: 0.0 });
    }

    fn arm(&self, body: usize, other: Option<usize>) -> f64 {
        let radius = |body: usize| self.bodies[body].radius;
        0.25 * other.map_or(f64::INFINITY, radius).min(radius(body))
    }

    pub fn place(&self, options: &GlueOptions) -> GluePlacement {
        self.try_place(options).expect("a valid pile")
    }

    pub fn try_place(&self, options: &GlueOptions) -> Result<GluePlacement, GlueError> {
        glue::place(&self.problem(), options, &mut || ControlFlow::Continue(()))
    }

    /// The same choice by Clarabel.
    pub fn place_by_clarabel(&self, options: &GlueOptions) -> GluePlacement {
        interior_point::place(&self.problem(), options, &mut || ControlFlow::Continue(())).expect("a valid pile")
    }

    /// The same pile in other units.
    pub fn in_units(&self, length: f64, mass: f64, acceleration: f64) -> Pile {
        let mut pile = self.clone();
        for body in &mut pile.bodies {
            body.mass *= mass;
            body.center_of_mass *= length;
            body.radius *= length;
        }
        pile.contacts.iter_mut().for_each(|c| c.point *= length);
        for site in &mut pile.sites {
            site.center *= length;
            site.arm *= length;
        }
        pile.gravity *= acceleration;
        pile
    }

    /// The same pile seen from a turned frame.
    pub fn turned(&self, q: DQuat) -> Pile {
        let mut pile = self.clone();
        pile.bodies.iter_mut().for_each(|b| b.center_of_mass = q * b.center_of_mass);
        for contact in &mut pile.contacts {
            contact.point = q * contact.point;
            contact.normal = q * contact.normal;
        }
        pile.sites.iter_mut().for_each(|t| t.center = q * t.center);
        pile.gravity = q * pile.gravity;
        pile
    }

    /// Substitutes joints and contact forces, in newtons and metres; returns the sum over the standing bodies of what
    /// is unbalanced, each in its weight and in weight times radius.
    pub fn unbalanced(&self, placed: &GluePlacement) -> f64 {
        let has_fallen = |body: &usize| placed.fallen.contains(body);
        let mut force: Vec<DVec3> = self.bodies.iter().map(|b| b.mass * self.gravity).collect();
        let mut moment = vec![DVec3::ZERO; self.bodies.len()];
        let mut apply = |body: usize, other: Option<usize>, point: DVec3, f: DVec3, m: DVec3| {
            for (body, sign) in [(Some(body), 1.0), (other, -1.0)].into_iter().filter_map(|(b, s)| Some((b?, s))) {
                assert!(!has_fallen(&body) || (f, m) == (DVec3::ZERO, DVec3::ZERO), "a fallen body carries");
                force[body] += sign * f;
                moment[body] += sign * (m + (point - self.bodies[body].center_of_mass).cross(f));
            }
        };
        for (c, f) in self.contacts.iter().zip(&placed.forces) {
            apply(c.body, c.other, c.point, *f, DVec3::ZERO);
        }
        for joint in &placed.joints {
            let site = &self.sites[joint.site];
            apply(site.body, site.other, site.center, joint.force, joint.moment);
        }
        let standing = (0..self.bodies.len()).filter(|body| !has_fallen(body));
        let left = standing.map(|b| {
            let weight = self.bodies[b].mass * self.gravity.length();
            (force[b] / weight).length().hypot((moment[b] / (weight * self.bodies[b].radius)).length())
        });
        left.sum()
    }

    /// Sum of the normal forces, in newtons.
    pub fn pressure(&self, placed: &GluePlacement) -> f64 {
        self.contacts.iter().zip(&placed.forces).map(|(c, f)| f.dot(c.normal)).sum()
    }

    /// Asserts all that a placement promises.
    pub fn certify(&self, placed: &GluePlacement, options: &GlueOptions, what: &str) {
        self.check_forces(placed, options, what);
        let left = self.unbalanced(placed);
        assert!(left <= BALANCED * 1.001, "{what}: {left:e} is unbalanced, {:e} is reported", placed.imbalance);
        assert!(placed.stands() && (left - placed.imbalance).abs() < 1e-9, "{what}: {left:e} {:e}", placed.imbalance);
    }

    /// Asserts what holds even where nothing stands.
    pub fn check_forces(&self, placed: &GluePlacement, options: &GlueOptions, what: &str) {
        assert_eq!(placed.forces.len(), self.contacts.len(), "{what}");
        for (c, f) in self.contacts.iter().zip(&placed.forces) {
            let normal = c.normal.normalize();
            let pressure = f.dot(normal);
            let slack = 1e-9 * f.length();
            assert!(pressure >= -slack, "{what}: a contact pulls, {f}");
            let sliding = (*f - pressure * normal).length();
            assert!(sliding <= options.friction_factor * c.friction * pressure + slack, "{what}: {f} slides");
        }
        let rises = |list: Vec<usize>, below: usize| list.is_sorted_by(|a, b| a < b) && list.iter().all(|i| *i < below);
        assert!(rises(joints(placed), self.sites.len()) && rises(placed.fallen.clone(), self.bodies.len()), "{what}");
        for joint in &placed.joints {
            assert!(
                self.sites[joint.site].may_glue && joint.force.is_finite() && joint.moment.is_finite(),
                "{what}: {joint:?}"
            );
            let carries = joint.force.length().hypot(joint.moment.length() / self.sites[joint.site].arm);
            assert!(
                options.strength.is_none_or(|most| carries <= most * (1.0 + 1e-9)),
                "{what}: {carries} in {joint:?}"
            );
        }
    }
}

pub fn joints(placed: &GluePlacement) -> Vec<usize> {
    placed.joints.iter().map(|joint| joint.site).collect()
}
