//! What contacts can give to a body that lands or rests, by statics.

use cairn_analysis::PileContacts;
use cairn_engine::world::{BodyId, World};
use cairn_geometry::contact::REAL_CONTACT;
use cairn_motion::glue::Joint;
use cairn_statics::local::{Analyser, LocalContact, LocalProblem};
use glam::DVec3;
use std::collections::BTreeSet;

/// A body is carried if its contacts give all but this share of its weight.
const CARRIED: f64 = 0.02;

/// The contacts and the glue of each body in the pile as it stands in the end. Engine units.
pub struct Supports {
    bodies: Vec<Support>,
}

#[derive(Clone, Default)]
struct Support {
    mass: f64,
    radius: f64,
    center: DVec3,
    /// Its place among all bodies, from the lowest upward.
    rank: usize,
    /// Each with the other body; `None`: something that stays.
    contacts: Vec<(LocalContact, Option<BodyId>)>,
    /// Bodies that glue joints join it to; `None`: something that stays.
    glue: Vec<Option<BodyId>>,
}

impl Supports {
    /// `comes`: whether a body comes in; all others stay where they are.
    pub fn new(world: &World, joints: &[Joint], comes: &dyn Fn(BodyId) -> bool) -> Supports {
        let mut bodies = vec![Support::default(); world.bodies().len()];
        for id in world.present() {
            let (body, center) = (&world.bodies()[id], world.pose(id).translation);
            bodies[id] = Support { mass: body.mass, radius: body.radius, center, ..Support::default() };
        }
        let contacts = PileContacts::of(world, REAL_CONTACT, comes);
        for c in &contacts.contacts {
            let (body, other) = (contacts.ids[c.body], c.other.map(|other| contacts.ids[other]));
            let contact = LocalContact { point: c.point, normal: c.normal, friction: c.friction };
            bodies[body].contacts.push((contact, other));
            if let Some(other) = other {
                bodies[other].contacts.push((LocalContact { normal: -c.normal, ..contact }, Some(body)));
            }
        }
        for joint in joints.iter().filter(|joint| !joint.is_broken) {
            let other = joint.b.filter(|&b| comes(b));
            bodies[joint.a].glue.push(other);
            if let Some(other) = other {
                bodies[other].glue.push(Some(joint.a).filter(|&a| comes(a)));
            }
        }
        let mut upward: Vec<BodyId> = (0..bodies.len()).collect();
        upward.sort_by(|&a, &b| bodies[a].center.y.total_cmp(&bodies[b].center.y).then(a.cmp(&b)));
        upward.into_iter().enumerate().for_each(|(rank, id)| bodies[id].rank = rank);
        Supports { bodies }
    }

    /// Bodies that touch this one or are glued to it, ascending.
    pub fn neighbours(&self, id: BodyId) -> Vec<BodyId> {
        let support = &self.bodies[id];
        let touching = support.contacts.iter().filter_map(|(_, other)| *other);
        let mut all: Vec<BodyId> = touching.chain(support.glue.iter().copied().flatten()).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// The bodies that are connected with this one by contacts and glue among what is there, ascending, if none of them
    /// reaches anything that stays: they float. Empty where they do not, or where this body is not there.
    pub fn floating(&self, id: BodyId, is_there: &dyn Fn(BodyId) -> bool) -> Vec<BodyId> {
        if !is_there(id) {
            return Vec::new();
        }
        let mut met = BTreeSet::from([id]);
        // The lowest one first: that is the way to the ground.
        let mut next = BTreeSet::from([(self.bodies[id].rank, id)]);
        while let Some((_, one)) = next.pop_first() {
            let support = &self.bodies[one];
            for other in support.contacts.iter().map(|(_, other)| other).chain(&support.glue) {
                let Some(other) = *other else { return Vec::new() };
                if is_there(other) && met.insert(other) {
                    next.insert((self.bodies[other].rank, other));
                }
            }
        }
        met.into_iter().collect()
    }

    /// Normals of the contacts of a body with what is there, into it.
    pub fn normals<'a>(&'a self, id: BodyId, is_there: &'a dyn Fn(BodyId) -> bool) -> impl Iterator<Item = DVec3> + 'a {
        let there = self.bodies[id].contacts.iter().filter(move |(_, other)| other.is_none_or(is_there));
        there.map(|(contact, _)| contact.normal)
    }

    /// The share of an impulse, or of a force, and of a moment that neither contacts nor glue with what is there give.
    pub fn missing(
        &self,
        id: BodyId,
        is_there: &dyn Fn(BodyId) -> bool,
        force: DVec3,
        moment: DVec3,
        analyser: &mut Analyser,
    ) -> f64 {
        let support = &self.bodies[id];
        if support.glue.iter().any(|other| other.is_none_or(is_there)) {
            return 0.0;
        }
        let there = support.contacts.iter().filter(|(_, other)| other.is_none_or(is_there));
        let contacts: Vec<LocalContact> = there.map(|(contact, _)| *contact).collect();
        let problem = LocalProblem {
            contacts: &contacts,
            mass: support.mass,
            center_of_mass: support.center,
            radius: support.radius,
            gravity: DVec3::NEG_Y,
        };
        analyser.missing(&problem, force, moment).unwrap_or(1.0)
    }

    /// The share of its weight that what is there does not carry; a rounding is nothing.
    pub fn falls(&self, id: BodyId, is_there: &dyn Fn(BodyId) -> bool, analyser: &mut Analyser) -> f64 {
        let weight = self.bodies[id].mass * DVec3::Y;
        Some(self.missing(id, is_there, weight, DVec3::ZERO, analyser)).filter(|&share| share > CARRIED).unwrap_or(0.0)
    }
}
