//! Reads a scene's files, and gathers all problems of scene and files.

mod earlier;
mod models;

use super::machine::Meter;
use super::sources::{self, PortableNames, Reference};
use super::{Job, Refused, goal, idle};
use cairn_export::Layout;
use cairn_files::problem::Problem;
use cairn_files::{Disk, FileSource};
use cairn_geometry::mesh::TriMesh;
use cairn_input::asset::Limits;
use cairn_input::params::{Accuracy, Params};
use cairn_input::scene::{EmitterVolume, Keyframe, Model, PileShape, Prop, Scene, StaticModel, UprightRule};
use cairn_prepare::dense::{self, DenseProp};
use cairn_prepare::estimate::Goal;
use cairn_wire::effective;
use cairn_wire::from_proto::{self, extra_bodies::ExtraBodies};
use cairn_wire::proto;
use cairn_wire::scene_file::SceneTree;
use glam::DVec3;
use models::SceneReader;
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
    pub fn read_with(given: &proto::Scene, source: Arc<dyn FileSource>, limits: Limits) -> Result<Job, Refused> {
        let (began, meter) = (Instant::now(), Meter::start());
        let mut reader = SceneReader::new(source, limits, sources::usd_parts(given));
        let mut settings = Settings::read(given, &mut reader.problems);
        let ladder = ladder(given);
        let ReadScene { mut scene, props, statics } = reader.scene(given, &settings);
        let Settings { params, effective, .. } = &settings;
        reader.notes.extend(idle::notes(given, effective, params, scene.is_filled(params)));
        reader.add_refused();
        if !reader.problems.is_empty() {
            reader.check_values(&scene, params);
            return Err(Refused { problems: reader.problems, notes: reader.notes });
        }
        let SceneReader { source, files, mut notes, .. } = reader;
        let chosen = match settings.choose_accuracy(given, &scene, &ladder) {
            Ok(chosen) => chosen,
            Err(problems) => return Err(Refused { problems, notes }),
        };
        let Settings { params, goal, effective, layout } = settings;
        notes.extend(simplify_dense_props(&mut scene, &params));
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

/// What a scene says besides its models.
struct Settings {
    params: Params,
    goal: Option<Goal>,
    /// The scene with all defaults filled in.
    effective: proto::Scene,
    layout: Layout,
}

impl Settings {
    fn read(given: &proto::Scene, problems: &mut Vec<Problem>) -> Settings {
        let (params, of_params) = from_proto::params_and_problems(given);
        let (goal, of_goal) = from_proto::goal(given);
        let layout = given.usd.as_ref().map_or(Ok(Layout::default()), Layout::new);
        problems.extend(of_params.into_iter().chain(of_goal));
        let layout = layout.unwrap_or_else(|of_layout| {
            problems.extend(of_layout);
            Layout::default()
        });
        let effective = effective::effective(given, &params);
        Settings { params, goal, effective, layout }
    }

    /// Puts the preset that the goal calls for in the place of the accuracy `auto`.
    fn choose_accuracy(
        &mut self,
        given: &proto::Scene,
        scene: &Scene,
        ladder: &[Params],
    ) -> Result<Option<goal::Chosen>, Vec<Problem>> {
        let (proto::Accuracy::Auto, Some(goal)) = (given.accuracy(), self.goal) else { return Ok(None) };
        let chosen = goal::choose(scene, &self.params, ladder, goal)?;
        self.params = ladder[chosen.index].clone();
        self.effective = effective::effective(given, &self.params);
        Ok(Some(chosen))
    }
}

/// The parameters at each accuracy, fastest first.
fn ladder(given: &proto::Scene) -> Vec<Params> {
    let params = |&accuracy: &Accuracy| {
        let accuracy = proto::Accuracy::from(accuracy).into();
        from_proto::params_and_problems(&proto::Scene { accuracy, ..given.clone() }).0
    };
    Accuracy::LADDER.iter().map(params).collect()
}

/// Gives props of too many triangles simpler meshes, and says so.
fn simplify_dense_props(scene: &mut Scene, params: &Params) -> Vec<String> {
    let dense = dense::run(scene, &params.physics);
    let said = dense.into_iter().map(|DenseProp { index, triangles, left, deviation }| {
        let name = &scene.props[index].model.name;
        let off = deviation * 1e3;
        format!(
            "{name}: of its {triangles} triangles, {left} stand for all in what is computed, at most {off:.2} mm off \
             (`physics.shape_gap`); the result shows them all"
        )
    });
    said.collect()
}

/// A scene with its models, and where the models are that its result shows.
struct ReadScene {
    scene: Scene,
    props: Vec<Reference>,
    statics: Vec<Reference>,
}

impl SceneReader {
    /// Reads all models of a scene.
    fn scene(&mut self, given: &proto::Scene, Settings { params, effective, .. }: &Settings) -> ReadScene {
        let control = given.control_mesh.as_ref().map(|control| self.model("control_mesh", &control.path).1);
        self.check_shapes(given);
        let region = given.region.as_ref().map(|region| self.model("region", &region.path).1);
        if given.props.is_empty() {
            let remedy = "Give one or more by --prop, or as props in the scene file.";
            self.problems.push(Problem::new("props", "there are no props", remedy).of_field("props"));
        }
        let props = effective.props.iter().enumerate().map(|(i, prop)| self.prop(i, prop));
        let (shown_props, props): (Vec<Reference>, Vec<Prop>) = props.unzip();
        let mut extra = ExtraBodies::new(effective, params.output.fps);
        let statics = effective.statics.iter().enumerate();
        let statics = statics.map(|(i, model)| self.scenery(i, model, extra.keys(i, model)));
        let (shown_statics, mut statics): (Vec<Reference>, Vec<StaticModel>) = statics.unzip();
        let piles = effective.piles.iter().enumerate().map(|(i, pile)| {
            let (props, seed) = extra.pile(i, pile);
            PileShape { control: self.model(&format!("piles.{i}"), &pile.path).1, props, seed }
        });
        let piles: Vec<PileShape> = piles.collect();
        let around = effective.around.iter().enumerate().map(|(i, result)| self.earlier(i, result));
        let around: Vec<StaticModel> = around.collect();
        let bodies = effective.bodies.iter().enumerate().map(|(i, body)| extra.body(i, body)).collect();
        let emitters = effective.emitters.iter().enumerate().map(|(i, emitter)| {
            let place = |mesh: &String| EmitterVolume::Mesh(self.model(&format!("emitters.{i}.mesh"), mesh).1);
            let mesh = emitter.mesh.as_ref().map(place);
            extra.emitter(i, emitter, mesh)
        });
        let emitters = emitters.collect();
        let removals = effective.remove.iter().enumerate().map(|(i, removal)| extra.removal(i, removal)).collect();
        let collapse = effective.collapse.as_ref().map(|collapse| extra.collapse(collapse));
        self.problems.append(&mut extra.problems);
        let control = match effective.fill.as_ref().and_then(|fill| fill.into.as_ref()) {
            Some(name) => self.inside(name, control, &effective.statics, &statics, (&props, params)),
            None => control.or_else(|| together(&piles)),
        };
        // Earlier results come behind the scenery that the new one shows.
        statics.extend(around);
        let earlier = self.former(effective, &shown_props);
        let scene = Scene { control, piles, region, props, statics, bodies, emitters, removals, collapse, earlier };
        ReadScene { scene, props: shown_props, statics: shown_statics }
    }

    /// A scene has one kind of shape to fill, or bodies without one.
    fn check_shapes(&mut self, given: &proto::Scene) {
        let has_shape = given.control_mesh.is_some() || given.fill.as_ref().is_some_and(|fill| fill.into.is_some());
        let has_piles = !given.piles.is_empty();
        if has_piles && has_shape {
            let what = "there is another shape, too";
            let problem =
                Problem::new("piles", what, "Leave piles, control_mesh or fill.into out, but for one of them.");
            self.problems.push(problem.of_field("piles"));
        }
        if given.from.is_some() && !has_shape && !has_piles {
            let remedy = "Give a control mesh, or leave `from` out.";
            let problem = Problem::new("from", "the scene fills nothing that it could change", remedy);
            self.problems.push(problem.of_field("from"));
        }
        if !has_shape && !has_piles && given.bodies.is_empty() && given.emitters.is_empty() {
            let remedy = "Give one by --control, or as control_mesh in the scene file; or place bodies there.";
            let problem = Problem::new("control_mesh", "there is no control mesh", remedy);
            self.problems.push(problem.of_field("control_mesh"));
        }
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
