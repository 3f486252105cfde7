//! Which results are there already: known by what they were asked for, and held against their hashes.

use super::Variant;
use crate::files;
use crate::job::{InputFile, Names, model_files, request};
use crate::model::export::Format;
use crate::problem::Problem;
use crate::wire::effective::effective;
use crate::wire::from_proto;
use crate::wire::proto::{AssetReference, Scene};
use cairn_core::input::params::Params;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What a variant asks for.
pub struct Asked {
    /// See [`request::hash`].
    pub hash: blake3::Hash,
    /// Equal for variants that are sure to share their fill.
    pub fill: blake3::Hash,
}

/// The files that variants name, each read once.
#[derive(Default)]
pub struct Assets(BTreeMap<PathBuf, Vec<AssetReference>>);

impl Assets {
    fn of(&mut self, scene: &Scene) -> Result<Vec<AssetReference>, Vec<Problem>> {
        let (mut found, mut problems) = (Vec::new(), Vec::new());
        for path in model_files(scene) {
            if !self.0.contains_key(&path) {
                match InputFile::read(&path, &(Arc::new(files::read) as _)) {
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

    /// What a variant asks for, as its report will tell it.
    pub fn asked(&mut self, variant: &Variant) -> Result<Asked, Vec<Problem>> {
        let scene = variant.tree.to_message();
        let params = from_proto::params(&scene)?;
        let format = Format::of(&variant.output).expect("the matrix gives names that tell it");
        let assets = self.of(&scene)?;
        let fill = fill_hash(&scene, &params, &assets);
        let models = model_files(&scene);
        let names = Names::new(models.iter().map(PathBuf::as_path), variant.tree.folder());
        let request = request::request(effective(&scene, &params), assets, format, &names);
        Ok(Asked { hash: request::hash(&request), fill })
    }
}

/// The hash of what the fill depends on, and of a little more.
fn fill_hash(scene: &Scene, params: &Params, assets: &[AssetReference]) -> blake3::Hash {
    let Params { seed, gravity, ground, ground_height, physics, base, fill, .. } = params;
    let given = (seed, gravity, ground, ground_height, physics, base, fill);
    let Scene { control_mesh, props, bodies, .. } = scene;
    let files: Vec<_> = assets.iter().map(|asset| (&asset.uri, &asset.sha256)).collect();
    blake3::hash(format!("{given:?} {control_mesh:?} {props:?} {bodies:?} {files:?}").as_bytes())
}

/// What of a report says which result it tells of.
#[derive(serde::Deserialize)]
struct Told {
    request_blake3: String,
    output_blake3: String,
}

/// Whether result and report are there, answer this request, and are whole.
pub fn is_finished(output: &Path, report: &Path, asked: &blake3::Hash) -> bool {
    let read = || {
        let told: Told = serde_json::from_slice(&std::fs::read(report).ok()?).ok()?;
        let is_asked = told.request_blake3 == asked.to_hex().as_str();
        Some(is_asked && told.output_blake3 == blake3::hash(&std::fs::read(output).ok()?).to_hex().as_str())
    };
    read().unwrap_or(false)
}
