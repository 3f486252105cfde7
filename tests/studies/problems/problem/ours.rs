//! A problem in Cairn.

use super::cpu::{Cpu, simulation};
use super::{FPS, Problem};
use cairn_engine::shape;
use cairn_engine::shape::Shape;
use cairn_geometry::pose::Pose;
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, ControlMode, FrictionModel, GlueMode, Params, ReleaseOrder, Switch, Time};
use cairn_input::scene::Scene;
use cairn_prepare::check;

/// How Cairn is set.
pub struct Variant {
    pub name: &'static str,
    pub accuracy: Accuracy,
    change: fn(&mut Params),
}

const fn preset(name: &'static str, accuracy: Accuracy) -> Variant {
    Variant { name, accuracy, change: |_| {} }
}

const fn changed(name: &'static str, change: fn(&mut Params)) -> Variant {
    Variant { name, accuracy: Accuracy::Standard, change }
}

/// A bake as it is delivered: the control certifies and holds what stands.
pub const CONTROLLED: &str = "standard, with its control";

/// The presets from the cheapest on, the control, and single parameters.
pub const VARIANTS: &[Variant] = &[
    preset("draft", Accuracy::Draft),
    preset("preview", Accuracy::Preview),
    preset("standard", Accuracy::Standard),
    preset("fine", Accuracy::Fine),
    preset("reference", Accuracy::Reference),
    changed(CONTROLLED, |params| params.control.mode = Params::new(Accuracy::Standard).control.mode),
    changed("physics.step_natural=0.1", |params| params.physics.step = Time::Natural(0.1)),
    changed("physics.step_natural=0.025", |params| params.physics.step = Time::Natural(0.025)),
    changed("physics.substeps=4", |params| params.physics.substeps = 4),
    changed("physics.substeps=16", |params| params.physics.substeps = 16),
    changed("physics.contact_frequency=10", |params| params.physics.contact_frequency = 10.0),
    changed("physics.contact_frequency=60", |params| params.physics.contact_frequency = 60.0),
    changed("physics.friction_model=coulomb", |params| params.physics.friction_model = FrictionModel::Coulomb),
];

/// From the cheapest to the most accurate.
pub const PRESETS: [&str; 5] = ["draft", "preview", "standard", "fine", "reference"];

pub fn variant(name: &str) -> Option<&'static Variant> {
    VARIANTS.iter().find(|variant| variant.name == name)
}

/// Physics alone: no control but in its own row, no glue, and nothing that slows bodies by itself.
fn params(problem: &Problem, scene: &Scene, variant: &Variant) -> Params {
    let mut params = Params::new(variant.accuracy);
    params.control.mode = ControlMode::Off;
    (variant.change)(&mut params);
    params.ground_friction = scene.props[0].friction;
    params.glue.mode = GlueMode::Natural;
    params.physics.rolling_resistance = 0.0;
    params.release.order = ReleaseOrder::AtOnce;
    // A pile at rest is simulated all the same, and what moves is not slowed in the end.
    params.hold.least_seconds = problem.seconds;
    params.hold.patience = 1e5;
    params.hold.separate = Switch::Off;
    params.report.shape = Switch::Off;
    params.report.support = Switch::Off;
    params.output.fps = FPS;
    params.output.frames = Some(problem.frames());
    params
}

pub fn shapes(scene: &Scene, params: &Params) -> anyhow::Result<Vec<Shape>> {
    let checked = check::run(scene, params).map_err(|problems| anyhow::anyhow!("{problems:?}"))?;
    Ok(shape::run(scene, params, &checked.sizes, &mut Silent)?)
}

/// A motion, and the CPU seconds that it took.
pub struct Run {
    pub motion: Vec<Vec<Pose>>,
    pub cpu: f64,
}

pub fn run(problem: &Problem, case: usize, variant: &Variant) -> anyhow::Result<Run> {
    let scene = problem.scene(case);
    let params = params(problem, &scene, variant);
    // Centres of mass are the same by any accuracy.
    let shapes = shapes(&scene, &Params { physics: Params::new(Accuracy::Draft).physics, ..params.clone() })?;
    let bake = cairn_core::bake(&scene, &params, &mut Cpu)?;
    let centre =
        |(given, pose): (&cairn_input::scene::PlacedBody, &Pose)| shapes[given.prop].body_pose(pose, given.scale);
    let motion = bake.pile.frames.iter().map(|poses| scene.bodies.iter().zip(poses).map(centre).collect()).collect();
    Ok(Run { motion, cpu: simulation(&bake.report) })
}
