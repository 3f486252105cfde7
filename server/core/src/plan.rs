//! What would be simulated, told before anything runs.

use crate::check::Checked;
use crate::fill;
use crate::observer::Stage;
use crate::params::{ControlMode, FillMethod, FrictionCone, Params};
use crate::scene::Scene;

/// The stages that a bake will run and the effects that are switched on, each with its reason.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Plan {
    /// Bodies expected, from the volumes and the packing that the fill usually reaches.
    pub expected_bodies: usize,
    /// Simulation steps expected over all stages.
    pub expected_steps: usize,
    /// Length unit d: the median prop diameter, m.
    pub prop_diameter: f64,
    /// Natural time sqrt(d / g), s.
    pub natural_time: f64,
    pub stages: Vec<Stage>,
    pub effects: Vec<Effect>,
    /// What the user should know before baking: open props, a control mesh below the ground, ...
    pub warnings: Vec<String>,
}

/// Something that costs time and may be left out.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Effect {
    pub name: &'static str,
    pub on: bool,
    /// One sentence.
    pub reason: String,
}

/// Steps that an `insert` fill usually takes.
const USUAL_FILL_STEPS: usize = 500;
/// Natural times from the last release to rest, usually.
const USUAL_HOLD: f64 = 8.0;

/// The plan of a checked scene.
pub fn of(scene: &Scene, params: &Params, checked: &Checked) -> Plan {
    let natural_time = (checked.diameter / params.gravity).sqrt();
    let height = {
        let (lo, hi) = scene.control.mesh.bounds();
        hi.y - lo.y.max(checked.ground)
    };
    let step = params.physics.step.seconds(natural_time);
    let layers = (height / checked.diameter / params.release.layer).ceil();
    let release = layers * params.release.interval.seconds(natural_time) / step;
    let hold = match params.output.frames {
        Some(n) => (f64::from(n) / params.output.fps / step - release).max(0.0),
        None => USUAL_HOLD * natural_time / step,
    };
    Plan {
        expected_bodies: fill::expected_bodies(scene, &checked.sizes, checked.volume, &params.fill),
        expected_steps: USUAL_FILL_STEPS + (release + hold) as usize,
        prop_diameter: checked.diameter,
        natural_time,
        stages: vec![Stage::Shape, Stage::Fill, Stage::Release, Stage::Hold, Stage::Measure],
        effects: effects(scene, params),
        warnings: checked.warnings.clone(),
    }
}

fn effects(scene: &Scene, params: &Params) -> Vec<Effect> {
    let control = &params.control;
    let on = control.mode != ControlMode::Off;
    let effect = |name, on, reason: &str| Effect { name, on, reason: reason.into() };
    let filling = match params.fill.method {
        FillMethod::Insert => "props grow at free places inside the closed container",
        FillMethod::Pour => "props are dropped through the container's opening",
    };
    let holding = match control.mode {
        ControlMode::Off => "switched off by the scene",
        ControlMode::Nails => "certified pairs are nailed together until the next verdict",
        ControlMode::Hold => "certified bodies are held until the next verdict",
    };
    let cone = match control.friction_cone {
        FrictionCone::Pyramid => "four-sided friction pyramid, as in the paper",
        FrictionCone::Cone => "exact friction cone",
    };
    let analysis = if on { cone } else { "nothing is controlled" };
    let scenery = format!("{} pieces of static geometry", scene.statics.len());
    let bouncy = scene.props.iter().any(|p| p.restitution > 0.0);
    vec![
        effect("fill", true, filling),
        effect("release", true, "layers are let go from the bottom to the top"),
        effect("control", on, holding),
        effect("analysis", on, analysis),
        effect("nails", control.mode == ControlMode::Nails, holding),
        effect("scenery", !scene.statics.is_empty(), &scenery),
        effect("restitution", bouncy, if bouncy { "a prop bounces" } else { "no prop bounces" }),
        effect("free_standing", params.output.free_standing, "only on request: it is a further simulation"),
        effect("free_pour", params.output.free_pour, "only on request: it is a further simulation"),
    ]
}
