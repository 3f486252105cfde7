//! Reads a scene's files, and gathers all problems of scene and files.

use super::machine::Meter;
use super::sources::{self, InputFile, PortableNames, Reference};
use super::{Job, Refused, goal};
use cairn_export::resting;
use cairn_export::{Layout, PartChoice};
use cairn_files::problem::Problem;
use cairn_files::{Disk, FileSource};
use cairn_geometry::mesh::TriMesh;
use cairn_input::asset::{self, Limits, Source};
use cairn_input::params::{Accuracy, Params};
use cairn_input::scene::{EmitterVolume, Keyframe, Model, PileShape, Prop, Scene, StaticModel, UprightRule};
use cairn_prepare::dense::{self, DenseProp};
use cairn_wire::effective;
use cairn_wire::from_proto::{self, extra_bodies::ExtraBodies};
use cairn_wire::proto;
use cairn_wire::scene_file::SceneTree;
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

impl Job {
    /// Reads all files of a scene from this machine's disk, or returns all problems.
    pub fn read(scene: &proto::Scene) -> Result<Job, Vec<Problem>> {
        Job::read_with(scene, Arc::new(Disk::default()), Limits::default()).map_err(|refused| refused.problems)
    }

    /// Reads the files of a scene file's scene within limits for each file.
    pub fn read_tree(tree: &SceneTree, limits: Limits) -> Result<Job, Refused> {
        Job::read_with(&tree.to_message(), tree.files(), limits)
    }

    /// Reads the files from `source`.
    pub fn read_with(scene: &proto::Scene, source: Arc<dyn FileSource>, limits: Limits) -> Result<Job, Refused> {
        let (began, meter) = (Instant::now(), Meter::start());
        let mut reader = SceneReader::new(source, limits, sources::usd_parts(scene));
        let (mut params, problems) = from_proto::params_and_problems(scene);
        reader.problems.extend(problems);
        let (goal, problems) = from_proto::goal(scene);
        reader.problems.extend(problems);
        let mut effective = effective::effective(scene, &params);
        let layout = match scene.usd.as_ref().map(Layout::new) {
            Some(Err(problems)) => {
                reader.problems.extend(problems);
                Layout::default()
            }
            Some(Ok(layout)) => layout,
            None => Layout::default(),
        };
        let control = scene.control_mesh.as_ref().map(|control| reader.model("control_mesh", &control.path).1);
        let has_container = scene.fill.as_ref().is_some_and(|fill| fill.into.is_some());
        let has_piles = !scene.piles.is_empty();
        if has_piles && (control.is_some() || has_container) {
            let what = "there is another shape, too";
            let problem =
                Problem::new("piles", what, "Leave piles, control_mesh or fill.into out, but for one of them.");
            reader.problems.push(problem.of_field("piles"));
        }
        if control.is_none() && !has_container && !has_piles && scene.bodies.is_empty() && scene.emitters.is_empty() {
            let remedy = "Give one by --control, or as control_mesh in the scene file; or place bodies there.";
            let problem = Problem::new("control_mesh", "there is no control mesh", remedy);
            reader.problems.push(problem.of_field("control_mesh"));
        }
        let region = scene.region.as_ref().map(|region| reader.model("region", &region.path).1);
        if scene.props.is_empty() {
            let remedy = "Give one or more by --prop, or as props in the scene file.";
            reader.problems.push(Problem::new("props", "there are no props", remedy).of_field("props"));
        }
        let read: Vec<_> = effective.props.iter().enumerate().map(|(i, prop)| reader.prop(i, prop)).collect();
        let (props, prop_models): (Vec<Reference>, Vec<Prop>) = read.into_iter().unzip();
        let mut extra = ExtraBodies::new(&effective, params.output.fps);
        let statics = effective.statics.iter().enumerate();
        let read: Vec<_> = statics.map(|(i, model)| reader.scenery(i, model, extra.keys(i, model))).collect();
        let (statics, static_models): (Vec<Reference>, Vec<StaticModel>) = read.into_iter().unzip();
        let piles = effective.piles.iter().enumerate().map(|(i, pile)| {
            let (props, seed) = extra.pile(i, pile);
            PileShape { control: reader.model(&format!("piles.{i}"), &pile.path).1, props, seed }
        });
        let piles: Vec<PileShape> = piles.collect();
        let around = effective.around.iter().enumerate().map(|(i, result)| reader.earlier(i, result));
        let around: Vec<StaticModel> = around.collect();
        let bodies = effective.bodies.iter().enumerate().map(|(i, body)| extra.body(i, body)).collect();
        let emitter = |(i, emitter): (usize, &proto::Emitter)| {
            let place = |mesh: &String| EmitterVolume::Mesh(reader.model(&format!("emitters.{i}.mesh"), mesh).1);
            let mesh = emitter.mesh.as_ref().map(place);
            extra.emitter(i, emitter, mesh)
        };
        let emitters = effective.emitters.iter().enumerate().map(emitter).collect();
        let removals = effective.remove.iter().enumerate().map(|(i, removal)| extra.removal(i, removal)).collect();
        let collapse = effective.collapse.as_ref().map(|collapse| extra.collapse(collapse));
        reader.problems.append(&mut extra.problems);
        let ladder = Accuracy::LADDER.iter().map(|&accuracy| {
            let accuracy = proto::Accuracy::from(accuracy).into();
            from_proto::params_and_problems(&proto::Scene { accuracy, ..scene.clone() }).0
        });
        let ladder: Vec<Params> = ladder.collect();
        let control = match effective.fill.as_ref().and_then(|fill| fill.into.as_ref()) {
            Some(name) => reader.inside(name, control, &effective.statics, &static_models, (&prop_models, &params)),
            None => control.or_else(|| together(&piles)),
        };
        let given = scene;
        // Earlier results come behind the scenery that the new one shows.
        let statics_and_around = static_models.into_iter().chain(around).collect();
        let mut scene = Scene {
            control,
            piles,
            region,
            props: prop_models,
            statics: statics_and_around,
            bodies,
            emitters,
            removals,
            collapse,
        };
        reader.notes.extend(super::idle::notes(given, &effective, &params, scene.is_filled(&params)));
        if !reader.problems.is_empty() {
            reader.check_values(&scene, &params);
            return Err(Refused { problems: reader.problems, notes: reader.notes });
        }
        let mut chosen = None;
        if let (proto::Accuracy::Auto, Some(goal)) = (given.accuracy(), goal) {
            match goal::choose(&scene, &params, &ladder, goal) {
                Ok(found) => {
                    params = ladder[found.index].clone();
                    effective = effective::effective(given, &params);
                    chosen = Some(found);
                }
                Err(problems) => return Err(Refused { problems, notes: reader.notes }),
            }
        }
        reader.notes.extend(dense::run(&mut scene, &params.physics).into_iter().map(|prop| {
            let DenseProp { index, triangles, left, deviation } = prop;
            let name = &scene.props[index].model.name;
            let off = deviation * 1e3;
            format!(
                "{name}: of its {triangles} triangles, {left} stand for all in what is computed, at most {off:.2} mm \
                 off (`physics.shape_gap`); the result shows them all"
            )
        }));
        let SceneReader { source, files, mut notes, .. } = reader;
        let shown: Vec<&Reference> = props.iter().chain(&statics).collect();
        let model_bytes = match super::rehearse(&shown, &files, params.output.instancing, &*source) {
            Ok(rehearsal) => {
                notes.extend(rehearsal.left_out);
                rehearsal.bytes
            }
            Err(problems) => return Err(Refused { problems, notes }),
        };
        let read_seconds = meter.seconds();
        Ok(Job {
            scene,
            params,
            goal,
            chosen,
            ladder,
            notes,
            effective,
            began,
            meter,
            read_seconds,
            props,
            statics,
            files,
            names: PortableNames::default(),
            layout,
            model_bytes,
        })
    }
}

/// Reads models and gathers their problems. An empty model stands in for one that cannot be read; the problem then
/// prevents the job.
struct SceneReader {
    source: Arc<dyn FileSource>,
    /// Of each file.
    limits: Limits,
    files: BTreeMap<PathBuf, InputFile>,
    /// Unreadable files: reported once each, even if several models name them.
    missing: BTreeSet<PathBuf>,
    /// Of files of USD, what models mean.
    usd_parts: BTreeMap<PathBuf, BTreeSet<PartChoice>>,
    notes: Vec<String>,
    problems: Vec<Problem>,
}

impl SceneReader {
    fn new(
        source: Arc<dyn FileSource>,
        limits: Limits,
        usd_parts: BTreeMap<PathBuf, BTreeSet<PartChoice>>,
    ) -> SceneReader {
        let (files, missing) = Default::default();
        SceneReader { source, limits, files, missing, usd_parts, notes: Vec::new(), problems: Vec::new() }
    }

    /// Adds the core's problems with values. Its problems with models are left out, since unreadable models cause them.
    fn check_values(&mut self, scene: &Scene, params: &Params) {
        let Err(found) = cairn_prepare::check::run(scene, params) else { return };
        for problem in found {
            let is_model = problem.field.rsplit('.').next().is_some_and(|last| last.parse::<usize>().is_ok())
                || ["control_mesh", "region", "props"].contains(&&*problem.field);
            if !is_model && !self.problems.iter().any(|known| known.field == problem.field) {
                self.problems.push(problem.into());
            }
        }
    }

    /// A model where its file places it.
    fn model(&mut self, field: &str, path: &str) -> (Reference, Model) {
        let reference = Reference::new(path);
        let (mut mesh, is_skinned, origin) = self.mesh(field, &reference, false).unwrap_or_default();
        if origin != DVec3::ZERO {
            mesh.points.iter_mut().for_each(|point| *point += origin);
        }
        let name = reference.name.clone();
        (reference, Model { name, mesh, is_skinned })
    }

    /// A model in a frame of its own.
    fn model_of(&mut self, field: &str, reference: Reference) -> (Reference, Model) {
        let (mesh, is_skinned, _) = self.mesh(field, &reference, false).unwrap_or_default();
        let name = reference.name.clone();
        (reference, Model { name, mesh, is_skinned })
    }

    /// The mesh of a model, whether it has a skin, and where the origin of its frame is. `of_result`: of the bodies of
    /// an earlier result, as they lie in the end.
    fn mesh(&mut self, field: &str, reference: &Reference, of_result: bool) -> Option<(TriMesh, bool, DVec3)> {
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

    fn prop(&mut self, index: usize, prop: &proto::Prop) -> (Reference, Prop) {
        let (reference, model) = self.model_of(&format!("props.{index}"), Reference::of_prop(&prop.path));
        let prop = Prop {
            model,
            mesh_deviation: 0.0,
            weight: prop.weight(),
            friction: prop.friction(),
            density: prop.density(),
            restitution: prop.restitution(),
            scale: [prop.scale_min(), prop.scale_max()],
            tilt_max: prop.tilt_max(),
            scale_skew: prop.scale_skew(),
            stance: UprightRule { up: self.up(index, &prop.up), turns: Option::from(prop.turns()).unwrap_or_default() },
        };
        (reference, prop)
    }

    fn up(&mut self, index: usize, given: &[f64]) -> Option<DVec3> {
        let field = format!("props.{index}.up");
        let (what, remedy) = match *given {
            [x, y, z] if [x, y, z].iter().all(|v| v.abs() <= 1.0) => return DVec3::new(x, y, z).try_normalize(),
            [_, _, _] => (format!("{given:?} is out of range"), "Give numbers from -1 to 1."),
            _ => (format!("{} numbers are given", given.len()), "Give three: x, y, z."),
        };
        self.problems.push(Problem::new(&field, what, remedy).of_field(&field));
        None
    }

    /// The inside of a piece of scenery that has this path, file name or node, as the shape to fill.
    fn inside(
        &mut self,
        name: &str,
        control: Option<Model>,
        statics: &[proto::StaticModel],
        models: &[StaticModel],
        (props, params): (&[Prop], &Params),
    ) -> Option<Model> {
        let mut problem = |what: String, remedy: String| {
            self.problems.push(Problem::new("fill.into", what, remedy).of_field("fill.into"));
            None
        };
        if control.is_some() {
            let what = "there is a control mesh, too".into();
            return problem(what, "Leave one of control_mesh and fill.into out.".into());
        }
        let is_meant = |path: &str| {
            let (file, node) = path.split_once('#').map_or((path, None), |(file, node)| (file, Some(node)));
            let file = file.rsplit(['/', '\\']).next().unwrap_or(file);
            let stem = file.rsplit_once('.').map_or(file, |(stem, _)| stem);
            path == name || file == name || node == Some(name) || node.is_none() && stem == name
        };
        let mut found: Vec<usize> = (0..statics.len()).filter(|&i| is_meant(&statics[i].path)).collect();
        let exact: Vec<usize> = found.iter().copied().filter(|&i| statics[i].path == name).collect();
        if exact.len() == 1 {
            found = exact;
        }
        let all = || statics.iter().map(|model| &*model.path).collect::<Vec<_>>().join(", ");
        let &[index] = found.as_slice() else {
            return match (found.len(), statics.len()) {
                (_, 0) => problem(format!("there is no scenery {name}"), "Give it by --static, or as statics.".into()),
                (0, _) => problem(format!("no scenery is called {name}"), format!("Name one of {}.", all())),
                _ => problem(format!("{name} means several pieces of scenery"), format!("Name one of {}.", all())),
            };
        };
        if models[index].model.mesh.triangles.is_empty() || props.iter().any(|prop| prop.model.mesh.points.is_empty()) {
            // It could not be read: that is the problem.
            return Some(Model::default());
        }
        match cairn_prepare::inside::inside(&models[index], &params.fill, props) {
            Ok(model) => Some(model),
            Err(text) => {
                let (what, remedy) = text.rsplit_once("; ").unwrap_or((&text, ""));
                problem(what.into(), format!("{}.", capital(remedy)))
            }
        }
    }

    /// An earlier result, as scenery.
    fn earlier(&mut self, index: usize, given: &proto::EarlierResult) -> StaticModel {
        let field = format!("around.{index}");
        let reference = Reference::new(&given.path);
        if reference.node.is_some() {
            let problem = Problem::new(&given.path, "it names a node of a result", "Name the file alone.");
            self.problems.push(problem.of_field(&format!("{field}.path")));
        }
        let friction = given.friction();
        if !(0.0..=2.0).contains(&friction) {
            let field = format!("{field}.friction");
            let problem = Problem::new(&field, format!("{friction} is out of range"), "Give a value from 0 to 2.");
            self.problems.push(problem.of_field(&field));
        }
        let (mesh, ..) = self.mesh(&field, &reference, true).unwrap_or_default();
        StaticModel { model: Model::new(reference.name, mesh), friction, keys: Vec::new() }
    }

    fn scenery(&mut self, index: usize, given: &proto::StaticModel, keys: Vec<Keyframe>) -> (Reference, StaticModel) {
        let (reference, model) = self.model(&format!("statics.{index}"), &given.path);
        (reference, StaticModel { model, friction: given.friction(), keys })
    }
}

/// Several shapes as one.
fn together(piles: &[PileShape]) -> Option<Model> {
    let names: Vec<&str> = piles.iter().map(|pile| &*pile.control.name).collect();
    let mut mesh = TriMesh::default();
    piles.iter().for_each(|pile| mesh.append(&pile.control.mesh));
    (!piles.is_empty()).then(|| Model::new(names.join(", "), mesh))
}

/// A sentence's beginning.
fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
