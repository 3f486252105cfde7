//! What examples share that look into a pile while it is released.

use anyhow::{Context, anyhow};
use cairn::job::Job;
use cairn::scene_file::SceneTree;
use cairn_core::FullContainer;
use cairn_core::equilibrium::global::{self, Balance, Objective};
use cairn_core::input::observer::Silent;
use cairn_core::sim::step::Simulation;
use cairn_core::sim::whole::{REAL_CONTACT, Whole};
use cairn_core::stages::cache::NoCache;
use cairn_core::world::World;
use std::path::Path;

/// A scene whose container is full: any number of piles may be turned over from it.
pub struct Full {
    pub job: Job,
    container: FullContainer,
}

impl Full {
    /// Reads a scene file, with assignments as `--set` takes them, and fills its container if it has one.
    pub fn of(scene: &Path, set: &[String]) -> anyhow::Result<Full> {
        let told = |problems: Vec<cairn::problem::Problem>| {
            anyhow!(problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))
        };
        let mut tree = SceneTree::load(scene).map_err(told).with_context(|| scene.display().to_string())?;
        for assignment in set {
            tree.set(assignment).map_err(told)?;
        }
        let job = Job::read(&tree.to_message()).map_err(told)?;
        let container = cairn_core::fill_container(&job.scene, &job.params, &mut NoCache, &mut Silent)?;
        Ok(Full { job, container })
    }

    /// The pile right after turning over.
    pub fn turn_over(&self) -> anyhow::Result<Simulation<'_>> {
        Ok(self.container.turn_over(&self.job.scene, &self.job.params)?)
    }
}

/// The best forces over all contacts of a pile. Bodies in the order of [`World::present`], without those that are pinned.
#[allow(dead_code)]
pub fn whole(world: &World) -> Option<Balance> {
    global::analyse(&Whole::new(world, REAL_CONTACT).problem(), Objective::default()).ok()
}
