//! A scene with every file read, and its way through the core to the files of the result: the same for the command line
//! and for the service.

pub mod again;
pub mod machine;
pub mod pace;
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
pub use run::{Error, Outcome};
use serde_json::Value;
use sources::Reference;
pub use sources::{InputFile, Names, Open, model_files, rename};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Everything that one bake needs.
pub struct Job {
    pub scene: Scene,
    pub params: Params,
    /// The parameters that the scene would have at each accuracy, from the quickest on.
    pub ladder: Vec<Params>,
    /// What was read otherwise than it stands in the files, one sentence each.
    pub notes: Vec<String>,
    /// The scene with every parameter and every prop's value set: baked again, it gives the same.
    pub effective: proto::Scene,
    began: Instant,
    meter: Meter,
    /// CPU seconds.
    read_seconds: f64,
    props: Vec<Reference>,
    statics: Vec<Reference>,
    files: BTreeMap<PathBuf, InputFile>,
    /// What the result calls its files.
    names: Names,
}

impl Job {
    /// What each accuracy is expected to cost on this machine. Measures the machine, for a few tenths of a second.
    pub fn estimates(&self) -> Result<Vec<Estimate>, cairn_core::Error> {
        let machine = cairn_core::stages::calibrate::calibrate(machine::cpu_seconds)?;
        cairn_core::estimates(&self.scene, &self.params, &self.ladder, machine)
    }

    /// The files that the scene reads.
    pub fn inputs(&self) -> Vec<PathBuf> {
        self.files.keys().cloned().collect()
    }

    /// The result is to name files relative to this folder, the scene's own, where that can be.
    pub fn relative_to(mut self, folder: &Path) -> Job {
        self.names = Names::new(self.files.keys().map(PathBuf::as_path), folder);
        for reference in self.props.iter_mut().chain(&mut self.statics) {
            reference.portable = self.names.of(&reference.name);
        }
        self
    }

    /// All that decides the result.
    pub fn request(&self, format: Format) -> BakeSpec {
        let assets = self.files.values().flat_map(request::assets).collect();
        request::request(self.effective.clone(), assets, format, &self.names)
    }

    /// Hash of all files that were read: names and bytes, those beside a glTF file left out.
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

    /// The models in their original files, and what the result tells of where it comes from.
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
