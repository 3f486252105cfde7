//! What examples and benches share: small piles of named scenes, and what looks into a pile while it is released.
#![allow(dead_code, reason = "each uses a part")]

use anyhow::{Context, anyhow};
use cairn_analysis::pile_equilibrium::PileEquilibrium;
use cairn_core::FullContainer;
use cairn_core::cache::NoCache;
use cairn_engine::world::World;
use cairn_files::problem::Problem;
use cairn_geometry::contact::REAL_CONTACT;
use cairn_input::observer::Silent;
use cairn_job::Job;
use cairn_motion::step::Simulation;
use cairn_statics::global::{self, Balance, Objective};
use cairn_wire::scene_file::SceneTree;
use std::path::Path;

/// Small versions of the scenes of this folder: name, scene file, what is set in it.
pub const SMALL: [(&str, &str, &[&str]); 5] = [
    ("sticks", "sticks.toml", &["fill.count=150"]),
    ("books", "books.toml", &["fill.count=150", "output.frames=120"]),
    // A few of several hulls each, glued.
    ("bananas", "ball.toml", &["fill.count=80"]),
    ("rubble", "guide/rubble.toml", &["fill.count=120"]),
    ("cards", "cards.toml", &["output.frames=120"]),
];

/// One of [`SMALL`], read, with further assignments.
pub fn small(name: &str, set: &[&str]) -> anyhow::Result<Job> {
    let (_, file, own) = SMALL.iter().find(|(known, ..)| *known == name).context("a name of a small scene")?;
    let set: Vec<String> = own.iter().chain(set).map(ToString::to_string).collect();
    read(&Path::new(env!("CAIRN_REPOSITORY")).join("examples").join(file), &set)
}

/// Reads a scene file, with assignments as `--set` takes them.
fn read(scene: &Path, set: &[String]) -> anyhow::Result<Job> {
    let invalid =
        |problems: Vec<Problem>| anyhow!(problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"));
    let mut tree = SceneTree::load(scene).map_err(invalid).with_context(|| scene.display().to_string())?;
    for assignment in set {
        tree.set(assignment).map_err(invalid)?;
    }
    Job::read(&tree.to_message()).map_err(invalid)
}

/// A scene whose container is full: any number of piles may be turned over from it.
pub struct Full {
    pub job: Job,
    container: FullContainer,
}

impl Full {
    /// Reads a scene file, with assignments as `--set` takes them, and fills its container if it has one.
    pub fn of(scene: &Path, set: &[String]) -> anyhow::Result<Full> {
        Full::filled(read(scene, set)?)
    }

    /// The same of a scene that was read.
    pub fn filled(job: Job) -> anyhow::Result<Full> {
        let container = cairn_core::fill_container(&job.scene, &job.params, &mut NoCache, &mut Silent)?;
        Ok(Full { job, container })
    }

    /// The pile right after turning over.
    pub fn turn_over(&self) -> anyhow::Result<Simulation<'_>> {
        Ok(self.container.turn_over(&self.job.scene, &self.job.params)?)
    }
}

/// The best forces over all contacts of a pile. Bodies in the order of [`World::present`], without those that are
/// pinned.
pub fn whole(world: &World) -> Option<Balance> {
    global::analyse(&PileEquilibrium::new(world, REAL_CONTACT).assembly.problem(), Objective::default()).ok()
}
