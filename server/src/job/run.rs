//! A job's way through the core to the files of the result.

use super::Job;
use super::report::{self, Spent};
use super::reuse::Cache;
use crate::model::export::{self, ExportError, Format};
use crate::scene_file::SceneTree;
use cairn_core::input::observer::Observer;
use cairn_core::report::bake::Bake;

/// A finished bake and its files.
pub struct Outcome {
    pub bake: Bake,
    /// In the format asked for.
    pub result: Vec<u8>,
    /// JSON.
    pub report: String,
    /// See [`report::result_hash`].
    pub hash: blake3::Hash,
    pub seconds: f64,
}

/// Why there is no outcome.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error(transparent)]
    Bake(#[from] cairn_core::Error),
    #[error(transparent)]
    Export(#[from] ExportError),
}

impl Job {
    /// The bake, and its files. `output`: what the report calls the result.
    ///
    /// Fill and shapes of an earlier bake are taken from the cache where they are the same; where nobody wants frames, so is a
    /// whole bake.
    pub fn run(
        &self,
        format: Format,
        output: &str,
        cache: &mut Cache,
        observer: &mut dyn Observer,
    ) -> Result<Outcome, Error> {
        let bake = self.bake(cache, observer)?;
        let baked = self.meter.seconds();
        let result = export::encode(format, &bake, &self.export_scene())?;
        let (hash, seconds) = (report::result_hash(&bake), self.began.elapsed().as_secs_f64());
        let cpu = self.meter.seconds();
        let spent = Spent { read: self.read_seconds, encode: cpu - baked, cpu, wall: seconds };
        let scene = SceneTree::from_message(&self.effective);
        let report = format!("{:#}\n", report::json(&bake, hash, &scene, &self.notes, output, &spent));
        Ok(Outcome { bake, result, report, hash, seconds })
    }

    fn bake(&self, cache: &mut Cache, observer: &mut dyn Observer) -> Result<Bake, cairn_core::Error> {
        // The frames of a bake under way tell more than its result.
        let may_recall = !observer.wants_frames();
        if may_recall && let Some(mut bake) = cache.bake(&self.scene, &self.params) {
            bake.report.recall();
            return Ok(bake);
        }
        let bake = cairn_core::bake_with(&self.scene, &self.params, cache, observer)?;
        if may_recall {
            cache.keep_bake(&self.scene, &self.params, &bake);
        }
        Ok(bake)
    }
}
