//! Recognizes finished results by the hashes of their requests and files.

use super::Variant;
use cairn_export::Format;
use cairn_files::FileSource;
use cairn_files::problem::Problem;
use cairn_input::params::{Accuracy as Preset, Params};
use cairn_job::report::ReportFile;
use cairn_job::request::{self, Asset};
use cairn_job::{InputFile, PortableNames, model_files, usd_parts};
use cairn_wire::effective::effective;
use cairn_wire::from_proto;
use cairn_wire::proto::{Accuracy, Scene};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Hashes of a variant's request.
pub struct RequestHashes {
    /// See [`request::hash`]. With the accuracy `auto`, one for each preset that it may become.
    pub requests: Vec<blake3::Hash>,
    /// Equal only for variants that share their fill.
    pub fill: blake3::Hash,
}

/// The files of variants, each read once.
#[derive(Default)]
pub struct Assets(BTreeMap<PathBuf, Vec<Asset>>);

impl Assets {
    fn of(&mut self, scene: &Scene, source: &Arc<dyn FileSource>) -> Result<Vec<Asset>, Vec<Problem>> {
        let (mut found, mut problems) = (Vec::new(), Vec::new());
        let parts = usd_parts(scene);
        for path in model_files(scene) {
            if !self.0.contains_key(&path) {
                match InputFile::read_parts(&path, source, parts.get(&path)) {
                    Ok(file) => drop(self.0.insert(path.clone(), request::assets(&file))),
                    Err(problem) => {
                        problems.push(problem);
                        continue;
                    }
                }
            }
            found.extend_from_slice(&self.0[&path]);
        }
        if problems.is_empty() { Ok(found) } else { Err(problems) }
    }

    /// The hashes of a variant's request, as in its report.
    pub fn hashes(&mut self, variant: &Variant) -> Result<RequestHashes, Vec<Problem>> {
        let scene = variant.tree.to_message();
        let params = from_proto::params(&scene)?;
        let format = Format::of(&variant.output).expect("the matrix checks the file extension");
        let assets = self.of(&scene, &variant.tree.files())?;
        let models = model_files(&scene);
        let names = PortableNames::new(models.iter().map(PathBuf::as_path), variant.tree.folder());
        let fill = fill_hash(&scene, &params, &assets, &names);
        let presets: Vec<i32> = match scene.accuracy() {
            Accuracy::Auto => Preset::LADDER.iter().map(|&preset| Accuracy::from(preset).into()).collect(),
            _ => vec![scene.accuracy],
        };
        let hash = |accuracy: i32| {
            let scene = Scene { accuracy, ..scene.clone() };
            let effective = effective(&scene, &from_proto::params(&scene)?);
            Ok(request::hash(&request::request(effective, assets.clone(), format, &names)))
        };
        Ok(RequestHashes { requests: presets.into_iter().map(hash).collect::<Result<_, Vec<Problem>>>()?, fill })
    }
}

/// A hash of everything that the fill depends on, and a little more.
fn fill_hash(scene: &Scene, params: &Params, assets: &[Asset], names: &PortableNames) -> blake3::Hash {
    let Params { seed, gravity, ground, ground_height, physics, base, fill, .. } = params;
    let given = (seed, gravity, ground, ground_height, physics, base, fill);
    let Scene { control_mesh, props, bodies, piles, around, from, .. } = scene;
    // What stays of an earlier pile depends on whether the pile is held.
    let held = from.as_ref().map(|from| (from, params));
    let files: Vec<_> = assets.iter().map(|asset| (asset.uri(names), &asset.sha256)).collect();
    let shapes = (control_mesh, props, bodies, piles, around);
    blake3::hash(format!("{given:?} {shapes:?} {held:?} {files:?}").as_bytes())
}

/// Whether result and report exist, belong to one of these requests, and are undamaged.
pub fn is_finished(output: &Path, report: &Path, requests: &[blake3::Hash]) -> bool {
    let read = || {
        let report: ReportFile = serde_json::from_slice(&std::fs::read(report).ok()?).ok()?;
        let is_same = requests.iter().any(|request| report.request_blake3 == request.to_hex().as_str());
        Some(is_same && report.output_blake3 == blake3::hash(&std::fs::read(output).ok()?).to_hex().as_str())
    };
    read().unwrap_or(false)
}
