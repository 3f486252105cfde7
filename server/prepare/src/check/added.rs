//! Checks of all bodies besides the fill: placed bodies, emitters, moving scenery, and bodies that are taken away.

use super::{FieldChecks, Findings};
use cairn_geometry::TOLERANCE;
use cairn_input::params::{GlueMode, Params};
use cairn_input::scene::{Emitter, EmitterVolume, PlacedBody, RemovalChoice, Scene, StaticModel};
use glam::{DQuat, DVec3};

/// Bound of positions, m, as the schema states it.
const FARTHEST: f64 = 1e6;
/// Bound of velocities, m/s and rad/s, as the schema states it.
const FASTEST: f64 = 1e4;
/// Bound of times, s, as the schema states it.
const LATEST: f64 = 1e5;
/// Bound on the bodies placed and emitted, together.
const MOST_BODIES: u64 = 100_000;
/// Bound on the entries of a list of removals.
const MOST_REMOVALS: usize = 1000;

/// All problems of the three.
pub fn check(scene: &Scene, params: &Params, found: &mut Findings) {
    // A weight that is not a number is reported with its own field.
    let drawn = scene.props.iter().any(|p| p.weight != 0.0);
    if scene.is_filled(params) && !drawn && !scene.props.is_empty() {
        let names: Vec<&str> = scene.props.iter().map(|p| &*p.model.name).collect();
        let names = names.join(", ");
        found.problem(
            "props",
            format!("props: all have the weight 0 ({names}); give one to those that the fill is to use"),
        );
    }
    for (i, body) in scene.bodies.iter().enumerate() {
        given(&mut found.below(&format!("bodies.{i}"), ""), body, scene);
    }
    for (i, emitter) in scene.emitters.iter().enumerate() {
        self::emitter(&mut found.below(&format!("emitters.{i}"), ""), emitter, scene);
    }
    for (i, model) in scene.statics.iter().enumerate() {
        for k in 0..model.keys.len() {
            key(&mut found.below(&format!("statics.{i}.keyframes.{k}"), ""), model, k);
        }
    }
    removals(scene, params, found);
    collapse(scene, found);
    let count = scene.bodies.len() as u64 + scene.emitters.iter().map(|e| u64::from(e.count)).sum::<u64>();
    if count > MOST_BODIES {
        let text = format!("bodies, emitters: {count} bodies in all; place and emit at most {MOST_BODIES}");
        found.problem("emitters", text);
    }
}

fn removals(scene: &Scene, params: &Params, found: &mut Findings) {
    if scene.removals.len() > MOST_REMOVALS {
        let text = format!("remove: {} entries; give {MOST_REMOVALS} at most", scene.removals.len());
        found.problem("remove", text);
    }
    if !scene.removals.is_empty() && matches!(params.glue.mode, GlueMode::Tacky | GlueMode::AsModelled) {
        let text = "glue.mode: bodies are taken away from the pile, which then stands or falls by itself; leave \
                    glue.mode or remove out";
        found.problem("glue.mode", text);
    }
    for (i, removal) in scene.removals.iter().enumerate() {
        let checks = &mut found.below(&format!("remove.{i}"), "");
        checks.range("start", removal.start.unwrap_or(0.0), [0.0, LATEST]);
        match removal.choice {
            RemovalChoice::Named { number, .. } => checks.range("number", number as f64, [0.0, 1e6]),
            RemovalChoice::Safe { most } | RemovalChoice::Order { most } | RemovalChoice::Any { most } => {
                checks.range("count", most as f64, [1.0, MOST_BODIES as f64]);
            }
        }
    }
}

fn collapse(scene: &Scene, found: &mut Findings) {
    let Some(collapse) = &scene.collapse else { return };
    if !scene.removals.is_empty() {
        let text = "remove: bodies leave one after another, or the pile comes down (collapse); leave one of both out";
        found.problem("remove", text);
    }
    let checks = &mut found.below("collapse", "");
    checks.range("start", collapse.start.unwrap_or(0.0), [0.0, LATEST]);
    checks.range("number", collapse.number.unwrap_or(0) as f64, [0.0, 1e6]);
    checks.range("azimuth", collapse.azimuth, [-360.0, 360.0]);
    checks.range("duration", collapse.duration.unwrap_or(0.0), [0.0, 1000.0]);
    checks.range("speed", collapse.speed.unwrap_or(0.0), [0.0, 1000.0]);
}

impl FieldChecks<'_> {
    fn ranges(&mut self, name: &str, values: DVec3, bounds: [f64; 2]) {
        for (k, value) in values.to_array().into_iter().enumerate() {
            self.range(&format!("{name}.{k}"), value, bounds);
        }
    }

    fn rotation(&mut self, rotation: DQuat) {
        if rotation.is_nan() || rotation.length() < TOLERANCE {
            self.problem("rotation", "all four are 0; give a rotation, such as [0, 0, 0, 1] for none");
        }
    }
}

fn given(checks: &mut FieldChecks, body: &PlacedBody, scene: &Scene) {
    // Without any, that is the problem.
    if body.prop >= scene.props.len() && !scene.props.is_empty() {
        let last = scene.props.len() - 1;
        checks.problem("prop", &format!("there is no props.{}; the scene's last is props.{last}", body.prop));
    }
    checks.rotation(body.pose.rotation);
    checks.ranges("position", body.pose.translation, [-FARTHEST, FARTHEST]);
    checks.range("scale", body.scale, [1e-6, 1e6]);
    checks.ranges("velocity", body.velocity, [-FASTEST, FASTEST]);
    checks.ranges("angular_velocity", body.angular_velocity, [-FASTEST, FASTEST]);
    checks.range("mass", body.mass.unwrap_or(1.0), [1e-9, 1e12]);
    checks.range("start", body.start, [0.0, LATEST]);
    checks.range("kept_until", body.pinned_until.unwrap_or(0.0), [0.0, LATEST]);
    if body.pinned && body.moves() {
        checks.problem("kept", "a kept body cannot have a velocity; leave one of them out");
    }
    if !body.pinned && body.pinned_until.is_some() {
        checks.problem("kept_until", "the body is not kept; set kept = true");
    }
    if body.pinned_until.is_some_and(|until| until < body.start) {
        checks.problem("kept_until", "the body is released before it appears; give a later time");
    }
}

fn emitter(checks: &mut FieldChecks, emitter: &Emitter, scene: &Scene) {
    match &emitter.place {
        EmitterVolume::Box { center, size } => {
            checks.ranges("center", *center, [-FARTHEST, FARTHEST]);
            checks.ranges("size", *size, [1e-6, 1e6]);
        }
        EmitterVolume::Mesh(model) => {
            if model.mesh.triangles.is_empty() || !cairn_geometry::topology::inspect(&model.mesh).closed {
                let text = format!("{}: the emitter's mesh is not closed; fill its holes, or give a box", model.name);
                checks.findings.problem(format!("{}.mesh", checks.field), text);
            }
        }
    }
    checks.range("rate", emitter.rate, [1e-3, 1e6]);
    checks.range("count", f64::from(emitter.count), [1.0, 1e5]);
    checks.ranges("velocity", emitter.velocity, [-FASTEST, FASTEST]);
    checks.range("start", emitter.start, [0.0, LATEST]);
    if !scene.props.is_empty() && scene.emitted(emitter).next().is_none() {
        checks.problem("props", "none of them has a weight; name one that has");
    }
}

fn key(checks: &mut FieldChecks, model: &StaticModel, number: usize) {
    let key = &model.keys[number];
    checks.rotation(key.pose.rotation);
    checks.ranges("position", key.pose.translation, [-FARTHEST, FARTHEST]);
    checks.range("frame", key.time, [0.0, LATEST]);
    if number > 0 && key.time <= model.keys[number - 1].time {
        checks.problem("frame", "it is not after the key before it; put the keys in order");
    }
}

/// Share of each prop in the pile.
pub fn shares(scene: &Scene, params: &Params) -> Vec<f64> {
    let drawn = |i: usize| scene.is_filled(params) || scene.emitters.iter().any(|e| scene.emitted(e).any(|k| k == i));
    let mut shares: Vec<f64> =
        (0..scene.props.len()).map(|i| if drawn(i) { scene.props[i].weight } else { 0.0 }).collect();
    if shares.iter().all(|&s| s == 0.0) {
        let stacked = scene.bodies.iter().any(PlacedBody::is_stacked);
        for body in scene.bodies.iter().filter(|b| b.is_stacked() == stacked) {
            shares[body.prop] += 1.0;
        }
    }
    shares
}

/// A body that arrives with more than this, in m g d, scatters the pile instead of joining it: it has fallen from six
/// times its own size.
const MOST_ENERGY: f64 = 6.0;

/// Warnings about drops that bring more energy than a pile can hold (paper, section 5).
pub fn energy_warnings(scene: &Scene, params: &Params, ground: f64, diameter: f64) -> Vec<String> {
    let target = scene.target().map(|model| model.mesh.bounds());
    // A body first meets the pile at its top.
    let top = target.map_or(ground, |(_, hi)| hi.y);
    let floor = |from: f64| if from >= top { top } else { target.map_or(ground, |(lo, _)| lo.y).min(from) };
    let energy = |from: f64, velocity: DVec3| {
        velocity.length_squared() / 2.0 / (params.gravity * diameter) + (from - floor(from)).max(0.0) / diameter
    };
    let drops = scene.emitters.iter().enumerate().filter_map(|(i, emitter)| {
        let (lo, hi) = emitter.place.bounds();
        let energy = energy((lo.y + hi.y) / 2.0, emitter.velocity);
        (energy > MOST_ENERGY).then(|| {
            format!(
                "emitters.{i}: bodies arrive with {energy:.1} times the energy of a fall from their own size; above \
                 {MOST_ENERGY:.0} a pile is broken up as fast as it forms: emit lower, or slower"
            )
        })
    });
    let thrown =
        scene.bodies.iter().enumerate().filter(|(_, b)| !b.is_stacked() && !b.pinned).filter_map(|(i, body)| {
            let energy = energy(body.pose.translation.y, body.velocity);
            (energy > MOST_ENERGY).then(|| {
                format!(
                    "bodies.{i}: the body arrives with {energy:.1} times the energy of a fall from one prop's size; \
                     above {MOST_ENERGY:.0} the control does not keep the pile together where it hits: slow it down"
                )
            })
        });
    drops.chain(thrown).collect()
}
