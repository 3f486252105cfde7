//! Which bodies may be held at all, whatever the analysis of their contacts says: bodies outside the region, and those
//! that overlap, are carried along or hang, may not.

use cairn_engine::world::{BodyId, ContactPair, PairSide, Role, World};
use cairn_geometry::contact;
use cairn_geometry::interior::DistanceGrid;
use std::cell::Cell;
use std::collections::BTreeSet;

/// A center of mass this far outside the region (in d) still counts as inside, as in `inside_fraction`.
const REGION_TOLERANCE: f64 = 0.1;
/// Bodies placed by hand overlap beyond this share of the thinner one's thickness: the widest gap of a contact.
const MOST_OVERLAP: f64 = 0.05;
/// A body that is deeper in another one, or in the ground, than this share is not held, be it by a hard fall or by a
/// squeeze. The fill leaves less than this.
const DEEP: f64 = 0.35;

pub struct Eligibility<'a> {
    /// Bodies whose center of mass is outside are not judged; `None`: the control acts everywhere. Engine units.
    region: Option<&'a DistanceGrid>,
    region_tests: Cell<u64>,
    /// Bodies placed by hand that may overlap: not held before they have come apart.
    placed: BTreeSet<BodyId>,
}

impl<'a> Eligibility<'a> {
    pub fn new(region: Option<&'a DistanceGrid>) -> Eligibility<'a> {
        Eligibility { region, region_tests: Cell::new(0), placed: BTreeSet::new() }
    }

    /// A body was placed by hand, maybe into another one.
    pub fn place(&mut self, id: BodyId) {
        self.placed.insert(id);
    }

    /// Tests so far of whether a body is inside the region.
    pub fn region_tests(&self) -> u64 {
        self.region_tests.get()
    }

    pub fn is_inside(&self, world: &World, id: BodyId) -> bool {
        let Some(region) = self.region else { return true };
        self.region_tests.set(self.region_tests.get() + 1);
        is_inside(region, world, id)
    }

    /// Bodies that may not be held now, regardless of their contacts. Shape `[body]`; empty if there are none.
    pub fn barred(&mut self, world: &World, pairs: &[ContactPair]) -> Vec<bool> {
        let mut barred = carried(world, pairs);
        let sunk = overlapping(world, pairs, DEEP);
        if self.placed.is_empty() && sunk.is_empty() {
            return barred;
        }
        barred.resize(world.bodies().len(), false);
        sunk.into_iter().for_each(|id| barred[id] = true);
        if !self.placed.is_empty() {
            // Those that still overlap; once apart, a body is like all others.
            let deep = overlapping(world, pairs, MOST_OVERLAP);
            self.placed.retain(|id| deep.contains(id) || world.bodies()[*id].role == Role::Waiting);
            self.placed.iter().for_each(|&id| barred[id] = true);
        }
        barred
    }

    /// Bodies slower than `speed` that no chain of contacts from below joins to the ground, ascending. They are jammed
    /// between their neighbors, which never happens to a pile that fell into place: the fill squeezed them in.
    pub fn hanging(&self, world: &World, pairs: &[ContactPair], speed: f64) -> Vec<BodyId> {
        let waits = |id: BodyId| world.bodies()[id].role == Role::Waiting;
        let released = |t: &&ContactPair| !waits(t.a) && !matches!(t.b, PairSide::Body(b) if waits(b));
        let contacts: Vec<_> = pairs.iter().filter(released).flat_map(|t| t.bearings(world)).collect();
        let slow = |id: BodyId| {
            let free = world.bodies()[id].role == Role::Free && world.speed(id) < speed;
            (free || world.bodies()[id].role == Role::Frozen) && self.is_inside(world, id)
        };
        let slow: Vec<bool> = (0..world.bodies().len()).map(slow).collect();
        // Engine units: d is 1.
        contact::hanging(&slow, &contacts, 1.0)
    }
}

/// A body belongs to a region, engine units.
pub fn is_inside(region: &DistanceGrid, world: &World, id: BodyId) -> bool {
    region.signed_distance(world.pose(id).translation) <= REGION_TOLERANCE
}

/// Bodies that moving scenery carries or pushes, directly or through others: they move along. Shape `[body]`; empty
/// where none moves.
pub fn carried(world: &World, pairs: &[ContactPair]) -> Vec<bool> {
    if !world.scenery_moves() {
        return Vec::new();
    }
    let mut carried = vec![false; world.bodies().len()];
    let neighbors = neighbors(world, pairs);
    let mut front: Vec<BodyId> = pairs.iter().filter(|t| t.b == PairSide::Moving).map(|t| t.a).collect();
    while let Some(id) = front.pop() {
        if !std::mem::replace(&mut carried[id], true) {
            front.extend(&neighbors[id]);
        }
    }
    carried
}

/// Bodies deeper in something else than this share of the thinner one's thickness.
fn overlapping(world: &World, pairs: &[ContactPair], share: f64) -> BTreeSet<BodyId> {
    let deep = pairs.iter().filter(|t| t.depth() > share * world.pair_thickness(t));
    deep.flat_map(|t| [Some(t.a), if let PairSide::Body(b) = t.b { Some(b) } else { None }]).flatten().collect()
}

/// The bodies in contact with each body. Shape `[body]`, each in order of the pairs.
pub fn neighbors(world: &World, pairs: &[ContactPair]) -> Vec<Vec<BodyId>> {
    let mut neighbors = vec![Vec::new(); world.bodies().len()];
    for t in pairs {
        if let PairSide::Body(b) = t.b {
            neighbors[t.a].push(b);
            neighbors[b].push(t.a);
        }
    }
    neighbors
}
