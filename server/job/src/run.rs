//! Runs a job through the core and encodes the result.

use super::Job;
use super::goal;
use super::report::{self, CallerSeconds, ResultIdentity};
use super::request;
use super::reuse::BakeCache;
use cairn_core::report::bake::{Bake, BakedPile};
use cairn_export::{Encoded, ExportError, Format, Measures};
use cairn_files::failpoints;
use cairn_input::observer::Observer;
use cairn_prepare::check::CheckedScene;
use cairn_wire::scene_file::SceneTree;
use std::ops::ControlFlow;

/// A finished bake and its files.
pub struct FinishedBake {
    pub bake: Bake,
    /// In the requested format.
    pub result: Encoded,
    /// What is not as in the scene's files, one sentence each.
    pub notes: Vec<String>,
    /// JSON.
    pub report: String,
    /// See [`report::result_hash`].
    pub hash: blake3::Hash,
    pub seconds: f64,
}

/// Why a job has no result.
#[derive(Debug, thiserror::Error)]
pub enum JobError {
    #[error(transparent)]
    Bake(#[from] cairn_core::Error),
    #[error(transparent)]
    Export(#[from] ExportError),
}

impl Job {
    /// Bakes and encodes the result. `output`: the result's name in the report.
    ///
    /// Shapes and fill come from the cache if it has them; so does the whole bake if the observer wants no frames.
    pub fn run(
        &self,
        format: Format,
        output: &str,
        cache: &mut BakeCache,
        observer: &mut dyn Observer,
    ) -> Result<FinishedBake, JobError> {
        self.run_and_deliver(None, format, output, cache, observer, &mut |_| ControlFlow::Continue(()))
    }

    /// The result of a finished bake in a format.
    pub fn encode(&self, format: Format, pile: &BakedPile, measures: &Measures) -> Result<Encoded, ExportError> {
        let origin = request::origin(&self.request(format), report::result_hash(pile));
        cairn_export::encode(format, pile, &self.export_scene(&origin, Some(measures)))
    }

    /// Like [`Job::run`]. `deliver` gets the result as soon as it exists: before the measures, unless the format holds
    /// them. After its `Break` the job is cancelled, but the cache keeps the bake. `checked`: the scene as its plan has
    /// checked it, if there was one.
    pub fn run_and_deliver(
        &self,
        checked: Option<CheckedScene>,
        format: Format,
        output: &str,
        cache: &mut BakeCache,
        observer: &mut dyn Observer,
        deliver: &mut dyn FnMut(&Encoded) -> ControlFlow<()>,
    ) -> Result<FinishedBake, JobError> {
        let request = self.request(format);
        let mut encode_seconds = 0.0;
        let mut delivered = |pile: &BakedPile, measures: Option<&Measures>| {
            let begin = self.meter.seconds();
            let hash = report::result_hash(pile);
            let origin = request::origin(&request, hash);
            let result = cairn_export::encode(format, pile, &self.export_scene(&origin, measures))?;
            encode_seconds = self.meter.seconds() - begin;
            match deliver(&result) {
                ControlFlow::Continue(()) => Ok((result, hash)),
                ControlFlow::Break(()) => Err(JobError::Bake(cairn_core::Error::Cancelled)),
            }
        };
        let (scene, params) = (&self.scene, &self.params);
        // A cached bake has no frames of its fill.
        let may_recall = !observer.wants_frames();
        let known = if may_recall { cache.bake(scene, params) } else { None };
        let (bake, (result, hash)) = match known {
            Some(mut bake) => {
                bake.report.recall();
                let files = delivered(&bake.pile, Some(&bake.report.measures))?;
                (bake, files)
            }
            None => {
                let full = match checked {
                    Some(checked) => cairn_core::fill_checked(scene, params, checked, cache, observer)?,
                    None => cairn_core::fill_container(scene, params, cache, observer)?,
                };
                let released = cairn_core::release_pile(scene, params, &full, observer)?;
                // A fault in the measures must not cost the finished result.
                let early = (!format.holds_measures()).then(|| delivered(&released.pile(), None));
                failpoints::at("measure").ok();
                let bake = released.measured(observer)?;
                // Nor must a full disk: the cache may be on another one.
                if may_recall {
                    cache.keep_bake(scene, params, &bake);
                }
                let files = match early {
                    Some(files) => files?,
                    None => delivered(&bake.pile, Some(&bake.report.measures))?,
                };
                (bake, files)
            }
        };
        let seconds = self.began.elapsed().as_secs_f64();
        let caller =
            CallerSeconds { read: self.read_seconds, encode: encode_seconds, cpu: self.meter.seconds(), wall: seconds };
        let scene = SceneTree::from_message(&self.effective);
        let identity = ResultIdentity {
            request: request::hash(&request),
            result: hash,
            output: blake3::hash(&result.bytes),
            name: output,
        };
        let overlap = bake.report.measures.get(goal::OVERLAP).copied().flatten();
        let missed = self.goal.and_then(|goal| goal::missed(goal, seconds, overlap));
        let notes: Vec<String> = self.notes.iter().chain(&result.left_out).cloned().chain(missed).collect();
        let chosen = self.chosen.map(|chosen| chosen.to_string());
        let of_report: Vec<String> = notes.iter().cloned().chain(chosen).collect();
        let report = format!("{:#}\n", report::json(&bake, &identity, &scene, &of_report, &caller));
        Ok(FinishedBake { bake, result, notes, report, hash, seconds })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine;
    use cairn_input::observer::{Frame, Progress};
    use cairn_wire::proto;
    use serde_json::Value;

    /// An observer that only reads the clock.
    struct CpuClock;

    impl Observer for CpuClock {
        fn progress(&mut self, _: &Progress) -> ControlFlow<()> {
            ControlFlow::Continue(())
        }

        fn cpu_seconds(&mut self) -> f64 {
            machine::cpu_seconds()
        }

        fn frame(&mut self, _: &Frame) {}
    }

    #[test]
    fn earlier_time_of_the_process_is_not_counted() {
        // More than passes between the report and the last reading of the clock.
        while machine::cpu_seconds() < 1.0 {
            std::hint::black_box((0..100_000_u64).fold(0, u64::wrapping_add));
        }
        let before = machine::cpu_seconds();
        let asset = |name| format!("{}/examples/assets/{name}", env!("CAIRN_REPOSITORY"));
        let mut tree = SceneTree::from_message(&proto::Scene {
            control_mesh: Some(proto::ControlMesh { path: asset("cone-small.glb") }),
            props: vec![proto::Prop { path: asset("stick.glb"), ..Default::default() }],
            ..Default::default()
        });
        for assignment in ["accuracy=draft", "fill.count=4"] {
            tree.set(assignment).unwrap();
        }
        let job = Job::read(&tree.to_message()).unwrap();
        let done = job.run(Format::Csv, "pile.csv", &mut BakeCache::none(), &mut CpuClock).unwrap();
        let all = machine::cpu_seconds() - before;

        let report: Value = serde_json::from_str(&done.report).unwrap();
        let (reported, stages) = (report["cpu_seconds"].as_f64().unwrap(), report["seconds"].as_object().unwrap());
        assert!(reported <= all, "{reported} of {all}");
        assert!(stages.contains_key("read") && stages.contains_key("fill") && stages.contains_key("encode"));
        let parts: f64 = stages.values().map(|seconds| seconds.as_f64().unwrap()).sum();
        // Rounding of sums.
        assert!(parts <= reported + 1e-9, "{parts} of {reported}");
    }

    /// A pile that falls, one that is glued, and one of two frames: no result is larger than was said before the bake,
    /// nor much smaller.
    #[test]
    fn the_size_of_a_result_is_bounded_before_the_bake() {
        let asset = |name| format!("{}/examples/assets/{name}", env!("CAIRN_REPOSITORY"));
        for (assignments, slack) in
            [(["control=off", "seed=1"], 12), (["glue=as_modelled", "seed=1"], 60), (["output.frames=1", "seed=2"], 12)]
        {
            let mut tree = SceneTree::from_message(&proto::Scene {
                control_mesh: Some(proto::ControlMesh { path: asset("cone-small.glb") }),
                props: vec![proto::Prop { path: asset("stick.glb"), ..Default::default() }],
                ..Default::default()
            });
            for assignment in ["accuracy=draft", "fill.count=30"].iter().chain(&assignments) {
                tree.set(assignment).unwrap();
            }
            let job = Job::read(&tree.to_message()).unwrap();
            let plan = cairn_core::plan(&job.scene, &job.params).unwrap();
            let done = job.run(Format::Csv, "pile.csv", &mut BakeCache::none(), &mut CpuClock).unwrap();
            let origin = request::origin(&job.request(Format::Csv), done.hash);
            for format in Format::ALL {
                let scene = job.export_scene(&origin, Some(&done.bake.report.measures));
                let size = cairn_export::encode(format, &done.bake.pile, &scene).unwrap().bytes.len() as u64;
                let most = job.most_bytes(&plan, format);
                assert!(size <= most && most <= slack * size, "{format:?}, {assignments:?}: {size} bytes of {most}");
            }
        }
    }
}
