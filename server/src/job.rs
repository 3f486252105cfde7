//! A scene with every file read, and its way through the core to the files of the result: the same for the command line
//! and for the service.

use crate::document::Resolver;
use crate::export::{self, ExportError, ExportScene, Format, SourceModel};
use crate::from_proto::added::{self, Added};
use crate::problem::Problem;
use crate::reuse::Cache;
use crate::scene_file::SceneTree;
use crate::{files, from_proto, machine, proto, report, to_proto};
use cairn_core::asset::{self, Limits, Source};
use cairn_core::geometry::mesh::TriMesh;
use cairn_core::input::observer::Observer;
use cairn_core::input::params::{Accuracy, Params};
use cairn_core::input::scene::{Key, Model, Place, Prop, Scene, StaticModel};
use cairn_core::prepare::estimate::Estimate;
use cairn_core::report::bake::Bake;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
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
    props: Vec<Reference>,
    statics: Vec<Reference>,
    files: BTreeMap<PathBuf, InputFile>,
}

/// Gives the content of a file that a scene names, or that a file of it names.
pub type Open = Arc<dyn Fn(&Path) -> Result<Vec<u8>, Problem> + Send + Sync>;

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

/// A model as a scene names it: `kit.glb#Brick`.
struct Reference {
    name: String,
    file: PathBuf,
    node: Option<String>,
}

impl Reference {
    fn new(path: &str) -> Reference {
        let (file, node) = split_node(path);
        Reference { name: path.to_owned(), file: file.into(), node: node.map(str::to_owned) }
    }
}

/// `kit.glb#Brick` -> file and node. A `#` elsewhere belongs to the file's name.
pub fn split_node(path: &str) -> (&str, Option<&str>) {
    let lower = path.to_ascii_lowercase();
    let ends = [".glb#", ".gltf#"].iter().filter_map(|mark| lower.find(mark).map(|at| at + mark.len()));
    match ends.min() {
        Some(end) => (&path[..end - 1], Some(&path[end..])),
        None => (path, None),
    }
}

impl Job {
    /// Reads all that a scene names, or tells everything that is wrong with it.
    pub fn read(scene: &proto::Scene) -> Result<Job, Vec<Problem>> {
        Job::read_with(scene, Arc::new(files::read))
    }

    /// The same, with files from elsewhere than the disk.
    pub fn read_with(scene: &proto::Scene, open: Open) -> Result<Job, Vec<Problem>> {
        let began = Instant::now();
        let mut reader = Reader::new(open);
        let (params, problems) = from_proto::params_and_problems(scene);
        reader.problems.extend(problems);
        let control = scene.control_mesh.as_ref().map(|control| reader.model("control_mesh", &control.path).1);
        if control.is_none() && scene.bodies.is_empty() && scene.emitters.is_empty() {
            let remedy = "Give one by --control, or as control_mesh in the scene file; or place bodies there.";
            let problem = Problem::new("control_mesh", "there is no control mesh", remedy);
            reader.problems.push(problem.of_field("control_mesh"));
        }
        let region = scene.region.as_ref().map(|region| reader.model("region", &region.path).1);
        if scene.props.is_empty() {
            let remedy = "Give one or more by --prop, or as props in the scene file.";
            reader.problems.push(Problem::new("props", "there are no props", remedy).of_field("props"));
        }
        let read: Vec<_> = scene.props.iter().enumerate().map(|(i, prop)| reader.prop(i, prop)).collect();
        let (props, prop_models) = read.into_iter().unzip();
        let mut added = Added::new(scene, params.output.fps);
        let statics = scene.statics.iter().enumerate();
        let read: Vec<_> = statics.map(|(i, model)| reader.scenery(i, model, added.keys(i, model))).collect();
        let (statics, static_models) = read.into_iter().unzip();
        let bodies = scene.bodies.iter().enumerate().map(|(i, body)| added.body(i, body)).collect();
        let emitter = |(i, emitter): (usize, &proto::Emitter)| {
            let place = |mesh: &String| Place::Mesh(reader.model(&format!("emitters.{i}.mesh"), mesh).1);
            let mesh = emitter.mesh.as_ref().map(place);
            added.emitter(i, emitter, mesh)
        };
        let emitters = scene.emitters.iter().enumerate().map(emitter).collect();
        reader.problems.append(&mut added.problems);
        let effective = effective(scene, &params);
        let ladder = Accuracy::LADDER.iter().map(|&accuracy| {
            let accuracy = to_proto::accuracy(accuracy).into();
            from_proto::params_and_problems(&proto::Scene { accuracy, ..scene.clone() }).0
        });
        let ladder = ladder.collect();
        let scene = Scene { control, region, props: prop_models, statics: static_models, bodies, emitters };
        if !reader.problems.is_empty() {
            reader.check_values(&scene, &params);
            return Err(reader.problems);
        }
        Ok(Job { scene, params, ladder, notes: reader.notes, effective, began, props, statics, files: reader.files })
    }

    /// What each accuracy is expected to cost on this machine. Measures the machine, for a few tenths of a second.
    pub fn estimates(&self) -> Result<Vec<Estimate>, cairn_core::Error> {
        let machine = cairn_core::stages::calibrate::calibrate(machine::cpu_seconds)?;
        cairn_core::estimates(&self.scene, &self.params, &self.ladder, machine)
    }

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
        let read_seconds = machine::cpu_seconds();
        let bake = self.bake(cache, observer)?;
        let baked_at = machine::cpu_seconds();
        let result = export::encode(format, &bake, &self.export_scene())?;
        let around = [("read", read_seconds), ("encode", machine::cpu_seconds() - baked_at)];
        let (hash, seconds) = (report::result_hash(&bake), self.began.elapsed().as_secs_f64());
        let scene = SceneTree::from_message(&self.effective);
        let report = format!("{:#}\n", report::json(&bake, hash, &scene, &self.notes, output, &around, seconds));
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

    /// The files that the scene reads.
    pub fn inputs(&self) -> Vec<PathBuf> {
        self.files.keys().cloned().collect()
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

    /// The models in their original files.
    pub fn export_scene(&self) -> ExportScene<'_> {
        ExportScene { props: self.sources(&self.props), scenery: self.sources(&self.statics) }
    }

    fn sources<'a>(&'a self, references: &'a [Reference]) -> Vec<SourceModel<'a>> {
        let source = |reference: &'a Reference| {
            let file = &self.files[&reference.file];
            SourceModel {
                name: &reference.name,
                file: &file.name,
                bytes: &file.bytes,
                node: reference.node.as_deref(),
                resolve: &*file.resolve,
            }
        };
        references.iter().map(source).collect()
    }
}

/// The files that a scene names, without their nodes.
pub fn model_files(scene: &proto::Scene) -> BTreeSet<PathBuf> {
    let shapes = scene.control_mesh.iter().chain(&scene.region).map(|shape| &shape.path);
    let props = scene.props.iter().map(|prop| &prop.path);
    let statics = scene.statics.iter().map(|model| &model.path);
    let paths = shapes.chain(props).chain(statics).chain(scene.emitters.iter().flat_map(|emitter| &emitter.mesh));
    paths.map(|path| Reference::new(path).file).filter(|file| !file.as_os_str().is_empty()).collect()
}

/// A scene with every parameter and every prop's value set: baked again, it gives the same.
pub fn effective(scene: &proto::Scene, params: &Params) -> proto::Scene {
    let prop = |prop: &proto::Prop| proto::Prop {
        path: prop.path.clone(),
        weight: prop.weight.or(Some(from_proto::PROP_WEIGHT)),
        friction: prop.friction.or(Some(from_proto::FRICTION)),
        density: prop.density.or(Some(from_proto::PROP_DENSITY)),
        restitution: prop.restitution.or(Some(from_proto::PROP_RESTITUTION)),
        scale_min: prop.scale_min.or(Some(from_proto::PROP_SCALE)),
        scale_max: prop.scale_max.or(Some(from_proto::PROP_SCALE)),
        tilt_max: prop.tilt_max.or(Some(from_proto::PROP_TILT_MAX)),
    };
    let scenery = |model: &proto::StaticModel| proto::StaticModel {
        path: model.path.clone(),
        friction: model.friction.or(Some(from_proto::FRICTION)),
        keyframes: model.keyframes.iter().map(added::effective_key).collect(),
    };
    proto::Scene {
        control_mesh: scene.control_mesh.clone(),
        props: scene.props.iter().map(prop).collect(),
        statics: scene.statics.iter().map(scenery).collect(),
        bodies: scene.bodies.iter().map(added::effective_body).collect(),
        emitters: scene.emitters.iter().map(added::effective_emitter).collect(),
        region: scene.region.clone(),
        ..to_proto::params(params)
    }
}

/// One glTF file in memory.
struct InputFile {
    /// What messages call it.
    name: String,
    bytes: Vec<u8>,
    /// Reads the files beside it.
    resolve: Box<Resolver<'static>>,
}

impl InputFile {
    fn read(path: &Path, open: &Open) -> Result<InputFile, Problem> {
        let bytes = open(path)?;
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let beside = Beside { folder, open: open.clone(), read: Mutex::default() };
        let resolve = Box::new(move |relative: &str| beside.read(relative));
        Ok(InputFile { name: path.display().to_string(), bytes, resolve })
    }
}

/// The files beside a glTF file. Kept once read: the export, long after, must find what the bake saw.
struct Beside {
    folder: PathBuf,
    open: Open,
    read: Mutex<BTreeMap<String, Vec<u8>>>,
}

impl Beside {
    fn read(&self, relative: &str) -> Result<Vec<u8>, String> {
        let path = files::below(&self.folder, relative).ok_or("it leads out of the file's own folder")?;
        let mut read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bytes) = read.get(relative) {
            return Ok(bytes.clone());
        }
        let bytes = (self.open)(&path).map_err(|problem| problem.to_string())?;
        read.insert(relative.to_owned(), bytes.clone());
        Ok(bytes)
    }
}

/// Reads models and gathers what is wrong with them. Where a model cannot be read, an empty one stands in, and the
/// problem keeps the job from being made.
struct Reader {
    open: Open,
    files: BTreeMap<PathBuf, InputFile>,
    /// Files that could not be read: told once, however many models lie in them.
    missing: BTreeSet<PathBuf>,
    notes: Vec<String>,
    problems: Vec<Problem>,
}

impl Reader {
    fn new(open: Open) -> Reader {
        let (files, missing) = Default::default();
        Reader { open, files, missing, notes: Vec::new(), problems: Vec::new() }
    }

    /// Adds what the core finds wrong with values. What it says of models that could not be read would mislead.
    fn check_values(&mut self, scene: &Scene, params: &Params) {
        let Err(found) = cairn_core::prepare::check::run(scene, params) else { return };
        for problem in found {
            let is_model = problem.field.rsplit('.').next().is_some_and(|last| last.parse::<usize>().is_ok())
                || ["control_mesh", "region", "props"].contains(&&*problem.field);
            if !is_model && !self.problems.iter().any(|told| told.field == problem.field) {
                self.problems.push(problem.into());
            }
        }
    }

    fn model(&mut self, field: &str, path: &str) -> (Reference, Model) {
        let reference = Reference::new(path);
        let mesh = self.mesh(field, &reference).unwrap_or_default();
        let name = reference.name.clone();
        (reference, Model { name, mesh })
    }

    fn mesh(&mut self, field: &str, reference: &Reference) -> Option<TriMesh> {
        if reference.file.as_os_str().is_empty() {
            let field = format!("{field}.path");
            let problem = Problem::new(&field, "it is empty", "Name a .glb or .gltf file.");
            self.problems.push(problem.of_field(&field));
            return None;
        }
        if self.missing.contains(&reference.file) {
            return None;
        }
        if !self.files.contains_key(&reference.file) {
            match InputFile::read(&reference.file, &self.open) {
                Ok(file) => {
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
            bytes: &file.bytes,
            node: reference.node.as_deref(),
            resolve: &*file.resolve,
            limits: Limits::default(),
        };
        match asset::read(&source) {
            Ok(asset) => {
                self.notes.extend(asset.notes.into_iter().map(|note| format!("{}: {note}", reference.name)));
                Some(asset.mesh)
            }
            Err(problems) => {
                let field = format!("{field}.path");
                self.problems.extend(problems.into_iter().map(|problem| Problem::from(problem).of_field(&field)));
                None
            }
        }
    }

    fn prop(&mut self, index: usize, prop: &proto::Prop) -> (Reference, Prop) {
        let (reference, model) = self.model(&format!("props.{index}"), &prop.path);
        let prop = Prop {
            model,
            weight: prop.weight.unwrap_or(from_proto::PROP_WEIGHT),
            friction: prop.friction.unwrap_or(from_proto::FRICTION),
            density: prop.density.unwrap_or(from_proto::PROP_DENSITY),
            restitution: prop.restitution.unwrap_or(from_proto::PROP_RESTITUTION),
            scale: [prop.scale_min, prop.scale_max].map(|scale| scale.unwrap_or(from_proto::PROP_SCALE)),
            tilt_max: prop.tilt_max.unwrap_or(from_proto::PROP_TILT_MAX),
        };
        (reference, prop)
    }

    fn scenery(&mut self, index: usize, given: &proto::StaticModel, keys: Vec<Key>) -> (Reference, StaticModel) {
        let (reference, model) = self.model(&format!("statics.{index}"), &given.path);
        (reference, StaticModel { model, friction: given.friction.unwrap_or(from_proto::FRICTION), keys })
    }
}

#[cfg(test)]
mod tests {
    use super::split_node;

    #[test]
    fn a_node_follows_the_extension() {
        assert_eq!(split_node("kit.glb#Brick"), ("kit.glb", Some("Brick")));
        assert_eq!(split_node("a#b/kit.GLTF#Brick #2"), ("a#b/kit.GLTF", Some("Brick #2")));
        assert_eq!(split_node("a#b/kit.glb"), ("a#b/kit.glb", None));
    }
}
