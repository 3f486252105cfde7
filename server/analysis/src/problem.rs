//! The contacts of a pile as one problem of statics.

use super::Touch;
use crate::assembly::Assembly;
use cairn_engine::world::{BodyId, Units, World};
use cairn_statics::global::{GlobalBody, GlobalContact, GlobalProblem};
use cairn_statics::local::LocalContact;
use glam::DVec3;
use std::ops::Range;

/// A pair that touches in fewer points than this touches in a patch around each: round bodies would else stand on a
/// needle, which rounding knocks over.
const FEW: usize = 3;
/// Radius of such a patch, in the thickness of the thinner body. What can be seen of a real contact is larger.
const PATCH: f64 = 0.005;

/// Bodies that may move, and contacts between them and with all else. Engine units: gravity is 1.
pub struct PileContacts {
    /// The bodies, ascending.
    pub ids: Vec<BodyId>,
    /// Shape `[body]`, in the order of `ids`.
    pub bodies: Vec<GlobalBody>,
    pub contacts: Vec<GlobalContact>,
    /// The contacts of each pair, and how many points they stand for.
    pub pairs: Vec<(Range<usize>, usize)>,
    units: Units,
}

impl PileContacts {
    /// The world as it stands. Pairs count up to a gap of `gap` of the thinner body's thickness; pinned bodies carry
    /// like scenery.
    pub fn new(world: &World, gap: f64) -> PileContacts {
        PileContacts::of(world, gap, &|id| !world.bodies()[id].role.stands())
    }

    /// The same, where `moves` says which bodies may move.
    pub fn of(world: &World, gap: f64, moves: &dyn Fn(BodyId) -> bool) -> PileContacts {
        let mut assembly = Assembly::new(world, moves);
        let mut pairs = Vec::new();
        for pair in &world.contact_pairs(gap) {
            let points = assembly.contacts_of(pair);
            let radius = PATCH * world.pair_thickness(pair);
            let count = points.len();
            let contacts = match count {
                0 => continue,
                few if few < FEW => assembly.add(points.iter().flat_map(|contact| patch(contact, radius))),
                _ => assembly.add(points),
            };
            pairs.push((contacts, count));
        }
        let Assembly { ids, bodies, contacts } = assembly;
        PileContacts { ids, bodies, contacts, pairs, units: world.units }
    }

    /// The contacts of each body, normals into it, without those of bodies that are `gone`. Shape `[body]`.
    pub fn touching(&self, gone: &[bool]) -> Vec<Vec<LocalContact>> {
        let mut touching: Vec<Vec<LocalContact>> = vec![Vec::new(); self.bodies.len()];
        for c in &self.contacts {
            if gone[c.body] || c.other.is_some_and(|other| gone[other]) {
                continue;
            }
            let contact = LocalContact { point: c.point, normal: c.normal, friction: c.friction };
            touching[c.body].push(contact);
            if let Some(other) = c.other {
                touching[other].push(LocalContact { normal: -c.normal, ..contact });
            }
        }
        touching
    }

    /// The names of the bodies that are marked, shape `[body]`.
    pub fn named(&self, marked: &[bool]) -> Vec<BodyId> {
        self.ids.iter().zip(marked).filter(|(_, marked)| **marked).map(|(&id, _)| id).collect()
    }

    pub fn problem(&self) -> GlobalProblem<'_> {
        GlobalProblem { bodies: &self.bodies, contacts: &self.contacts, gravity: DVec3::NEG_Y }
    }

    /// A force of the engine's in newtons.
    pub fn newton(&self, force: f64) -> f64 {
        let Units { length, time, mass, .. } = self.units;
        force * mass * length / (time * time)
    }

    /// A point of the engine's, m.
    pub fn point(&self, point: DVec3) -> [f64; 3] {
        self.units.point_to_si(point).to_array()
    }

    /// The middle of a pair's points.
    pub fn middle(&self, contacts: &Range<usize>) -> DVec3 {
        let points = &self.contacts[contacts.clone()];
        points.iter().map(|c| c.point).sum::<DVec3>() / points.len().max(1) as f64
    }

    /// The pairs with their forces. Shape of `forces`: `[contact]`.
    pub fn touches(&self, forces: &[DVec3]) -> Vec<Touch> {
        let touch = |(contacts, points): &(Range<usize>, usize)| {
            let first = &self.contacts[contacts.start];
            let force: DVec3 = forces[contacts.clone()].iter().sum();
            Touch {
                body: self.ids[first.body],
                other: first.other.map(|other| self.ids[other]),
                points: *points,
                point: self.point(self.middle(contacts)),
                force: force.to_array().map(|f| self.newton(f)),
            }
        };
        self.pairs.iter().map(touch).collect()
    }
}

/// Three contacts around one.
fn patch(contact: &GlobalContact, radius: f64) -> [GlobalContact; 3] {
    let (u, v) = contact.normal.normalize().any_orthonormal_pair();
    [0.0, 1.0, 2.0].map(|k: f64| {
        let (sin, cos) = libm::sincos(k * std::f64::consts::TAU / 3.0);
        GlobalContact { point: contact.point + radius * (cos * u + sin * v), ..*contact }
    })
}
