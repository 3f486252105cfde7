//! Reads models, and gathers the problems of their files.

use crate::sources::{InputFile, Reference};
use cairn_export::{PartChoice, resting};
use cairn_files::FileSource;
use cairn_files::problem::Problem;
use cairn_geometry::mesh::TriMesh;
use cairn_input::asset::{self, Limits, Source};
use cairn_input::scene::Model;
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;

/// Reads models and gathers their problems. An empty model stands in for one that cannot be read; the problem then
/// prevents the job.
pub(super) struct SceneReader {
    pub(super) source: Arc<dyn FileSource>,
    /// Of each file.
    limits: Limits,
    pub(super) files: BTreeMap<PathBuf, InputFile>,
    /// Unreadable files: reported once each, even if several models name them.
    missing: BTreeSet<PathBuf>,
    /// Of files of USD, what models mean.
    usd_parts: BTreeMap<PathBuf, BTreeSet<PartChoice>>,
    pub(super) notes: Vec<String>,
    pub(super) problems: Vec<Problem>,
}

impl SceneReader {
    pub(super) fn new(
        source: Arc<dyn FileSource>,
        limits: Limits,
        usd_parts: BTreeMap<PathBuf, BTreeSet<PartChoice>>,
    ) -> SceneReader {
        let (files, missing) = Default::default();
        SceneReader { source, limits, files, missing, usd_parts, notes: Vec::new(), problems: Vec::new() }
    }

    /// Adds the files that models name and that may not be read.
    pub(super) fn add_refused(&mut self) {
        if !self.source.is_fenced() {
            return;
        }
        self.files.values().for_each(|file| drop(file.sidecars()));
        for problem in self.source.refused() {
            if !self.problems.iter().any(|known| known.place == problem.place) {
                self.problems.push(problem);
            }
        }
    }

    /// A model where its file places it.
    pub(super) fn model(&mut self, field: &str, path: &str) -> (Reference, Model) {
        let reference = Reference::new(path);
        let (mut mesh, is_skinned, origin) = self.mesh(field, &reference, false).unwrap_or_default();
        if origin != DVec3::ZERO {
            mesh.points.iter_mut().for_each(|point| *point += origin);
        }
        let name = reference.name.clone();
        (reference, Model { name, mesh, is_skinned })
    }

    /// A model in a frame of its own.
    pub(super) fn model_of(&mut self, field: &str, reference: Reference) -> (Reference, Model) {
        let (mesh, is_skinned, _) = self.mesh(field, &reference, false).unwrap_or_default();
        let name = reference.name.clone();
        (reference, Model { name, mesh, is_skinned })
    }

    /// The mesh of a model, whether it has a skin, and where the origin of its frame is. `of_result`: of the bodies of
    /// an earlier result, as they lie in the end.
    pub(super) fn mesh(
        &mut self,
        field: &str,
        reference: &Reference,
        of_result: bool,
    ) -> Option<(TriMesh, bool, DVec3)> {
        if reference.file.as_os_str().is_empty() {
            let field = format!("{field}.path");
            let problem = Problem::new(&field, "it is empty", "Name a .glb, .gltf or USD file.");
            self.problems.push(problem.of_field(&field));
            return None;
        }
        if self.missing.contains(&reference.file) {
            return None;
        }
        if !self.files.contains_key(&reference.file) {
            let parts = self.usd_parts.get(&reference.file);
            match InputFile::read_parts(&reference.file, &self.source, parts) {
                Ok(file) => {
                    self.notes.extend(file.notes().iter().map(|note| format!("{}: {note}", file.name)));
                    self.files.insert(reference.file.clone(), file);
                }
                Err(mut problem) => {
                    problem.what = format!("{} ({field})", problem.what);
                    self.problems.push(problem.of_field(&format!("{field}.path")));
                    self.missing.insert(reference.file.clone());
                    return None;
                }
            }
        }
        let file = &self.files[&reference.file];
        let source = Source {
            name: &file.name,
            bytes: file.gltf(),
            node: if of_result { Some(resting::PILE) } else { file.node(reference) },
            resolve: &*file.resolve,
            limits: self.limits,
        };
        let at_rest = match of_result.then(|| resting::run(file.gltf())).transpose() {
            Ok(bytes) => bytes,
            Err(error) => {
                let remedy = "Name a result that `cairn bake` wrote.";
                self.problems.push(Problem::new(&reference.name, error.to_string(), remedy).of_field(field));
                return None;
            }
        };
        let source = Source { bytes: at_rest.as_deref().unwrap_or(file.gltf()), ..source };
        match asset::read(&source) {
            Ok(asset) => {
                self.notes.extend(asset.notes.into_iter().map(|note| format!("{}: {note}", reference.name)));
                Some((asset.mesh, asset.is_skinned, asset.origin))
            }
            Err(problems) => {
                let field = format!("{field}.path");
                self.problems.extend(problems.into_iter().map(|problem| Problem::from(problem).of_field(&field)));
                None
            }
        }
    }
}
