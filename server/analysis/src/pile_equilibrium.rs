//! The equilibrium problem of a whole pile, from its contact pairs.

use crate::assembly::{self, Assembly};
use cairn_engine::world::{BodyId, World};
use cairn_statics::glue::{self, GlueError, GlueProblem, GlueSite};
use glam::DVec3;
use std::ops::ControlFlow;

/// All bodies of a world that may move, and all contacts between them.
pub struct PileEquilibrium {
    pub assembly: Assembly,
    sites: Vec<GlueSite>,
}

impl PileEquilibrium {
    /// The world as it stands. All contacts count, up to a gap of `gap` of the thinner body's thickness; pinned bodies
    /// carry like scenery. Where all bodies are pinned, all count as if they were released.
    pub fn new(world: &World, gap: f64) -> PileEquilibrium {
        let stands = |id: BodyId| world.bodies()[id].role.stands();
        let some_may_move = world.present().any(|id| !stands(id));
        let mut assembly = Assembly::new(world, |id| !(some_may_move && stands(id)));
        let mut sites = Vec::new();
        for pair in &world.contact_pairs(gap) {
            let contacts = assembly.contacts_of(pair);
            sites.extend(contacts.first().map(|first| assembly::site(first, assembly.add(contacts.iter().copied()))));
        }
        PileEquilibrium { assembly, sites }
    }

    /// The imbalance that contact forces leave, in each body's weight, once no body misses more than `enough` or no
    /// better forces are found. Shape `[body]`, in the order of the assembly; and the number of iterations.
    pub fn missing(
        &self,
        enough: f64,
        going: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<(Vec<f64>, u64), GlueError> {
        let PileEquilibrium { assembly: Assembly { bodies, contacts, .. }, sites } = self;
        glue::missing(&GlueProblem { bodies, contacts, sites, gravity: DVec3::NEG_Y }, enough, going)
    }
}
