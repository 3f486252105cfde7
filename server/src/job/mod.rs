//! A scene with all its files read, and its bake, for the command line and the service.

pub mod machine;
pub mod pace;
pub mod provenance;
mod read;
pub mod report;
pub mod request;
pub mod reuse;
mod run;
mod sources;

use crate::model::export::{ExportScene, Format, Measures, SourceModel};
use crate::wire::proto::{self, BakeSpec};
use cairn_core::input::params::Params;
use cairn_core::input::scene::Scene;
use cairn_core::prepare::estimate::Estimate;
use machine::Meter;
pub use run::{FinishedBake, JobError};
use serde_json::Value;
use sources::Reference;
pub use sources::{InputFile, OpenFile, PortableNames, model_files, rename};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Everything that a bake needs.
pub struct Job {
    pub scene: Scene,
    pub params: Params,
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
}

impl Job {
    /// The expected cost of each accuracy. Measures this machine's speed first, for a few tenths of a second.
    pub fn estimates(&self) -> Result<Vec<Estimate>, cairn_core::Error> {
        let machine = cairn_core::stages::calibrate::calibrate(machine::cpu_seconds)?;
        cairn_core::estimates(&self.scene, &self.params, &self.ladder, machine)
    }

    /// The files of the scene.
    pub fn inputs(&self) -> Vec<PathBuf> {
        self.files.keys().cloned().collect()
    }

    /// Makes the result name files relative to the scene's folder, where possible.
    pub fn relative_to(mut self, folder: &Path) -> Job {
        self.names = PortableNames::new(self.files.keys().map(PathBuf::as_path), folder);
        for reference in self.props.iter_mut().chain(&mut self.statics) {
            reference.portable = self.names.of(&reference.name);
        }
        self
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
        ExportScene { props, scenery, origin: Some(origin), measures }
    }

    fn sources<'a>(&'a self, references: &'a [Reference]) -> Vec<SourceModel<'a>> {
        let source = |reference: &'a Reference| {
            let file = &self.files[&reference.file];
            SourceModel {
                name: &reference.portable,
                file: &file.name,
                bytes: &file.bytes,
                node: reference.node.as_deref(),
                resolve: &*file.resolve,
            }
        };
        references.iter().map(source).collect()
    }
}
