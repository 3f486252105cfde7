//! An assembly of rigid bodies, from a world as it stands: every problem of statics is made here.

use cairn_engine::world::{BodyId, ContactPair, ContactPoint, PairSide, World};
use cairn_statics::global::{GlobalBody, GlobalContact, GlobalProblem};
use cairn_statics::glue::GlueSite;
use glam::DVec3;
use std::ops::Range;

/// Bodies that may move, and contacts between them and with all else. Engine units: gravity is 1.
#[derive(Clone)]
pub struct Assembly {
    /// The bodies, ascending.
    pub ids: Vec<BodyId>,
    /// Shape `[body]`, in the order of `ids`.
    pub bodies: Vec<GlobalBody>,
    pub contacts: Vec<GlobalContact>,
}

impl Assembly {
    /// Without contacts yet. `moves` says which bodies may move; all others carry like scenery.
    pub fn new(world: &World, moves: impl Fn(BodyId) -> bool) -> Assembly {
        let ids: Vec<BodyId> = world.present().filter(|&id| moves(id)).collect();
        Assembly { bodies: ids.iter().map(|&id| body(world, id)).collect(), ids, contacts: Vec::new() }
    }

    /// The index of a body; `None`: it does not move.
    pub fn index(&self, id: BodyId) -> Option<usize> {
        self.ids.binary_search(&id).ok()
    }

    /// The contacts of a pair; none between two things that do not move.
    pub fn contacts_of(&self, pair: &ContactPair) -> Vec<GlobalContact> {
        let other = match pair.b {
            PairSide::Body(b) => self.index(b),
            PairSide::Ground | PairSide::Scenery | PairSide::Moving => None,
        };
        // Normals point into the first of the pair.
        let (body, other, side) = match (self.index(pair.a), other) {
            (Some(body), other) => (body, other, 1.0),
            (None, Some(body)) => (body, None, -1.0),
            (None, None) => return Vec::new(),
        };
        let friction = pair.friction;
        let contact =
            |p: &ContactPoint| GlobalContact { body, other, point: p.point, normal: side * p.normal, friction };
        pair.points.iter().map(contact).collect()
    }

    /// Returns the place of these contacts among all.
    pub fn add(&mut self, contacts: impl IntoIterator<Item = GlobalContact>) -> Range<usize> {
        let from = self.contacts.len();
        self.contacts.extend(contacts);
        from..self.contacts.len()
    }

    pub fn problem(&self) -> GlobalProblem<'_> {
        GlobalProblem { bodies: &self.bodies, contacts: &self.contacts, gravity: DVec3::NEG_Y }
    }
}

/// A body of a world.
pub fn body(world: &World, id: BodyId) -> GlobalBody {
    let b = &world.bodies()[id];
    GlobalBody { mass: b.mass, center_of_mass: world.pose(id).translation, radius: b.radius }
}

/// The site of a pair that touches, which may not be glued. `first`: of its contacts.
pub fn site(first: &GlobalContact, contacts: Range<usize>) -> GlueSite {
    let &GlobalContact { body, other, point, .. } = first;
    GlueSite { body, other, contacts, center: point, arm: 1.0, may_glue: false, normal_price: 0.0 }
}
