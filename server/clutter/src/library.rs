//! All that layouts share, read and prepared once: models, collision shapes, worlds with their scenery, surfaces.

use crate::catalogue::{Catalogue, PlaceEntry, PropEntry, Span};
use crate::surfaces::Surfaces;
use crate::view::View;
use cairn_engine::shape::{Shape, hull_mesh};
use cairn_engine::units::Units;
use cairn_engine::world::{WallId, World};
use cairn_export::{ConvexCover, CoverLimits};
use cairn_files::Disk;
use cairn_files::problem::Problem;
use cairn_input::asset::Limits;
use cairn_input::params::{Accuracy, Fill, FrictionModel, Params, Physics};
use cairn_input::scene::{Prop, Scene, StaticModel};
use cairn_job::reuse::BakeCache;
use cairn_job::{Job, Refused};
use cairn_prepare::effects::Resolved;
use cairn_prepare::{check, inside};
use cairn_wire::proto;
use cairn_wire::scene_file::SceneTree;
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;

/// Thickness of the plates that the walls of a place become that is not made of convex solids, in the median prop's
/// diameter.
const PLATE: f64 = 0.05;
/// Bodies come to rest, and are tried, with this share of the friction that they have while they fall and the ground
/// tilts: with all of it, a body stays on a slope of 3 degrees, and creeps down it by a millimeter a second in MuJoCo.
/// So did one of 25 to 50 shelves.
const REST_FRICTION: f64 = 0.5;
/// Solids of a place at most.
const MOST_SOLIDS: usize = 4000;

/// A place, prepared.
pub struct Place {
    pub label: String,
    /// Relative to the other places.
    pub weight: f64,
    pub count: Option<Span>,
    pub level: Option<Span>,
    pub surfaces: Surfaces,
    /// Of its inside, up to its rim, m^3; only of a place that is filled to a level.
    pub volume: Option<f64>,
    /// Its scenery without bodies: each layout begins with a copy.
    pub world: World,
    /// Its scenery in that world.
    pub walls: Vec<WallId>,
    /// The same as convex solids, for other engines.
    pub cover: ConvexCover,
}

/// A catalogue with all that its layouts need.
pub struct Library {
    pub catalogue: Catalogue,
    pub job: Job,
    /// One per prop, as the engine has it.
    pub shapes: Vec<Shape>,
    /// How many of them were not in the cache.
    pub new_shapes: usize,
    pub labels: Vec<String>,
    pub places: Vec<Place>,
    /// `None`: the catalogue asks for nothing that a camera sees.
    pub view: Option<View>,
    pub units: Units,
    pub params: Params,
    /// As far as the masses and sizes of the props ask for it.
    pub physics: Physics,
    /// Smallest thickness of a prop, in units of length.
    pub thickness: f64,
    /// Of the catalogue's values, its files' bytes and the version, in hexadecimal digits.
    pub hash: String,
}

impl Library {
    /// Reads all files of a catalogue, or returns all problems. Collision shapes come from the cache, as far as they
    /// are there: they take longest.
    pub fn read(catalogue: Catalogue, limits: Limits, cache: &BakeCache) -> Result<Library, Refused> {
        let given = scene(&catalogue)?;
        let named = |refused: Refused| Refused {
            problems: refused.problems.into_iter().map(of_catalogue).collect(),
            notes: refused.notes,
        };
        let job = Job::read_with(&given, Arc::new(Disk::default()), limits).map_err(named)?;
        let job = job.relative_to(&catalogue.folder);
        let mut params = job.params.clone();
        // As in all common engines: what rests by them alone rests nowhere else.
        params.physics.friction_model = FrictionModel::Coulomb;
        let notes = || job.notes.clone();
        let core = |error: cairn_core::Error| match error {
            cairn_core::Error::Invalid(problems) => Refused {
                problems: problems.into_iter().map(Problem::from).map(of_catalogue).collect(),
                notes: notes(),
            },
            other => refused(vec![Problem::from(other.to_string())]),
        };
        let checked = check::run(&job.scene, &params).map_err(|found| core(cairn_core::Error::Invalid(found)))?;
        let (shapes, new_shapes) = cache.shapes(&job.scene, &params, &checked.sizes).map_err(core)?;
        let summaries: Vec<_> = shapes.iter().map(Shape::summary).collect();
        let resolved = Resolved::new(&job.scene, &params, &checked, &summaries);
        let units = Units::new(checked.diameter, middle_mass(&job.scene.props, &shapes), params.gravity);
        let (physics, thickness) = (resolved.physics.clone(), resolved.thickness);
        let labels = catalogue.props.iter().map(PropEntry::label).collect();
        let clearance = check::least_extents(&job.scene, &checked.sizes).x;
        let mut problems = Vec::new();
        let mut places = Vec::new();
        for (i, (entry, model)) in catalogue.places.iter().zip(&job.scene.statics).enumerate() {
            match place(entry, model, &job.scene.props, clearance, &resolved, units) {
                Ok(place) => places.push(place),
                Err(problem) => problems.push(problem.of_field(&format!("places.{i}"))),
            }
        }
        if !problems.is_empty() {
            return Err(Refused { problems, notes: notes() });
        }
        let hash = hash(&catalogue, &job);
        let view = View::new(&catalogue, &job.scene);
        Ok(Library {
            catalogue,
            job,
            shapes,
            new_shapes,
            labels,
            places,
            view,
            units,
            params,
            physics,
            thickness,
            hash,
        })
    }

    /// What is not as in the files, one sentence each.
    pub fn notes(&self) -> &[String] {
        &self.job.notes
    }

    /// Largest friction while bodies come to rest, and in the trial.
    pub fn rest_friction(&self) -> f64 {
        REST_FRICTION * self.catalogue.settle_friction()
    }

    pub fn scene(&self) -> &Scene {
        &self.job.scene
    }
}

fn refused(problems: Vec<Problem>) -> Refused {
    Refused { problems, notes: Vec::new() }
}

/// A place is a scene's scenery.
fn of_catalogue(mut problem: Problem) -> Problem {
    for text in [&mut problem.field, &mut problem.place, &mut problem.what] {
        *text = text.replace("statics.", "places.");
    }
    problem
}

/// A scene with the catalogue's props and places, so that files are read and values checked as those of all scenes.
fn scene(catalogue: &Catalogue) -> Result<proto::Scene, Refused> {
    let Catalogue { folder, settings, props, places } = catalogue;
    let at = |path: &str| folder.join(path).to_string_lossy().into_owned();
    let mut tree = SceneTree::default();
    let mut problems = Vec::new();
    for (name, value) in [
        ("accuracy", settings.accuracy.clone()),
        ("gravity", settings.gravity.map(|gravity| gravity.to_string())),
        ("ground", Some("false".into())),
    ] {
        if let Some(value) = value
            && let Err(found) = tree.set(&format!("{name}={value}"))
        {
            problems.extend(found.into_iter().map(|problem| Problem { place: name.to_owned(), ..problem }));
        }
    }
    if !problems.is_empty() {
        return Err(refused(problems));
    }
    let prop = |entry: &PropEntry| proto::Prop {
        path: at(&entry.path),
        weight: entry.weight,
        friction: entry.friction,
        density: entry.density,
        restitution: entry.restitution,
        scale_min: entry.scale_min,
        scale_max: entry.scale_max,
        ..Default::default()
    };
    let place = |entry: &PlaceEntry| proto::StaticModel {
        path: at(&entry.path),
        friction: entry.friction,
        ..Default::default()
    };
    Ok(proto::Scene {
        props: props.iter().map(prop).collect(),
        statics: places.iter().map(place).collect(),
        // Draws from all props by weight, as layouts do: sizes and masses are judged by it.
        emitters: vec![proto::Emitter::default()],
        ..tree.to_message()
    })
}

fn place(
    entry: &PlaceEntry,
    model: &StaticModel,
    props: &[Prop],
    clearance: f64,
    resolved: &Resolved,
    units: Units,
) -> Result<Place, Problem> {
    let surfaces = Surfaces::new(model, clearance);
    if surfaces.is_empty() {
        let remedy = "Name a model with a floor that faces up, and room above it.";
        return Err(Problem::new(&model.model.name, "there is nothing on which a prop could stand", remedy));
    }
    let volume = match entry.level {
        None => None,
        Some(_) => {
            let whole = Fill { share: 1.0, heap: 0.0, level: None, ..Params::new(Accuracy::Standard).fill };
            let filled = inside::inside(model, &whole, props).map_err(|text| {
                let remedy = "Give a count instead of a level.";
                Problem::new(&model.model.name, text.split("; ").next().unwrap_or_default(), remedy)
            })?;
            Some(filled.mesh.signed_volume().abs())
        }
    };
    let (low, high) = surfaces.bounds;
    let units = units.about((low + high) / 2.0);
    let mut world = World::new(units, &resolved.physics, resolved.thickness, resolved.compounds);
    world.watch_bobbing();
    let limits = CoverLimits { bounds: (low, high), thickness: PLATE * units.length, most: MOST_SOLIDS };
    let cover = ConvexCover::new(&model.model.mesh, &limits);
    let walls = match cover.plates + cover.left_out {
        // A solid pushes out what a surface lets through: thin props fall into the boards that they lie on.
        0 => {
            let solid = |points: &Vec<DVec3>| world.add_core(&hull_mesh(points), true, model.friction);
            cover.solids.iter().map(solid).collect::<Result<_, String>>()
        }
        _ => world.add_piece(&units.mesh_to_engine(&model.model.mesh), model.friction).map(|wall| vec![wall]),
    };
    let walls = walls.map_err(|what| {
        Problem::new(&model.model.name, what, "Export the model again, with triangles that have an area.")
    })?;
    let PlaceEntry { weight, count, level, .. } = entry;
    Ok(Place {
        label: entry.label(),
        weight: weight.unwrap_or(1.0),
        count: *count,
        level: *level,
        surfaces,
        volume,
        world,
        walls,
        cover,
    })
}

/// Mass of the prop in the middle of those that are drawn, kg.
fn middle_mass(props: &[Prop], shapes: &[Shape]) -> f64 {
    let middle = |[low, high]: [f64; 2]| ((low + high) / 2.0).powi(3);
    let drawn = props.iter().zip(shapes).filter(|(prop, _)| prop.weight > 0.0);
    let mut masses: Vec<f64> = drawn.map(|(prop, shape)| shape.mass * middle(prop.scale)).collect();
    masses.sort_by(f64::total_cmp);
    masses.get(masses.len() / 2).copied().unwrap_or(1.0)
}

fn hash(catalogue: &Catalogue, job: &Job) -> String {
    let Catalogue { settings, props, places, .. } = catalogue;
    let mut hasher = blake3::Hasher::new();
    hasher.update(cairn_files::version::VERSION.as_bytes());
    hasher.update(format!("{settings:?} {props:?} {places:?}").as_bytes());
    for file in job.inputs() {
        // Where files lie is no part of it.
        hasher.update(file.file_name().map(Path::new).unwrap_or(Path::new("")).to_string_lossy().as_bytes());
        hasher.update(blake3::hash(&std::fs::read(&file).unwrap_or_default()).as_bytes());
    }
    hasher.finalize().to_hex()[..32].to_owned()
}
