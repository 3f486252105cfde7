//! Figures of motion and control, and the limits of the accuracy.

use super::inputs::{NamedFigures, ReportInputs};
use crate::glue::policy::MOVED;
use cairn_engine::world::World;
use cairn_geometry::measure;
use cairn_geometry::pose::Pose;
use cairn_input::params::ControlMode;
use cairn_input::scene::PlacedBody;
use cairn_motion::pile::Pile;
use cairn_motion::step::Simulation;
use std::collections::BTreeMap;

/// Figures of the motion.
pub fn figures(inputs: &ReportInputs, pile: &Pile) -> NamedFigures {
    let units = pile.world.units;
    let count = pile.instances.len() as f64;
    // In engine units m g d is the mass.
    let weight: f64 = pile.world.present().map(|id| pile.world.bodies()[id].mass).sum();
    let frames = &pile.recorder.frames;
    let last = frames.len() - 1;
    let hold_end = pile.recorder.disturbed_frame.unwrap_or(last).min(last);
    let from = pile.recorder.hold_frame.min(hold_end);
    let displacements = |from: usize, to: usize| -> Vec<f64> {
        frames[from].iter().zip(&frames[to]).map(|(a, b)| a.translation.distance(b.translation)).collect()
    };
    let mut figures = BTreeMap::from([
        ("drift_p95_rel", Some(measure::percentile(&displacements(from, hold_end), 0.95))),
        ("moving", Some(inputs.held.moving as f64)),
        ("resting_speed_max", Some(inputs.held.resting_speed_max * units.length / units.time)),
        ("resting_speed_max_rel", Some(inputs.held.resting_speed_max)),
        ("kinetic_energy_rel", Some(pile.world.kinetic_energy() / weight.max(f64::MIN_POSITIVE))),
        ("active_body_share", Some(pile.counters.active_body_steps as f64 / count / pile.step.max(1) as f64)),
    ]);
    let motion = &pile.motion;
    figures.insert("ballistic_error_max", Some(motion.ballistic_error));
    figures.insert("second_collapse", Some(motion.second_collapse as f64));
    figures.insert("hanging_frames", Some(motion.hanging.body_frames as f64));
    // Bodies that come in or leave, and scenery that moves, change the energy.
    let is_closed =
        !inputs.scene.something_hits() && inputs.scene.removals.is_empty() && inputs.scene.collapse.is_none();
    figures.insert("energy_growth_rel", is_closed.then(|| motion.energy_growth(&pile.world)));
    if let Some(rest) = inputs.held.rest {
        let seconds = rest.steps as f64 * pile.world.step_length() * units.time;
        figures.insert("rest_seconds", Some(seconds));
        // Without frames, the poses of that time are lost.
        let from = pile.recorder.keeps().then_some(rest.frame.min(last));
        let creep = from.map(|from| displacements(from, last).into_iter().fold(0.0, f64::max));
        figures.insert("creep_max_rel", creep);
    }
    if inputs.scene.bodies.iter().any(PlacedBody::is_stacked) || pile.recorder.disturbed_frame.is_some() {
        let stack = inputs.placed(0);
        let point = |(prop, scale, pose): &(usize, f64, Pose)| {
            let points = &inputs.scene.props[*prop].model.mesh.points;
            points.iter().map(|p| pose.transform_point(*p * *scale).y).fold(f64::NEG_INFINITY, f64::max)
        };
        let top = stack.iter().map(point).fold(f64::NEG_INFINITY, f64::max);
        let height = (top - inputs.ground) / units.length;
        let drift = displacements(0, hold_end).into_iter().fold(0.0, f64::max);
        figures.insert("stack_drift_rel", (height > 0.0).then(|| drift / height));
        // In d.
        let fallen = frames[0].iter().zip(&frames[last]).filter(|(a, b)| a.translation.y - b.translation.y > MOVED);
        figures.insert("fallen_fraction", Some(fallen.count() as f64 / frames[0].len().max(1) as f64));
    }
    figures
}

/// Figures of the control: nails, loads, CPU time.
pub fn control(sim: &Simulation) -> NamedFigures {
    let tally = sim.pile.control.counters();
    let ratio = |a: f64, b: f64| (b > 0.0).then_some(a / b);
    BTreeMap::from([
        ("nails_peak", Some(tally.nails_peak as f64)),
        ("nails_end", Some(sim.pile.world.nail_count() as f64)),
        ("nails_broken", Some(tally.nails_broken as f64)),
        ("nail_load_max", Some(tally.nail_load_max)),
        ("control_overhead", ratio(sim.seconds.control(), sim.seconds.engine())),
        ("analysis_us_per_body", ratio(sim.seconds.control() * 1e6, tally.analyses as f64)),
    ])
}

/// Lengths by which a pile may differ from the true one, in d, by the parameter that lessens each: the distance of the
/// collision shapes from the meshes, the depth of contacts, the gap across which bodies may be held, and the fall of a
/// body within a step.
pub fn error_sources(inputs: &ReportInputs, world: &World, measures: &NamedFigures) -> BTreeMap<&'static str, f64> {
    let mut thickness: Vec<f64> = world.present().map(|id| world.bodies()[id].thickness).collect();
    thickness.sort_by(f64::total_cmp);
    let thickness = thickness.get(thickness.len() / 2).copied().unwrap_or(0.0);
    let used = inputs.shapes.iter().enumerate().filter(|(i, _)| inputs.pile.bodies.iter().any(|b| b.prop == *i));
    let deviation = used.map(|(_, shape)| shape.report.deviation_rel).fold(0.0, f64::max);
    let sunk = measures.get("penetration_mean_rel").copied().flatten().unwrap_or(0.0);
    let control = &inputs.params.control;
    let gap = if control.mode == ControlMode::Off { 0.0 } else { control.contact_tolerance };
    BTreeMap::from([
        ("physics.shape_tolerance", deviation),
        ("physics.contact_frequency", sunk * thickness),
        (inputs.params.physics.step.step_field(), world.step_length().powi(2) / 2.0),
        ("control.contact_tolerance", gap * thickness),
    ])
}
