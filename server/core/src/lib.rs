//! The method of Hsu & Keyser (2012) and its measures: meshes and parameters in, poses and figures out.
//!
//! Synchronous and pure: no files, no clock, no wire, no global randomness.

pub mod asset;
pub mod bake;
pub mod check;
pub mod container;
pub mod control;
pub mod equilibrium;
pub mod figures;
pub mod fill;
pub mod free_pour;
pub mod hold;
pub mod measure;
pub mod mesh;
pub mod observer;
pub mod params;
pub mod plan;
pub mod pose;
pub mod problem;
pub mod record;
pub mod region;
pub mod release;
pub mod report;
pub mod scene;
pub mod shape;
mod standing;
pub mod topology;
mod weld;
pub mod world;

use bake::{Bake, Body};
use check::Checked;
use container::Container;
use control::Control;
use fill::Filled;
use observer::{Observer, Stage};
use params::Params;
use plan::Plan;
use problem::Problem;
use scene::Scene;
use shape::Shape;
use std::collections::BTreeMap;
use world::Units;

/// Why a scene cannot be baked, or a bake did not finish.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene or its parameters are at fault: every problem, each naming its place and the remedy.
    #[error("{}", .0.iter().map(Problem::to_string).collect::<Vec<_>>().join("\n"))]
    Invalid(Vec<Problem>),
    #[error("cancelled")]
    Cancelled,
    /// Our fault.
    #[error("internal error: {0}")]
    Internal(String),
}

/// Checks the scene and tells what would be simulated; simulates nothing.
pub fn plan(scene: &Scene, params: &Params) -> Result<Plan, Error> {
    let checked = check::run(scene, params).map_err(Error::Invalid)?;
    Ok(plan::of(scene, params, &checked))
}

/// The method: shapes, fill, turn over, release, hold.
pub fn bake(scene: &Scene, params: &Params, observer: &mut dyn Observer) -> Result<Bake, Error> {
    let full = fill_container(scene, params, observer)?;
    release_pile(scene, params, &full, observer)
}

/// A full container, ready to be turned over; any number of releases may start from it.
pub struct FullContainer {
    checked: Checked,
    shapes: Vec<Shape>,
    units: Units,
    container: Container,
    filled: Filled,
    seconds: BTreeMap<Stage, f64>,
}

/// The first half of [`bake`]: collision shapes, and the fill.
pub fn fill_container(scene: &Scene, params: &Params, observer: &mut dyn Observer) -> Result<FullContainer, Error> {
    let checked = check::run(scene, params).map_err(Error::Invalid)?;
    let mut clock = figures::Clock::new(observer);

    let shapes = shape::run(scene, params, &checked, observer)?;
    let units = Units::new(checked.diameter, median_mass(scene, &shapes), params.gravity);
    let container = Container::new(&checked.control, &checked.topology, units.length, checked.ground);
    clock.lap(Stage::Shape, observer);

    let filled = fill::run(scene, &shapes, params, units, &container, observer)?;
    if filled.bodies.is_empty() {
        let text = format!(
            "{}: not one prop found room inside; make the control mesh larger, or the props smaller",
            scene.control.name
        );
        return Err(Error::Invalid(vec![Problem::new("control_mesh", text)]));
    }
    clock.lap(Stage::Fill, observer);
    Ok(FullContainer { checked, shapes, units, container, filled, seconds: clock.into_seconds() })
}

/// The second half of [`bake`]: turn over, release, hold. `params` may differ from the fill's in what comes after it.
pub fn release_pile(
    scene: &Scene,
    params: &Params,
    full: &FullContainer,
    observer: &mut dyn Observer,
) -> Result<Bake, Error> {
    let FullContainer { checked, shapes, units, container, filled, seconds } = full;
    let plan = plan::of(scene, params, checked);
    let mut clock = figures::Clock::new(observer);

    let control = Control::new(&params.control, params.gravity, params.seed, &container.distance);
    let mut pile = release::turn_over(scene, shapes, params, *units, &filled.bodies, checked.ground, control)?;
    release::run(&mut pile, params, observer)?;
    clock.lap(Stage::Release, observer);

    let held = hold::run(&mut pile, params, observer)?;
    clock.lap(Stage::Hold, observer);

    let bodies = filled.bodies.iter().map(|b| Body { prop: b.prop, scale: b.scale }).collect();
    let frames = figures::prop_frames(&pile);
    let inputs = figures::Inputs { scene, params, plan, shapes, control: &checked.control, container, filled, held };
    let mut report = figures::report(&inputs, &mut pile, &frames, observer)?;
    clock.lap(Stage::Measure, observer);
    report.seconds = seconds.iter().map(|(&s, &t)| (s, t)).chain(clock.into_seconds()).collect();
    Ok(Bake { fps: params.output.fps, bodies, frames, report })
}

/// The mass of the prop in the middle, kg: the engine's unit.
fn median_mass(scene: &Scene, shapes: &[Shape]) -> f64 {
    let middle = |[lo, hi]: [f64; 2]| ((lo + hi) / 2.0).powi(3);
    let mut masses: Vec<f64> = scene.props.iter().zip(shapes).map(|(p, s)| s.mass * middle(p.scale)).collect();
    masses.sort_by(f64::total_cmp);
    masses[masses.len() / 2]
}
