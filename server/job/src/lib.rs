//! A scene with all its files read, and its bake, for the command line and the service.
//!
//! It must never know who asks, nor send anything.
//!
//! Invariants: all problems of all files are reported at once, before any work; a result names files relative to its
//! scene, so that nothing of the machine is in its bytes; the cache changes no result, only its time.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod analysis;
pub mod goal;
mod idle;
pub mod machine;
mod memory;
pub mod pace;
pub mod provenance;
mod read;
pub mod removals;
pub mod report;
pub mod request;
pub mod reuse;
mod run;
mod sources;

use cairn_export::{ExportScene, Format, Layout, Measures, Rehearsal, SourceModel, UsdAsset};
use cairn_files::FileSource;
use cairn_files::problem::Problem;
use cairn_input::params::Params;
use cairn_input::scene::Scene;
use cairn_prepare::estimate::{Estimate, Goal};
use cairn_prepare::plan::Plan;
use cairn_wire::proto::{self, BakeSpec};
use machine::Meter;
pub use run::{FinishedBake, JobError};
use serde_json::Value;
use sources::Reference;
pub use sources::{InputFile, PortableNames, model_files, place, rename, usd_parts};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Everything that a bake needs.
pub struct Job {
    pub scene: Scene,
    pub params: Params,
    pub goal: Option<Goal>,
    /// The preset that `auto` became: `params` are its.
    pub chosen: Option<goal::Chosen>,
    /// The parameters at each accuracy, fastest first.
    pub ladder: Vec<Params>,
    /// Deviations from the files' content made while reading, one sentence each.
    pub notes: Vec<String>,
    /// The scene with all defaults filled in. It bakes to the same result.
    pub effective: proto::Scene,
    began: Instant,
    meter: Meter,
    /// CPU seconds.
    read_seconds: f64,
    props: Vec<Reference>,
    statics: Vec<Reference>,
    files: BTreeMap<PathBuf, InputFile>,
    /// Names of the files in the result.
    names: PortableNames,
    /// Of a result in USD.
    pub layout: Layout,
    /// Of the models' data in a `.glb`.
    model_bytes: usize,
}

/// Upper bounds of what a pack takes, bytes: of a triangle of a body in all its meshes; how many files hold the models.
const PACKED_TRIANGLE: u64 = 320;
const PACKED_MODELS: u64 = 4;
/// Upper bounds of what a stage for simulators takes, bytes: of a body with its glue, of a triangle of scenery as text.
const PHYSICS_BODY: u64 = 4 << 10;
const COLLIDER_TRIANGLE: u64 = 128;
/// Bytes of a point or a triangle of the shape in what a result holds for later bakes.
const STATE_POINT: u64 = 12;

impl Job {
    /// The expected cost of each accuracy. Measures this machine's speed first, for a few tenths of a second.
    pub fn estimates(&self) -> Result<Vec<Estimate>, cairn_core::Error> {
        cairn_core::estimates(&self.scene, &self.params, &self.ladder, machine::slowness()?)
    }

    /// The notes, and why the accuracy is the one that was chosen.
    pub fn notes_of_plan(&self) -> Vec<String> {
        self.notes.iter().cloned().chain(self.chosen.map(|chosen| chosen.to_string())).collect()
    }

    /// The size of the result at most, bytes, as if every body moved in every frame. Not if the fill places more bodies
    /// than are expected, or if the pile rests after more than twice the expected time: what bounds those for certain,
    /// `fill.max_bodies` and `hold.patience`, would refuse bakes that have room.
    pub fn most_bytes(&self, plan: &Plan, format: Format) -> u64 {
        let (bodies, frames) = (plan.expected_bodies as u64, plan.most_frames as u64);
        let size = format.size();
        let models = if format.holds_models() { self.model_bytes as u64 } else { 0 };
        let body = frames.saturating_mul(size.pose).saturating_add(size.body);
        let mut bytes = bodies.saturating_mul(body).saturating_add(size.file + models);
        if format == Format::Glb {
            bytes = bytes.saturating_add(self.state_bytes());
        }
        let holds_colliders = matches!(format, Format::GlbPhysics | Format::GlbHulls);
        if format == Format::Pack {
            let triangles = self.scene.props.iter().map(|prop| prop.model.mesh.triangles.len() as u64).max();
            let packed = bodies.saturating_mul(triangles.unwrap_or(0)).saturating_mul(PACKED_TRIANGLE);
            bytes = bytes.saturating_add(packed).saturating_add(PACKED_MODELS * self.model_bytes as u64);
        }
        let has_physics = format.is_usd() && self.layout.has_physics;
        if has_physics {
            bytes = bytes.saturating_add(bodies.saturating_mul(PHYSICS_BODY));
        }
        if has_physics || holds_colliders {
            let triangles = self.scene.statics.iter().map(|model| model.model.mesh.triangles.len() as u64).sum::<u64>();
            bytes = bytes.saturating_add(triangles.saturating_mul(COLLIDER_TRIANGLE));
        }
        bytes
    }

    /// Of the shape and of scenery near it, which a later bake compares with its own, at most.
    fn state_bytes(&self) -> u64 {
        let meshes = self.scene.control.iter().chain(self.scene.statics.iter().map(|model| &model.model));
        let meshes = meshes.map(|model| (model.mesh.points.len() + model.mesh.triangles.len()) as u64);
        meshes.sum::<u64>().saturating_mul(STATE_POINT)
    }

    /// The files of the scene, where they lie.
    pub fn inputs(&self) -> Vec<PathBuf> {
        self.files.values().flat_map(InputFile::paths).collect()
    }

    /// Makes the result name files relative to the scene's folder, where possible.
    pub fn relative_to(mut self, folder: &Path) -> Job {
        self.names = PortableNames::new(self.files.keys().map(PathBuf::as_path), folder);
        for reference in self.props.iter_mut().chain(&mut self.statics) {
            reference.portable = self.names.of(&reference.name);
        }
        self.referred_from("")
    }

    /// Makes a result in USD, in this folder, refer to the assets where they lie, unless the scene says from where.
    pub fn written_into(mut self, folder: &Path) -> Job {
        if self.layout.asset_folder.is_none() {
            for reference in self.props.iter_mut().chain(&mut self.statics) {
                reference.asset = cairn_files::way(folder, &self.files[&reference.file].path);
            }
        }
        self
    }

    /// Makes a result in USD refer to assets by their names behind this folder, unless the scene says from where.
    pub fn referred_from(mut self, folder: &str) -> Job {
        let folder = self.layout.asset_folder.as_deref().unwrap_or(folder);
        for reference in self.props.iter_mut().chain(&mut self.statics) {
            reference.asset = cairn_files::joined(folder, cairn_files::split_node(&reference.portable).0);
        }
        self
    }

    /// Another layout of a result in USD.
    pub fn laid_out(mut self, usd: Option<&proto::UsdLayout>) -> Result<Job, Vec<Problem>> {
        let usd = usd.cloned().unwrap_or_default();
        self.layout = Layout::new(&usd)?;
        let asks = usd != proto::UsdLayout::default();
        self.effective.usd = asks.then(|| usd.with_defaults());
        Ok(self)
    }

    /// The request: everything that decides the result.
    pub fn request(&self, format: Format) -> BakeSpec {
        let assets = self.files.values().flat_map(request::assets).collect();
        request::request(self.effective.clone(), assets, format, &self.names)
    }

    /// Hash of names and bytes of all files, except those that a glTF file names.
    pub fn content_hash(&self) -> blake3::Hash {
        let mut hasher = blake3::Hasher::new();
        for file in self.files.values() {
            for part in [file.name.as_bytes(), &file.bytes] {
                hasher.update(&(part.len() as u64).to_le_bytes());
                hasher.update(part);
            }
        }
        hasher.finalize()
    }

    /// The models in their original files, and the provenance for the result.
    pub fn export_scene<'a>(&'a self, origin: &'a Value, measures: Option<&'a Measures>) -> ExportScene<'a> {
        let (props, scenery) = (self.sources(&self.props), self.sources(&self.statics));
        let keeps_instancing = self.params.output.instancing;
        let (colliders, layout) = (&*self.scene.statics, self.layout.clone());
        let shape = self.scene.control.as_ref().filter(|_| self.scene.is_filled(&self.params)).map(|model| &model.mesh);
        ExportScene { props, scenery, colliders, shape, origin: Some(origin), measures, keeps_instancing, layout }
    }

    fn sources<'a>(&'a self, references: &'a [Reference]) -> Vec<SourceModel<'a>> {
        references.iter().map(|reference| source_model(reference, &self.files)).collect()
    }
}

/// A scene that cannot be baked.
#[derive(Debug)]
pub struct Refused {
    pub problems: Vec<Problem>,
    /// Deviations from the files' content made while reading, one sentence each: often the reason of a problem.
    pub notes: Vec<String>,
}

fn source_model<'a>(reference: &'a Reference, files: &'a BTreeMap<PathBuf, InputFile>) -> SourceModel<'a> {
    let file = &files[&reference.file];
    SourceModel {
        name: &reference.portable,
        file: &file.name,
        bytes: file.gltf(),
        node: file.node(reference),
        resolve: &*file.resolve,
        asset: file.part(reference).filter(|part| !part.prims.is_empty()).map(|part| UsdAsset {
            path: &reference.asset,
            prims: &part.prims,
            is_default: part.is_default,
        }),
    }
}

/// Copies the models that a result shows into nothing; or gives the reasons why they cannot be shown.
fn rehearse(
    shown: &[&Reference],
    files: &BTreeMap<PathBuf, InputFile>,
    keeps_instancing: bool,
    source: &dyn FileSource,
) -> Result<Rehearsal, Vec<Problem>> {
    let models: Vec<SourceModel> = shown.iter().map(|reference| source_model(reference, files)).collect();
    let rehearsal = cairn_export::rehearse(&models, keeps_instancing, source);
    rehearsal.map_err(|errors| errors.iter().map(|error| Problem::from(error.to_string())).collect())
}
