//! A scene, and its full container.

use anyhow::{Context, anyhow};
use cairn_core::FullContainer;
use cairn_engine::shape;
use cairn_engine::shape::Shape;
use cairn_input::observer::Silent;
use cairn_input::scene::PlacedBody;
use cairn_job::Job;
use cairn_job::reuse::BakeCache;
use cairn_motion::step::Simulation;
use cairn_prepare::check;
use cairn_wire::scene_file::SceneTree;
use std::path::{Path, PathBuf};

/// A scene whose container is full.
pub struct Full {
    pub file: PathBuf,
    pub set: Vec<String>,
    pub job: Job,
    pub container: FullContainer,
}

/// Reads a scene file. What comes later than the pile is left out.
pub fn read(file: &Path, set: &[String]) -> anyhow::Result<Job> {
    let invalid = |problems: Vec<cairn_files::problem::Problem>| {
        anyhow!(problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))
    };
    let mut tree = SceneTree::load(file).map_err(invalid).with_context(|| file.display().to_string())?;
    for assignment in set {
        tree.set(assignment).map_err(invalid)?;
    }
    let mut job = Job::read(&tree.to_message()).map_err(invalid)?;
    job.scene.bodies.retain(PlacedBody::is_stacked);
    job.scene.emitters.clear();
    Ok(job)
}

/// The collision shapes of a scene's props.
pub fn shapes(job: &Job) -> anyhow::Result<Vec<Shape>> {
    let checked = check::run(&job.scene, &job.params).map_err(|problems| anyhow!("{problems:?}"))?;
    Ok(shape::run(&job.scene, &job.params, &checked.sizes, &mut Silent)?)
}

impl Full {
    /// `cache`: a folder of earlier fills.
    pub fn of(file: &Path, set: &[String], cache: &Path) -> anyhow::Result<Full> {
        let job = read(file, set)?;
        let container = cairn_core::fill_container(&job.scene, &job.params, &mut BakeCache::at(cache), &mut Silent)?;
        Ok(Full { file: file.to_owned(), set: set.to_vec(), job, container })
    }

    /// The pile right after turning over.
    pub fn turn_over(&self) -> anyhow::Result<Simulation<'_>> {
        Ok(self.container.turn_over(&self.job.scene, &self.job.params)?)
    }
}
