//! Looks for bodies that stand still in the air, in each frame.

use cairn_engine::world::{BodyId, ContactPair, REST_SPEED, Role, World};
use cairn_geometry::contact::{self, Bearing};
use cairn_geometry::pose::Pose;

/// Gap up to which a contact carries, as a share of the thinner one's thickness: less is hardly seen.
const CARRIES: f64 = 0.15;
/// A body whose contacts are not computed again has moved by at most this share of its thickness.
const MOVED: f64 = 0.02;

/// What was seen so far.
#[derive(Debug, Default)]
pub struct Hanging {
    /// Bodies that stood still in the air, summed over the frames.
    pub body_frames: u64,
    /// Bodies that were at rest in the latest frame. Shape `[body]`.
    at_rest: Vec<bool>,
    /// Bodies that hung in the latest frame, ascending.
    hanging: Vec<BodyId>,
    /// Contact pairs of the latest look, and where each body was when its pairs were computed.
    pairs: Vec<ContactPair>,
    seen: Vec<Pose>,
}

impl Hanging {
    /// A frame is due. A body hangs if it is at rest in this frame and in the one before, and no chain of contacts from
    /// below joins it to what stands. It counts from the second such frame on: in the first, what carried it may just
    /// have left. What is glued is held by its glue.
    pub fn look(&mut self, world: &World) {
        let is_at_rest = |id: BodyId| {
            let body = &world.bodies()[id];
            let may_fall = matches!(body.role, Role::Waiting | Role::Frozen | Role::Free);
            may_fall && world.cluster_of(id).is_none() && world.speed(id) < REST_SPEED
        };
        let at_rest: Vec<bool> = (0..world.bodies().len()).map(|id| world.is_present(id) && is_at_rest(id)).collect();
        let before = std::mem::replace(&mut self.at_rest, at_rest);
        let mut stays: Vec<bool> = before.iter().zip(&self.at_rest).map(|(before, now)| *before && *now).collect();
        stays.resize(self.at_rest.len(), false);
        if !stays.contains(&true) {
            self.hanging.clear();
            return;
        }
        let near = |(id, seen): (BodyId, &Pose)| {
            let body = &world.bodies()[id];
            world.is_present(id) && seen.moved(&world.pose(id), body.radius) <= MOVED * body.thickness
        };
        let still: Vec<bool> = self.seen.iter().enumerate().map(near).collect();
        let is_still = |id: BodyId| still.get(id).is_some_and(|&still| still);
        if still.len() < world.bodies().len() || still.contains(&false) {
            self.pairs = world.contact_pairs_since(CARRIES, &self.pairs, &still);
            self.seen.resize(world.bodies().len(), Pose::IDENTITY);
            for id in world.present().filter(|&id| !is_still(id)) {
                self.seen[id] = world.pose(id);
            }
        }
        let bearings = self.pairs.iter().flat_map(|pair| pair.bearings(world));
        // Whatever is in the list is near enough.
        let bearings: Vec<Bearing> = bearings.map(|bearing| Bearing { gap: 0.0, ..bearing }).collect();
        let hanging = contact::hanging(&stays, &bearings, 1.0);
        let stay = hanging.iter().filter(|id| self.hanging.binary_search(id).is_ok());
        self.body_frames += stay.count() as u64;
        self.hanging = hanging;
    }
}
