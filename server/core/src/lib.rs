//! The method of Hsu & Keyser (2012) and its measures: meshes and parameters in, poses and figures out.
//!
//! Synchronous and pure: no files, no clock, no wire, no global randomness.

pub mod asset;
pub mod equilibrium;
pub mod error;
pub mod geometry;
pub mod input;
pub mod measure;
pub mod prepare;
pub mod report;
pub mod sim;
pub mod stages;
pub mod world;

pub use error::Error;

use error::Problem;
use geometry::pose::Pose;
use geometry::region::DistanceGrid;
use input::observer::{Observer, Silent, Stage};
use input::params::Params;
use input::scene::{self, Scene};
use prepare::check::{self, Checked};
use prepare::container::{Container, grid};
use prepare::effects;
use prepare::estimate::{self, Estimate, Workload};
use prepare::plan::{self, Plan};
use prepare::shape::{self, Shape};
use report::bake::Bake;
use report::figures;
use sim::control::Control;
use stages::cache::{FillInputs, Found, Memory, NoMemory, Witness};
use stages::fill::Filled;
use stages::{fill, hold, release};
use std::collections::BTreeMap;
use world::Units;

/// Checks the scene and tells what would be simulated; simulates nothing.
pub fn plan(scene: &Scene, params: &Params) -> Result<Plan, Error> {
    let checked = check::run(scene, params).map_err(Error::Invalid)?;
    Ok(plan::of(scene, params, &checked, &shape::outlines(scene, params, &checked.sizes)))
}

/// The numbers that decide what a bake of the scene costs. Makes the collision shapes, and simulates nothing.
pub fn workload(scene: &Scene, params: &Params) -> Result<Workload, Error> {
    let checked = check::run(scene, params).map_err(Error::Invalid)?;
    let shapes = shape::run(scene, params, &checked.sizes, &mut Silent)?;
    Ok(Workload::of(scene, params, &checked, &shapes))
}

/// Tells what the scene will cost with each of `ladder`; makes the collision shapes that `params` ask for, which stand for those
/// of the others, and simulates nothing of it. `machine`: from [`estimate::calibrate`].
pub fn estimates(scene: &Scene, params: &Params, ladder: &[Params], machine: f64) -> Result<Vec<Estimate>, Error> {
    // What checking finds out does not depend on the accuracy.
    let checked = check::run(scene, params).map_err(Error::Invalid)?;
    let shapes = shape::run(scene, params, &checked.sizes, &mut Silent)?;
    Ok(ladder.iter().map(|params| estimate::of(scene, params, &checked, &shapes, machine)).collect())
}

/// The method: shapes, fill, turn over, release, hold. A scene may bring its bodies along instead of a fill.
pub fn bake(scene: &Scene, params: &Params, observer: &mut dyn Observer) -> Result<Bake, Error> {
    bake_with(scene, params, &mut NoMemory, observer)
}

/// The same, for a caller who knows of earlier bakes.
pub fn bake_with(
    scene: &Scene,
    params: &Params,
    memory: &mut dyn Memory,
    observer: &mut dyn Observer,
) -> Result<Bake, Error> {
    let full = fill_container(scene, params, memory, observer)?;
    release_pile(scene, params, &full, observer)
}

/// A full container, ready to be turned over; any number of releases may start from it.
pub struct FullContainer {
    checked: Checked,
    shapes: Vec<Shape>,
    units: Units,
    filled: Option<(Container, Filled)>,
    /// Where the control acts, if that is not the inside of the container; engine units.
    region: Option<DistanceGrid>,
    /// Nothing was filled now: it was known.
    is_recalled: bool,
    seconds: BTreeMap<Stage, f64>,
}

/// The first half of [`bake`]: collision shapes, and the fill.
pub fn fill_container(
    scene: &Scene,
    params: &Params,
    memory: &mut dyn Memory,
    observer: &mut dyn Observer,
) -> Result<FullContainer, Error> {
    let checked = check::run(scene, params).map_err(Error::Invalid)?;
    let mut clock = figures::Clock::new(observer);

    let inputs = FillInputs::new(scene, params, &checked, observer.wants_frames());
    let known = if memory.keeps() { memory.recall(&inputs) } else { None };
    let shapes = match &known {
        Some(known) => known.shapes.clone(),
        None => shape::run(scene, params, &checked.sizes, observer)?,
    };
    let units = Units::new(checked.diameter, median_mass(scene, &shapes, &checked.shares), params.gravity);
    let filled_mesh = checked.control.as_ref().filter(|_| scene.is_filled(params));
    let tolerance = params.fill.wall_tolerance;
    let container = filled_mesh.map(|closed| Container::new(closed, units.length, checked.ground, tolerance));
    let own = if container.is_some() { checked.region.as_ref() } else { checked.region.as_ref().or(checked.target()) };
    let region = own.map(|mesh| grid(&mesh.mesh, units.length).1);
    clock.lap(Stage::Shape, observer);

    if let Some(known) = known {
        known.show(observer);
        let filled = container.zip(known.filled);
        let seconds = clock.into_seconds();
        return Ok(FullContainer { checked, shapes, units, filled, region, is_recalled: true, seconds });
    }
    let mut filled = None;
    let mut witness = Witness::new(observer, memory.keeps());
    if let Some(container) = container {
        let bodies = fill::run(scene, &shapes, params, units, &container, &mut witness)?;
        if bodies.bodies.is_empty() {
            let text = format!(
                "{}: not one prop found room inside; make the control mesh larger, or the props smaller",
                scene.control.as_ref().map_or("", |model| &model.name)
            );
            return Err(Error::Invalid(vec![Problem::new("control_mesh", text)]));
        }
        filled = Some((container, bodies));
        clock.lap(Stage::Fill, &mut witness);
    }
    let shown = witness.into_shown();
    let found = Found { shapes, filled: filled.as_ref().map(|(_, filled)| filled.clone()), shown };
    let is_whole = found.shown.is_some() || !observer.wants_frames();
    if memory.keeps() && is_whole {
        memory.keep(&inputs, &found);
    }
    let (shapes, seconds) = (found.shapes, clock.into_seconds());
    Ok(FullContainer { checked, shapes, units, filled, region, is_recalled: false, seconds })
}

/// The second half of [`bake`]: turn over, release, hold. `params` may differ from the fill's in what comes after it.
pub fn release_pile(
    scene: &Scene,
    params: &Params,
    full: &FullContainer,
    observer: &mut dyn Observer,
) -> Result<Bake, Error> {
    let FullContainer { checked, shapes, units, filled, region, is_recalled, seconds } = full;
    let outlines: Vec<_> = shapes.iter().map(|shape| shape.solid.outline()).collect();
    let plan = plan::of(scene, params, checked, &outlines);
    let mut clock = figures::Clock::new(observer);

    let inside = region.as_ref().or(filled.as_ref().map(|(container, _)| &container.distance));
    let inside = inside.filter(|_| params.control.switches.region.is_on(true));
    let control = Control::new(&params.control, params.gravity, params.seed, inside);
    let bodies = filled.as_ref().map_or(&[][..], |(_, filled)| &filled.bodies);
    let mut pile = release::turn_over(scene, shapes, params, *units, bodies, checked.ground, control)?;
    release::run(&mut pile, params, observer)?;
    clock.lap(Stage::Release, observer);

    let held = hold::run(&mut pile, params, observer)?;
    clock.lap(Stage::Hold, observer);

    let (mut bodies, mut frames) = figures::prop_frames(&pile);
    if bodies.is_empty() {
        let text = "bodies, emitters: not one body appears before the last frame; bake more frames";
        return Err(Error::Invalid(vec![Problem::new("output.frames", text)]));
    }
    let filled = filled.as_ref();
    let target = checked.target().map(|target| &target.mesh);
    let inputs =
        figures::Inputs { scene, params, plan, shapes, target, filled, held, bodies: &bodies, ground: checked.ground };
    let mut report = figures::report(&inputs, &mut pile, &frames, observer)?;
    clock.lap(Stage::Measure, observer);
    report.seconds = seconds.iter().map(|(&s, &t)| (s, t)).chain(clock.into_seconds()).collect();
    let stage = |stage: Stage| report.seconds.get(&stage).copied().unwrap_or(0.0);
    let own = BTreeMap::from([
        ("decomposition", stage(Stage::Shape)),
        ("fill", stage(Stage::Fill)),
        ("control", pile.control_seconds),
        ("frames", pile.frame_seconds),
        ("free_standing", pile.standing_seconds),
    ]);
    let total = report.seconds.values().sum();
    if *is_recalled {
        report.recall_fill();
    }
    report.bill = effects::bill(&report.plan.effects, &report.counts, &own, total);
    let keeps = pile.recorder.keeps();
    let count = if keeps { frames.len() } else { pile.recorder.count() + 1 };
    let mut scenery = scenery_frames(scene, params.output.fps, count);
    if !keeps {
        frames.drain(..frames.len() - 1);
        bodies.iter_mut().for_each(|body| body.first_frame = 0);
        scenery.iter_mut().for_each(|poses| drop(poses.drain(..poses.len().saturating_sub(1))));
    }
    Ok(Bake { fps: params.output.fps, bodies, frames, scenery, report })
}

/// Where the moving scenery is. Shape `[static][frame]`, empty for a static one that stands still.
fn scenery_frames(scene: &Scene, fps: f64, frames: usize) -> Vec<Vec<Pose>> {
    let poses = |model: &scene::StaticModel| {
        let count = if model.keys.is_empty() { 0 } else { frames };
        (0..count).map(|frame| model.pose_at(frame as f64 / fps)).collect()
    };
    scene.statics.iter().map(poses).collect()
}

/// The mass of the prop in the middle, among those that the pile is made of, kg: the engine's unit.
fn median_mass(scene: &Scene, shapes: &[Shape], shares: &[f64]) -> f64 {
    let middle = |[lo, hi]: [f64; 2]| ((lo + hi) / 2.0).powi(3);
    let used = scene.props.iter().zip(shapes).zip(shares).filter(|(_, share)| **share > 0.0);
    let mut masses: Vec<f64> = used.map(|((p, s), _)| s.mass * middle(p.scale)).collect();
    masses.sort_by(f64::total_cmp);
    masses[masses.len() / 2]
}
