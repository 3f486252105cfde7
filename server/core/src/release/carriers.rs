//! What carries the bodies that wait for their layer. A body that nothing carries any more is released at once: it
//! would be seen to wait in the air.

use cairn_engine::world::{BodyId, ContactPair, PairSide, Role, World};
use cairn_geometry::contact::{self, Bearing, End};
use cairn_geometry::pose::Pose;
use std::collections::{BTreeMap, BTreeSet};

/// Gap up to which a contact carries a body that waits, as a share of the thinner one's thickness: less is hardly seen,
/// and piles settle by about as much when their lower layers begin to move.
const CARRIES: f64 = 0.1;
/// What moves faster carries nothing that waits, d per characteristic time: a fall over a hundredth of d is as fast.
const CARRYING_SPEED: f64 = 0.15;
/// Contacts of a body that waits are computed again once what it touches has moved by this share of its thickness.
const MOVED: f64 = 0.02;

/// The contacts of the bodies that wait.
pub struct Carriers {
    /// Of each body that waits: contacts that point up or down.
    contacts: BTreeMap<BodyId, Vec<Bearing>>,
    /// Bodies that wait, by the others that they touch, with the place of these when they were looked at.
    touching: BTreeMap<BodyId, (Pose, BTreeSet<BodyId>)>,
    /// Bodies looked at so far.
    pub looks: u64,
}

impl Carriers {
    /// Of all bodies that wait now.
    pub fn find(world: &World) -> Carriers {
        let mut carriers = Carriers { contacts: BTreeMap::new(), touching: BTreeMap::new(), looks: 0 };
        let waiting = world.present().filter(|&id| waits(world, id)).map(|id| (id, Vec::new()));
        carriers.contacts = waiting.collect();
        for pair in world.contact_pairs(CARRIES) {
            carriers.add(world, pair.a, &pair);
            if let PairSide::Body(b) = pair.b {
                carriers.add(world, b, &pair);
            }
        }
        carriers
    }

    /// Adds a contact of a body that waits.
    fn add(&mut self, world: &World, id: BodyId, pair: &ContactPair) {
        let Some(contacts) = self.contacts.get_mut(&id) else { return };
        // Whatever is in this list is near enough.
        contacts.extend(pair.bearings(world).map(|bearing| Bearing { gap: 0.0, ..bearing }));
        if let PairSide::Body(b) = pair.b {
            let other = if b == id { pair.a } else { b };
            self.touching.entry(other).or_insert_with(|| (world.pose(other), BTreeSet::new())).1.insert(id);
        }
    }

    /// Bodies that wait and that no chain of contacts from below joins to what stands or to a slow body that was
    /// released, ascending. They are to be released.
    pub fn lost(&mut self, world: &World) -> Vec<BodyId> {
        self.contacts.retain(|&id, _| waits(world, id));
        let has_moved = |id: BodyId, seen: &Pose| {
            let body = &world.bodies()[id];
            !world.is_present(id) || seen.moved(&world.pose(id), body.radius) > MOVED * body.thickness
        };
        let moved = self.touching.iter().filter(|(id, (seen, _))| has_moved(**id, seen));
        let moved: Vec<BodyId> = moved.map(|(id, _)| *id).collect();
        if moved.is_empty() && self.looks > 0 {
            return Vec::new();
        }
        let above = moved.iter().filter_map(|id| self.touching.remove(id)).flat_map(|(_, above)| above);
        for id in above.collect::<BTreeSet<_>>() {
            self.looks += 1;
            let Some(contacts) = self.contacts.get_mut(&id) else { continue };
            contacts.clear();
            for pair in world.contact_pairs_of(id, CARRIES) {
                self.add(world, id, &pair);
            }
        }
        self.looks += 1;
        let waiting: Vec<bool> = (0..world.bodies().len()).map(|id| self.contacts.contains_key(&id)).collect();
        let end = |end: End| match end {
            End::Body(id) if !waiting[id] && world.speed(id) < CARRYING_SPEED => End::Fixed,
            end => end,
        };
        let contacts = self.contacts.values().flatten();
        let contacts: Vec<Bearing> = contacts.map(|c| Bearing { a: end(c.a), b: end(c.b), ..*c }).collect();
        let lost = contact::hanging(&waiting, &contacts, 1.0);
        lost.iter().for_each(|id| drop(self.contacts.remove(id)));
        lost
    }
}

fn waits(world: &World, id: BodyId) -> bool {
    world.bodies()[id].role == Role::Waiting
}
