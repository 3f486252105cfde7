//! The release without glue: what stands by itself is not glued.

use super::policy::SAGS;
use super::trial::{Ends, TrialResult, Trials, standing};
use cairn_engine::world::{BodyId, PairSide, World};
use cairn_geometry::contact::REAL_CONTACT;
use cairn_geometry::topology::DisjointSets;
use cairn_input::error::Error;
use cairn_input::observer::Observer;
use glam::DVec3;
use std::collections::BTreeSet;

/// The release of a pile without glue.
pub struct Natural {
    pub trial: TrialResult,
    /// The heaps: bodies that contacts join, each body named by its heap's first one. Shape `[body]`.
    heaps: Vec<BodyId>,
}

impl Natural {
    /// `all`: the trial runs to its end, also where the pile falls.
    pub fn run(world: &World, trials: &mut Trials, all: bool, observer: &mut dyn Observer) -> Result<Natural, Error> {
        let heaps = heaps(world);
        // Where one heap falls, others may stand.
        let ends = if all { Ends::Late } else { Ends::WithHeaps(&heaps) };
        Ok(Natural { trial: trials.run(&[], &[], DVec3::NEG_Y, ends, observer)?, heaps })
    }

    /// Bodies of the heaps in which none has moved.
    pub fn standing(&self, world: &World) -> BTreeSet<BodyId> {
        if !self.trial.is_whole {
            return BTreeSet::new();
        }
        let has_moved =
            |id: BodyId| self.trial.poses[id].is_none() || self.trial.ways.get(id).is_some_and(|way| *way > SAGS);
        standing(&self.heaps, &world.present().collect::<Vec<_>>(), has_moved)
    }
}

fn heaps(world: &World) -> Vec<BodyId> {
    let mut sets = DisjointSets::new(world.bodies().len());
    for pair in world.contact_pairs(REAL_CONTACT) {
        if let PairSide::Body(b) = pair.b {
            sets.join(pair.a, b);
        }
    }
    (0..world.bodies().len()).map(|id| sets.find(id)).collect()
}
