//! What carries bodies that do not move. Contacts are kept, and computed again only where something has moved.

use cairn_engine::world::{BodyId, PairSide, World};
use cairn_geometry::contact::{self, Bearing, End};
use cairn_geometry::pose::Pose;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Gap up to which a contact carries, as a share of the thinner one's thickness: less is hardly seen, and piles settle
/// by about as much when their lower layers begin to move.
const CARRIES: f64 = 0.1;
/// Contacts of a body are computed again once it, or what it touches, has moved by this share of its thickness.
const MOVED: f64 = 0.02;
/// Bodies that are worth another thread.
const LEAST_SHARE: usize = 64;

/// The contacts of bodies that do not move.
#[derive(Debug, Default)]
pub struct Carried {
    contacts: BTreeMap<BodyId, Contacts>,
    /// Those of them that touch another body, by that body, with the place that it had then.
    touching: BTreeMap<BodyId, (Pose, BTreeSet<BodyId>)>,
    /// Bodies looked at so far.
    pub looks: u64,
}

/// The contacts of a body.
#[derive(Debug)]
struct Contacts {
    /// Where it was when it was looked at.
    pose: Pose,
    bearings: Vec<Bearing>,
    /// It touches scenery that moves, which may leave it.
    is_on_moving: bool,
}

impl Carried {
    /// Brings the contacts of these bodies up to date.
    pub fn follow(&mut self, world: &World, is_followed: impl Fn(BodyId) -> bool) {
        let has_moved = |id: BodyId, seen: &Pose| {
            let body = &world.bodies()[id];
            !world.is_present(id) || seen.moved(&world.pose(id), body.radius) > MOVED * body.thickness
        };
        self.contacts.retain(|&id, contacts| !contacts.is_on_moving && !has_moved(id, &contacts.pose));
        let moved = self.touching.iter().filter(|(id, (seen, _))| has_moved(**id, seen));
        let moved: Vec<BodyId> = moved.map(|(id, _)| *id).collect();
        for (_, touching) in moved.iter().filter_map(|id| self.touching.remove(id)) {
            touching.iter().for_each(|id| drop(self.contacts.remove(id)));
        }
        let is_due = |id: &BodyId| is_followed(*id) && !self.contacts.contains_key(id);
        let due: Vec<BodyId> = world.present().filter(is_due).collect();
        let pairs_of = |&id: &BodyId| world.contact_pairs_of(id, CARRIES);
        let found: Vec<_> = due.par_iter().with_min_len(LEAST_SHARE).map(pairs_of).collect();
        self.looks += due.len() as u64;
        for (&id, pairs) in due.iter().zip(&found) {
            // Whatever is in this list is near enough.
            let bearings = pairs.iter().flat_map(|pair| pair.bearings(world));
            let bearings = bearings.map(|bearing| Bearing { gap: 0.0, ..bearing }).collect();
            let is_on_moving = pairs.iter().any(|pair| pair.b == PairSide::Moving);
            self.contacts.insert(id, Contacts { pose: world.pose(id), bearings, is_on_moving });
            for pair in pairs {
                let PairSide::Body(b) = pair.b else { continue };
                let other = if b == id { pair.a } else { b };
                self.touching.entry(other).or_insert_with(|| (world.pose(other), BTreeSet::new())).1.insert(id);
            }
        }
    }

    /// Those of the followed bodies that no chain of contacts from below joins to what stands, or to another body that
    /// carries, ascending.
    pub fn hanging(
        &self,
        world: &World,
        is_followed: impl Fn(BodyId) -> bool,
        carries: impl Fn(BodyId) -> bool,
    ) -> Vec<BodyId> {
        let followed: Vec<bool> = (0..world.bodies().len()).map(|id| world.is_present(id) && is_followed(id)).collect();
        let end = |end: End| match end {
            End::Body(id) if !followed[id] && carries(id) => End::Fixed,
            end => end,
        };
        let contacts =
            self.contacts.iter().filter(|(id, _)| followed[**id]).flat_map(|(_, contacts)| &contacts.bearings);
        let contacts: Vec<Bearing> = contacts.map(|c| Bearing { a: end(c.a), b: end(c.b), ..*c }).collect();
        contact::hanging(&followed, &contacts, 1.0)
    }
}
