//! What would be simulated, told before anything runs.

use crate::check::{Checked, fills};
use crate::extremes;
use crate::fill;
use crate::observer::Stage;
use crate::params::{ControlMode, FillMethod, FrictionCone, Params, ReleaseOrder};
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
    let filled = checked.control.as_ref().filter(|_| fills(scene, params));
    let fill_bodies = filled.map_or(0, |c| fill::expected_bodies(scene, &checked.sizes, c.volume(), &params.fill));
    let emitted: usize = scene.emitters.iter().map(|e| e.count as usize).sum();
    let fill_stage = filled.map(|_| Stage::Fill);
    Plan {
        expected_bodies: fill_bodies + scene.bodies.len() + emitted,
        expected_steps: filled.map_or(0, |_| USUAL_FILL_STEPS) + release_steps(scene, params, checked) as usize,
        prop_diameter: checked.diameter,
        natural_time,
        stages: [Some(Stage::Shape), fill_stage, Some(Stage::Release), Some(Stage::Hold), Some(Stage::Measure)]
            .into_iter()
            .flatten()
            .collect(),
        effects: [effects(scene, params), physics_effects(scene, params, checked)].concat(),
        warnings: checked.warnings.clone(),
    }
}

/// Steps of release and hold, as far as they can be foretold.
pub(crate) fn release_steps(scene: &Scene, params: &Params, checked: &Checked) -> f64 {
    let natural_time = (checked.diameter / params.gravity).sqrt();
    let filled = checked.control.as_ref().filter(|_| fills(scene, params));
    let height = filled.map_or(0.0, |control| {
        let (lo, hi) = control.mesh.bounds();
        hi.y - lo.y.max(checked.ground)
    });
    let step = params.physics.step.seconds(natural_time);
    let layers = (height / checked.diameter / params.release.layer).ceil();
    let release = layers * params.release.interval.seconds(natural_time) / step;
    let hold = match params.output.frames {
        Some(n) => (f64::from(n) / params.output.fps / step - release).max(0.0),
        None => {
            (USUAL_HOLD * natural_time).max(params.hold.least) / step
                + (last_event(scene, params) / step - release).max(0.0)
        }
    };
    release + hold
}

/// When the last drop, throw, move or end of the control is due, s after frame 0.
fn last_event(scene: &Scene, params: &Params) -> f64 {
    let bodies = scene.bodies.iter().flat_map(|b| [Some(b.start), b.kept_until]);
    let emitters = scene.emitters.iter().map(|e| Some(e.start + f64::from(e.count - 1) / e.rate));
    let moves = scene.statics.iter().map(|m| m.keys.last().map(|k| k.time));
    bodies.chain(emitters).chain(moves).chain([params.control.until]).flatten().fold(0.0, f64::max)
}

/// What the props' own shapes and masses ask of the engine.
fn physics_effects(scene: &Scene, params: &Params, checked: &Checked) -> Vec<Effect> {
    let round: Vec<&str> = scene
        .props
        .iter()
        .zip(&checked.sizes)
        .filter(|(_, size)| size.round.is_some())
        .map(|(prop, _)| &*prop.model.name)
        .collect();
    let resistance = params.physics.rolling_resistance;
    let rolling = match round.as_slice() {
        [] => "no prop is round".into(),
        _ if resistance == 0.0 => "switched off by the scene".into(),
        names => format!("round: {}; rolling resistance {resistance}", names.join(", ")),
    };
    let mass = |i: usize| checked.sizes[i].volume * scene.props[i].density;
    let ratio = extremes::mass_ratio(scene, params, mass);
    let physics =
        extremes::stiffened(&params.physics, ratio, f64::INFINITY, (checked.diameter / params.gravity).sqrt());
    let is_stiff = physics != params.physics;
    let stiff = match is_stiff {
        true => format!(
            "masses differ by {ratio:.0}:1: contact frequency {:.0}, {} substeps",
            physics.contact_frequency, physics.substeps
        ),
        false => format!("masses differ by {ratio:.0}:1, which the contacts carry as they are"),
    };
    vec![
        Effect { name: "rolling_resistance", on: !round.is_empty() && resistance > 0.0, reason: rolling },
        Effect { name: "stiff_contacts", on: is_stiff, reason: stiff },
    ]
}

fn effects(scene: &Scene, params: &Params) -> Vec<Effect> {
    let control = &params.control;
    let on = control.mode != ControlMode::Off;
    let effect = |name, on, reason: &str| Effect { name, on, reason: reason.into() };
    let filling = match params.fill.method {
        FillMethod::Insert => "props grow at free places inside the closed container",
        FillMethod::Pour => "props are dropped through the container's opening",
        FillMethod::Off => "switched off by the scene",
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
    let fill = fills(scene, params);
    let filling = if scene.control.is_none() { "there is no control mesh" } else { filling };
    let releasing = match params.release.order {
        ReleaseOrder::BottomUp => "layers are let go from the bottom to the top",
        ReleaseOrder::TopDown => "layers are let go from the top to the bottom",
        ReleaseOrder::AtOnce => "everything is let go at frame 0",
    };
    let moving = scene.statics.iter().filter(|m| !m.keys.is_empty()).count();
    let scenery = format!("{} pieces of geometry besides the ground, {moving} of them moving", scene.statics.len());
    let placed = format!("{} bodies are placed by hand", scene.bodies.len());
    let emission = format!("{} emitters let bodies appear", scene.emitters.len());
    let bouncy = scene.props.iter().any(|p| p.restitution > 0.0);
    vec![
        effect("fill", fill, filling),
        effect("release", true, releasing),
        effect("control", on, holding),
        effect("analysis", on, analysis),
        effect("nails", control.mode == ControlMode::Nails, holding),
        effect("scenery", !scene.statics.is_empty(), &scenery),
        effect("bodies", !scene.bodies.is_empty(), &placed),
        effect("emitters", !scene.emitters.is_empty(), &emission),
        effect("stand", on && control.stand, "the control ends gently only where `control.stand` asks for it"),
        effect("restitution", bouncy, if bouncy { "a prop bounces" } else { "no prop bounces" }),
        effect("free_standing", params.output.free_standing, "only on request: it is a further simulation"),
        effect("free_pour", params.output.free_pour, "only on request: it is a further simulation"),
    ]
}
