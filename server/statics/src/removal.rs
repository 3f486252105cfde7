//! What stands once a body is taken away.
//!
//! The question is global, and its answer is nearly always local: forces that balance the whole pile are known, and a
//! body that goes leaves its neighbours short of what it gave them. A *region* around it is looked at in two ways:
//!
//! - *Inside*: the forces on the region from outside stay as they are. If forces within the region balance it without
//!   the body, the whole pile is balanced by these and the old ones outside: the body is **safe** to remove.
//! - *Outside*: whatever touches the region from outside is held fixed, and may push as it likes. If even so no forces
//!   balance the region, no forces balance the pile: something **falls**, and the proof's motion names what.
//!
//! A body high up hands its weight down to the ground, through all that is below it: there the forces before are
//! corrected, without a program (affine scaling, as for glue), which proves most of what is safe. Where nothing is
//! proven, the region grows by its neighbours. Both looks are limit programs ([`crate::limit`]): the forces of the body
//! are withdrawn by a share t, and the question is whether t reaches 1. So both have an answer at t = 0. What is still
//! open in the largest region stays [`Outcome::Open`], which nobody should take for safe.
//!
//! That forces exist does not mean that they will act: see [`crate::limit`]. So a removal is called safe only if a
//! share of each contact's friction suffices; and it is called a fall only if all of it does not.

use crate::global::{BALANCED, GlobalBody, GlobalContact, GlobalProblem, GlobalProblemError};
use crate::glue::{self, GlueProblem, GlueSite};
use crate::limit::{self, Accuracy, Limit, LimitProblem, Load};
use crate::local::{Analyser, LocalContact, LocalProblem};
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;

/// A force that is less than this share of a neighbour's weight is a rounding.
const NOTHING: f64 = 1e-8;

/// The most bodies of a region.
pub const LARGEST_REGION: usize = 30;
/// The most bodies whose forces are corrected, at first and where that does not suffice; and the imbalance, in weights,
/// beyond which more bodies hardly ever help.
const CORRECTED: [(usize, f64); 2] = [(40, 3.0), (400, 0.0)];
/// Programs for all removals from a pile of one body; of more, a share: between these two. What is not settled then
/// stays open.
const PROGRAMS: u64 = 200_000;
const LEAST_PROGRAMS: u64 = 200;
const MOST_PROGRAMS: u64 = 3000;
/// Neighbours of neighbours, so many times, are corrected wherever they are; beyond, only what is lower.
const RINGS: usize = 3;
/// A moment of a site counts as the force at this distance, in radii. It has no joint.
const ARM: f64 = 0.25;

/// What becomes of the others.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// They stand, by forces that differ from the former ones at these contacts.
    Safe { forces: Vec<(usize, DVec3)> },
    /// These begin to move, ascending.
    Falls { moving: Vec<usize> },
    /// Neither is proven.
    Open,
}

/// A pile from which bodies are taken.
pub struct Removals<'a> {
    pile: GlobalProblem<'a>,
    /// Shape `[body]`, indices of contacts.
    touching: Vec<Vec<usize>>,
    gone: Vec<bool>,
    /// Balance the bodies that are left, shape `[contact]`.
    forces: Vec<DVec3>,
    /// Of each contact's friction: what may be used by bodies that are called safe, 0 to 1. Shape `[contact]`.
    shares: Vec<f64>,
    analyser: Analyser,
    /// Programs solved.
    pub programs: u64,
}

impl<'a> Removals<'a> {
    /// `forces`: a balance of the whole pile with these shares of friction, both of shape `[contact]`.
    pub fn new(pile: GlobalProblem<'a>, forces: Vec<DVec3>, shares: Vec<f64>) -> Removals<'a> {
        let mut touching = vec![Vec::new(); pile.bodies.len()];
        for (index, contact) in pile.contacts.iter().enumerate() {
            touching[contact.body].push(index);
            if let Some(other) = contact.other {
                touching[other].push(index);
            }
        }
        let gone = vec![false; pile.bodies.len()];
        Removals { pile, touching, gone, forces, shares, analyser: Analyser::new(), programs: 0 }
    }

    /// Bodies that are left and touch this one, ascending.
    pub fn neighbours(&self, body: usize) -> Vec<usize> {
        let contacts = self.touching[body].iter().map(|&at| &self.pile.contacts[at]);
        let others = contacts.filter_map(|c| if c.body == body { c.other } else { Some(c.body) });
        let mut others: Vec<usize> = others.filter(|&other| !self.gone[other]).collect();
        others.sort_unstable();
        others.dedup();
        others
    }

    /// The forces that balance the bodies that are left.
    pub fn forces(&self) -> &[DVec3] {
        &self.forces
    }

    pub fn is_gone(&self, body: usize) -> bool {
        self.gone[body]
    }

    /// Takes a body away for good, after a safe outcome.
    pub fn take(&mut self, body: usize, forces: &[(usize, DVec3)]) {
        self.gone[body] = true;
        self.touching[body].iter().for_each(|&at| self.forces[at] = DVec3::ZERO);
        forces.iter().for_each(|&(at, force)| self.forces[at] = force);
    }

    /// What would become of the others without this one. `going`: called before each program; `Break` leaves it open.
    pub fn without(
        &mut self,
        body: usize,
        going: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<Outcome, GlobalProblemError> {
        let neighbours = self.neighbours(body);
        if self.carries_nothing(body) {
            return Ok(Outcome::Safe { forces: Vec::new() });
        }
        // The outside of a region of one body, in microseconds.
        let alone: Vec<usize> = neighbours.iter().copied().filter(|&other| self.falls_alone(other, body)).collect();
        if !alone.is_empty() {
            return Ok(Outcome::Falls { moving: alone });
        }
        if let Some(forces) = self.rebalanced(body, &neighbours, going) {
            return Ok(Outcome::Safe { forces });
        }
        let mut region = neighbours;
        let most_programs = (PROGRAMS / self.gone.len() as u64).clamp(LEAST_PROGRAMS, MOST_PROGRAMS);
        loop {
            if going().is_break() || self.programs >= most_programs {
                return Ok(Outcome::Open);
            }
            let inside = self.region(body, &region, true)?;
            if inside.limit.reaches(1.0) {
                return Ok(Outcome::Safe { forces: inside.forces() });
            }
            let outside = self.region(body, &region, false)?;
            if outside.limit.falls_from < 1.0 - BALANCED.sqrt() {
                return Ok(Outcome::Falls { moving: outside.limit.moving().map(|at| region[at]).collect() });
            }
            let mut wider: Vec<usize> = region.iter().flat_map(|&member| self.neighbours(member)).collect();
            wider.extend(&region);
            wider.retain(|&member| member != body);
            wider.sort_unstable();
            wider.dedup();
            if wider.len() == region.len() || wider.len() > LARGEST_REGION {
                return Ok(Outcome::Open);
            }
            region = wider;
        }
    }

    /// Whether a body falls without another, even if all other neighbours of it are held.
    fn falls_alone(&mut self, body: usize, without: usize) -> bool {
        let contacts: Vec<LocalContact> =
            self.contacts_of(body).filter(|&(_, other)| other != Some(without)).map(|(contact, _)| contact).collect();
        let GlobalBody { mass, center_of_mass, radius } = self.pile.bodies[body];
        let problem = LocalProblem { contacts: &contacts, mass, center_of_mass, radius, gravity: self.pile.gravity };
        self.analyser.analyse(&problem, &Default::default()).is_ok_and(|verdict| !verdict.is_stable())
    }

    /// The contacts of a body with what is left, normals into it; each with the other body.
    pub fn contacts_of(&self, body: usize) -> impl Iterator<Item = (LocalContact, Option<usize>)> + '_ {
        let contact = move |&at: &usize| {
            let c = &self.pile.contacts[at];
            let (normal, other) = if c.body == body { (c.normal, c.other) } else { (-c.normal, Some(c.body)) };
            let is_there = other.is_none_or(|other| !self.gone[other]);
            is_there.then_some((LocalContact { point: c.point, normal, friction: c.friction }, other))
        };
        self.touching[body].iter().filter_map(contact)
    }

    /// Forces without the body, corrected from those with it: of its neighbours, and of all that is below these.
    fn rebalanced(
        &self,
        body: usize,
        neighbours: &[usize],
        going: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Option<Vec<(usize, DVec3)>> {
        for (most, hopeless) in CORRECTED {
            let corrected = self.rebalanced_of(body, neighbours, most, going)?;
            if corrected.imbalance <= BALANCED {
                return Some(corrected.forces);
            }
            if corrected.is_all || corrected.imbalance > hopeless {
                break;
            }
        }
        None
    }

    /// The same where the forces of at most so many bodies are corrected, balanced or not.
    fn rebalanced_of(
        &self,
        body: usize,
        neighbours: &[usize],
        most: usize,
        going: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Option<Corrected> {
        let depth = |one: usize| self.pile.bodies[one].center_of_mass.dot(self.pile.gravity);
        let mut members = neighbours.to_vec();
        let mut seen: BTreeSet<usize> = members.iter().copied().chain([body]).collect();
        let (mut at, mut ring) = (0, (0, members.len()));
        while at < members.len() && members.len() < most {
            if at == ring.1 {
                ring = (ring.0 + 1, members.len());
            }
            let one = members[at];
            let joins = |other: usize| ring.0 < RINGS || depth(other) > depth(one);
            members.extend(self.neighbours(one).into_iter().filter(|&other| joins(other) && seen.insert(other)));
            at += 1;
        }
        let is_all = at == members.len();
        members.sort_unstable();
        let number: BTreeMap<usize, usize> = members.iter().enumerate().map(|(k, &member)| (member, k)).collect();
        let bodies: Vec<GlobalBody> = members.iter().map(|&member| self.pile.bodies[member]).collect();
        let mut loads = vec![Load::default(); bodies.len()];
        let (mut contacts, mut places, mut sites): (Vec<GlobalContact>, Vec<usize>, Vec<GlueSite>) = Default::default();
        for at in self.touching_any(&members) {
            let c = &self.pile.contacts[at];
            let ends = [Some(c.body), c.other];
            if ends.contains(&Some(body)) || ends.iter().flatten().any(|&end| self.gone[end]) {
                continue;
            }
            let inside = ends.map(|end| end.and_then(|end| number.get(&end).copied()));
            if let ([Some(first), other], true) = (inside, c.other.is_none() || inside[1].is_some()) {
                match sites.last_mut() {
                    Some(last) if (last.body, last.other) == (first, other) => last.contacts.end += 1,
                    _ => sites.push(GlueSite {
                        body: first,
                        other,
                        contacts: contacts.len()..contacts.len() + 1,
                        center: c.point,
                        arm: ARM * bodies[first].radius,
                        may_glue: false,
                        normal_price: 0.0,
                    }),
                }
                contacts.push(GlobalContact { body: first, other, friction: self.shares[at] * c.friction, ..*c });
                places.push(at);
                continue;
            }
            for (k, sign) in inside.into_iter().zip([1.0, -1.0]).filter_map(|(k, sign)| Some((k?, sign))) {
                let force = sign * self.forces[at];
                loads[k].force += force;
                loads[k].moment += (c.point - bodies[k].center_of_mass).cross(force);
            }
        }
        let problem = GlueProblem { bodies: &bodies, contacts: &contacts, sites: &sites, gravity: self.pile.gravity };
        let forces: Vec<DVec3> = places.iter().map(|&at| self.forces[at]).collect();
        let (forces, imbalance) = glue::rebalance(&problem, &loads, &forces, going).ok()?;
        Some(Corrected { forces: places.into_iter().zip(forces).collect(), imbalance, is_all })
    }

    /// Contacts that touch one of these bodies, ascending.
    fn touching_any(&self, members: &[usize]) -> Vec<usize> {
        let mut touching: Vec<usize> =
            members.iter().flat_map(|&member| self.touching[member].iter().copied()).collect();
        touching.sort_unstable();
        touching.dedup();
        touching
    }

    /// What the known forces leave unbalanced of a body.
    fn left(&self, body: usize) -> Load {
        let GlobalBody { mass, center_of_mass, .. } = self.pile.bodies[body];
        let mut left = Load { force: mass * self.pile.gravity, moment: DVec3::ZERO };
        for &at in &self.touching[body] {
            let c = &self.pile.contacts[at];
            let force = if c.body == body { self.forces[at] } else { -self.forces[at] };
            left.force += force;
            left.moment += (c.point - center_of_mass).cross(force);
        }
        left
    }

    /// Whether a body's forces on its neighbours are a rounding.
    fn carries_nothing(&self, body: usize) -> bool {
        let nothing = |&at: &usize| {
            let c = &self.pile.contacts[at];
            let other = if c.body == body { c.other } else { Some(c.body) };
            let weight = |other: usize| self.pile.bodies[other].mass * self.pile.gravity.length();
            other.is_none_or(|other| self.gone[other] || self.forces[at].length() <= NOTHING * weight(other))
        };
        self.touching[body].iter().all(nothing)
    }

    /// The limit to which a body's forces on a region may be withdrawn. `is_closed`: forces from outside stay as they
    /// are; otherwise the outside is fixed.
    fn region(&mut self, body: usize, members: &[usize], is_closed: bool) -> Result<Region, GlobalProblemError> {
        self.programs += 1;
        let number: BTreeMap<usize, usize> = members.iter().enumerate().map(|(k, &member)| (member, k)).collect();
        let bodies: Vec<GlobalBody> = members.iter().map(|&member| self.pile.bodies[member]).collect();
        let mut dead = limit::weights(&bodies, self.pile.gravity);
        let mut live = vec![Load::default(); bodies.len()];
        let (mut contacts, mut places) = (Vec::new(), Vec::new());
        for at in self.touching_any(members) {
            let c = &self.pile.contacts[at];
            let ends = [Some(c.body), c.other];
            if ends.iter().flatten().any(|&end| self.gone[end]) {
                continue;
            }
            let inside = ends.map(|end| end.and_then(|end| number.get(&end).copied()));
            let is_from_body = ends.contains(&Some(body));
            let is_from_outside = !is_from_body && ends.iter().zip(inside).any(|(end, k)| end.is_some() && k.is_none());
            if is_from_body || is_closed && is_from_outside {
                for (k, sign) in inside.into_iter().zip([1.0, -1.0]).filter_map(|(k, sign)| Some((k?, sign))) {
                    let force = sign * self.forces[at];
                    let moment = (c.point - bodies[k].center_of_mass).cross(force);
                    dead[k].force += force;
                    dead[k].moment += moment;
                    if is_from_body {
                        live[k].force -= force;
                        live[k].moment -= moment;
                    }
                }
                continue;
            }
            let friction = c.friction * if is_closed { self.shares[at] } else { 1.0 };
            let contact = match inside {
                [Some(body), other] => GlobalContact { body, other, friction, ..*c },
                // Seen from the other side.
                [None, Some(body)] => GlobalContact { body, other: None, normal: -c.normal, friction, ..*c },
                [None, None] => continue,
            };
            contacts.push(contact);
            places.push((at, if inside[0].is_some() { 1.0 } else { -1.0 }));
        }
        // The known forces leave a rounding unbalanced, which a body whose contacts all lead outside could not bear.
        for (k, &member) in members.iter().enumerate() {
            let left = self.left(member);
            dead[k].force -= left.force;
            dead[k].moment -= left.moment;
        }
        let gravity = self.pile.gravity.length();
        let (bodies, contacts, accuracy) = (&*bodies, &*contacts, Accuracy::Fast);
        let problem = LimitProblem { bodies, contacts, gravity, dead: &dead, live: &live, most: 1.0, accuracy };
        let limit = limit::find(&problem)?;
        Ok(Region { limit, places })
    }
}

/// Forces corrected for a body that is gone.
struct Corrected {
    /// By contact.
    forces: Vec<(usize, DVec3)>,
    /// Sum over the bodies, each relative to its weight.
    imbalance: f64,
    /// No more bodies could be corrected.
    is_all: bool,
}

/// The limit of a region.
struct Region {
    limit: Limit,
    /// Contact of the pile, and its direction there. Shape `[contact of the region]`.
    places: Vec<(usize, f64)>,
}

impl Region {
    fn forces(&self) -> Vec<(usize, DVec3)> {
        self.places.iter().zip(&self.limit.forces).map(|(&(at, sign), force)| (at, sign * *force)).collect()
    }
}
