//! The plan of a bake: its stages, effects and warnings, before anything runs.

use crate::check::CheckedScene;
use crate::effects::{Effect, EffectName, Resolved};
use crate::packing::{self, BodyRange, Room, expected_bodies};
use crate::thin::Thin;
use cairn_geometry::ClosedMesh;
use cairn_geometry::thickness::Part;
use cairn_input::observer::Stage;
use cairn_input::params::{Accuracy, EntranceKind, Params};
use cairn_input::scene::Scene;

/// The stages that a bake will run and the effects that are switched on, each with its reason.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Plan {
    /// Bodies expected, from the volumes and the packing that the fill usually reaches.
    pub expected_bodies: usize,
    /// Nine of ten bakes have as many, from and to.
    #[serde(default)]
    pub body_range: [usize; 2],
    /// Simulation steps expected over all stages.
    pub expected_steps: usize,
    /// Frames that the result has at most, unless the pile rests after more than twice the expected time.
    #[serde(skip)]
    pub most_frames: usize,
    /// Length unit d: the median prop diameter, m.
    pub prop_diameter: f64,
    /// Characteristic time sqrt(d / g), s.
    #[serde(rename = "natural_time")]
    pub characteristic_time: f64,
    pub stages: Vec<Stage>,
    pub effects: Vec<Effect>,
    /// Parts of the control mesh that are too thin for the props: they stay empty.
    #[serde(default)]
    pub thin_parts: Vec<Part>,
    /// Times their size at which the props fill these parts and match the shape, as far as 3,000 bodies can.
    #[serde(default)]
    pub fitting_scale: Option<f64>,
    /// `shape_iou` that is expected when the shape is filled.
    #[serde(default)]
    pub expected_match: Option<f64>,
    /// Sentences for a person: open props, a control mesh below the ground, ...
    pub warnings: Vec<String>,
}

/// Steps that an `insert` fill usually takes.
const USUAL_FILL_STEPS: usize = 150;
/// Characteristic times from the last release to rest, usually.
const USUAL_HOLD: f64 = 8.0;

/// The plan of a checked scene.
pub fn of(scene: &Scene, params: &Params, checked: &CheckedScene, resolved: &Resolved) -> Plan {
    let filled = checked.filled(scene, params);
    let fill_bodies = filled_bodies(scene, params, checked);
    let fill_stage = filled.map(|_| Stage::Fill);
    let glue_stage = resolved.is_on(EffectName::Glue).then_some(Stage::Glue);
    let stages =
        [Some(Stage::Shape), fill_stage, glue_stage, Some(Stage::Release), Some(Stage::Hold), Some(Stage::Measure)];
    let most = params.fill.max_bodies;
    let limited = (fill_bodies == most as usize && params.fill.count.is_none()).then(|| {
        format!(
            "more bodies would fit than fill.max_bodies = {most}: the control mesh will not be full; raise it, or use \
             larger props"
        )
    });
    let range = body_range(scene, params, checked);
    let mixed = range.mixed.map(|ratio| {
        format!(
            "props differ in size by a factor of {ratio:.0}: how many small ones fill the gaps is not known before: \
             between {} and {} bodies are expected; fill.count sets how many",
            range.low, range.high
        )
    });
    let thin = Thin::new(scene, params, checked, fill_bodies, fullness(params));
    let steps = release_steps(scene, params, checked);
    Plan {
        most_frames: most_frames(steps * params.physics.step.seconds(checked.characteristic_time(params)), params),
        expected_bodies: fill_bodies + scene.added_bodies(),
        body_range: [range.low, range.high],
        expected_steps: filled.map_or(0, |_| USUAL_FILL_STEPS).saturating_add(steps as usize),
        prop_diameter: checked.diameter,
        characteristic_time: checked.characteristic_time(params),
        stages: stages.into_iter().flatten().collect(),
        effects: resolved.effects.clone(),
        warnings: checked.warnings.iter().cloned().chain(limited).chain(mixed).chain(thin.warning(scene)).collect(),
        thin_parts: thin.parts,
        fitting_scale: thin.fitting_scale,
        expected_match: thin.expected_match,
    }
}

/// Frames of a release and hold that are expected to take this long, s.
fn most_frames(seconds: f64, params: &Params) -> usize {
    /// Nearly all piles rest, and nearly all entrances end, within this many times the expected time.
    const LATE: f64 = 2.0;
    let entrance = &params.entrance;
    let is_shown = entrance.kind != EntranceKind::None;
    let seconds = seconds + if is_shown { entrance.start + entrance.duration } else { 0.0 };
    let most = (LATE * seconds * params.output.fps).ceil() as usize;
    params.output.frames.map_or(most, |frames| frames as usize).saturating_add(1)
}

/// Share of the bodies that is missing for each unit of `fill.full_below` beyond that of the fills that the packing was
/// fitted on, its default: mean of seven pairs of props and shapes, at `draft` and at `preview`.
const MISSING: f64 = 0.43;

/// Bodies that the fill will place: fewer where `fill.full_below` ends it sooner.
pub fn filled_bodies(scene: &Scene, params: &Params, checked: &CheckedScene) -> usize {
    if !checked.piles.is_empty() {
        let pile = |(i, checked)| filled_bodies(&scene.of_pile(i), params, checked);
        let all: usize = checked.piles.iter().enumerate().map(pile).sum();
        return all.min(params.fill.max_bodies as usize);
    }
    let filled = checked.filled(scene, params);
    let full = fullness(params);
    filled.map_or(0, |control| expected_bodies(scene, &checked.sizes, &room(control, checked), &params.fill, full))
}

/// Share of the bodies that a fill ends with.
fn fullness(params: &Params) -> f64 {
    let usual = Params::new(Accuracy::Standard).fill.full_below;
    1.0 - MISSING * (params.fill.full_below - usual).max(0.0)
}

/// The range around [`filled_bodies`], those that are added besides included.
pub fn body_range(scene: &Scene, params: &Params, checked: &CheckedScene) -> BodyRange {
    fn of_fill(scene: &Scene, params: &Params, checked: &CheckedScene) -> BodyRange {
        let none = BodyRange { low: 0, high: 0, mixed: None };
        if !checked.piles.is_empty() {
            let pile = |(i, checked)| of_fill(&scene.of_pile(i), params, checked);
            let most = params.fill.max_bodies as usize;
            return checked.piles.iter().enumerate().map(pile).fold(none, |all, own| BodyRange {
                low: (all.low + own.low).min(most),
                high: (all.high + own.high).min(most),
                mixed: all.mixed.or(own.mixed),
            });
        }
        let range = |control| {
            let room = room(control, checked);
            packing::body_range(scene, &checked.sizes, &room, &params.fill, fullness(params))
        };
        checked.filled(scene, params).map_or(none, range)
    }
    let BodyRange { low, high, mixed } = of_fill(scene, params, checked);
    let added = scene.added_bodies();
    BodyRange { low: low + added, high: high + added, mixed }
}

/// The room that is to be filled.
pub fn room(control: &ClosedMesh, checked: &CheckedScene) -> Room {
    let (volume, area) = checked.core.as_ref().map_or((0.0, 0.0), |core| (core.volume, core.area));
    let (left, bounded) = checked.room_shares();
    Room { volume: left * (control.volume - volume), area: bounded * (control.topology.area + area) }
}

/// Steps of release and hold, as far as they can be predicted.
pub fn release_steps(scene: &Scene, params: &Params, checked: &CheckedScene) -> f64 {
    let characteristic_time = checked.characteristic_time(params);
    let filled = checked.filled(scene, params);
    let height = filled.map_or(0.0, |control| {
        let (lo, hi) = control.mesh.bounds();
        hi.y - lo.y.max(checked.ground)
    });
    let step = params.physics.step.seconds(characteristic_time);
    let layers = (height / checked.diameter / params.release.layer).ceil();
    let release = layers * params.release.interval.seconds(characteristic_time) / step;
    let hold = match params.output.frames {
        Some(n) => (f64::from(n) / params.output.fps / step - release).max(0.0),
        None => {
            (USUAL_HOLD * characteristic_time).max(params.hold.least_seconds) / step
                + (last_event(scene, params) / step - release).max(0.0)
        }
    };
    release + hold
}

/// When the last drop, throw, move or end of the control is due, s after frame 0.
fn last_event(scene: &Scene, params: &Params) -> f64 {
    let bodies = scene.bodies.iter().flat_map(|b| [Some(b.start), b.pinned_until]);
    let emitters = scene.emitters.iter().map(|e| Some(e.start + f64::from(e.count - 1) / e.rate));
    let moves = scene.statics.iter().map(|m| m.keys.last().map(|k| k.time));
    bodies.chain(emitters).chain(moves).chain([params.control.until]).flatten().fold(0.0, f64::max)
}
