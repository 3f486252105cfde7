//! The equilibrium problem of a whole pile, from its contact pairs.

use cairn_engine::world::{BodyId, ContactPair, ContactPoint, PairSide, World};
use cairn_statics::global::{GlobalBody, GlobalContact, GlobalProblem};
use cairn_statics::glue::{self, GlueError, GlueProblem, GlueSite};
use glam::DVec3;
use std::ops::ControlFlow;

/// All bodies of a world that may move, and all contacts between them. Engine units.
pub struct PileEquilibrium {
    /// The bodies, ascending.
    pub ids: Vec<BodyId>,
    /// Shape `[body]`, in the order of `ids`.
    bodies: Vec<GlobalBody>,
    contacts: Vec<GlobalContact>,
    sites: Vec<GlueSite>,
}

impl PileEquilibrium {
    /// The world as it stands. All contacts count, up to a gap of `gap` of the thinner body's thickness; pinned bodies
    /// carry like scenery. Where all bodies are pinned, all count as if they were released.
    pub fn new(world: &World, gap: f64) -> PileEquilibrium {
        let stands = |id: BodyId| world.bodies()[id].role.stands();
        let some_may_move = world.present().any(|id| !stands(id));
        let is_pinned = |id: BodyId| some_may_move && stands(id);
        let ids: Vec<BodyId> = world.present().filter(|&id| !is_pinned(id)).collect();
        let body = |&id: &BodyId| {
            let b = &world.bodies()[id];
            GlobalBody { mass: b.mass, center_of_mass: world.pose(id).translation, radius: b.radius }
        };
        let index = |id: BodyId| ids.binary_search(&id).ok();
        let mut all: Vec<GlobalContact> = Vec::new();
        let mut sites = Vec::new();
        for pair in &world.contact_pairs(gap) {
            let from = all.len();
            all.extend(contacts(pair, &index).into_iter().flatten());
            sites.extend(all.get(from).map(|&GlobalContact { body, other, point, .. }| GlueSite {
                body,
                other,
                contacts: from..all.len(),
                center: point,
                arm: 1.0,
                may_glue: false,
                normal_price: 0.0,
            }));
        }
        PileEquilibrium { bodies: ids.iter().map(body).collect(), contacts: all, sites, ids }
    }

    pub fn problem(&self) -> GlobalProblem<'_> {
        GlobalProblem { bodies: &self.bodies, contacts: &self.contacts, gravity: DVec3::NEG_Y }
    }

    /// The imbalance that contact forces leave, in each body's weight, once no body misses more than `enough` or no
    /// better forces are found. Shape `[body]`, in the order of `ids`; and the number of iterations.
    pub fn missing(
        &self,
        enough: f64,
        going: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<(Vec<f64>, u64), GlueError> {
        let PileEquilibrium { bodies, contacts, sites, .. } = self;
        let pile = GlueProblem { bodies, contacts, sites, gravity: DVec3::NEG_Y };
        glue::missing(&pile, enough, going)
    }
}

/// The contacts of a pair; `None` between two things that do not move. `index`: of a body that may.
pub fn contacts(
    pair: &ContactPair,
    index: &impl Fn(BodyId) -> Option<usize>,
) -> Option<impl Iterator<Item = GlobalContact>> {
    let other = match pair.b {
        PairSide::Body(b) => index(b),
        PairSide::Ground | PairSide::Scenery | PairSide::Moving => None,
    };
    // Normals point into the first of the pair.
    let (body, other, side) = match (index(pair.a), other) {
        (Some(body), other) => (body, other, 1.0),
        (None, Some(body)) => (body, None, -1.0),
        (None, None) => return None,
    };
    let friction = pair.friction;
    let contact =
        move |p: &ContactPoint| GlobalContact { body, other, point: p.point, normal: side * p.normal, friction };
    Some(pair.points.iter().map(contact))
}
