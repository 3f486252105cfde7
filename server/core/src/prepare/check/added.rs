//! What is wrong with what a scene adds to the fill: placed bodies, emitters, moving scenery.

use crate::error::Problem;
use crate::input::params::Params;
use crate::input::scene::{Emitter, Place, PlacedBody, Scene, StaticModel};
use glam::DVec3;

/// Bounds of positions (m), of velocities (m/s and rad/s) and of times (s).
const FARTHEST: f64 = 1e6;
const FASTEST: f64 = 1e4;
const LATEST: f64 = 1e5;
/// A quaternion shorter than this has no direction.
const SHORTEST_ROTATION: f64 = 1e-9;
/// Bound on the bodies placed and emitted, together.
const MOST_BODIES: u64 = 100_000;

/// All problems of the three.
pub fn check(scene: &Scene, params: &Params, problems: &mut Vec<Problem>) {
    // What is no weight at all is told by its own field.
    let drawn = scene.props.iter().any(|p| p.weight != 0.0);
    if scene.is_filled(params) && !drawn && !scene.props.is_empty() {
        let names: Vec<&str> = scene.props.iter().map(|p| &*p.model.name).collect();
        let text =
            format!("props: all have the weight 0 ({}); give one to those that the fill shall draw", names.join(", "));
        problems.push(Problem::new("props", text));
    }
    for (i, body) in scene.bodies.iter().enumerate() {
        given(&format!("bodies.{i}"), body, scene, problems);
    }
    for (i, emitter) in scene.emitters.iter().enumerate() {
        self::emitter(&format!("emitters.{i}"), emitter, scene, problems);
    }
    for (i, model) in scene.statics.iter().enumerate() {
        keys(&format!("statics.{i}.keyframes"), model, problems);
    }
    let count = scene.bodies.len() as u64 + scene.emitters.iter().map(|e| u64::from(e.count)).sum::<u64>();
    if count > MOST_BODIES {
        let text = format!("bodies, emitters: {count} bodies in all; place and emit at most {MOST_BODIES}");
        problems.push(Problem::new("emitters", text));
    }
}

/// Tells values that are out of range.
struct Ranges<'a> {
    field: &'a str,
    problems: &'a mut Vec<Problem>,
}

impl Ranges<'_> {
    fn hold(&mut self, name: &str, value: f64, [lo, hi]: [f64; 2]) {
        if !(lo..=hi).contains(&value) {
            let field = format!("{}.{name}", self.field);
            let text = format!("{field}: {value} is out of range; give a value from {lo} to {hi}");
            self.problems.push(Problem::new(field, text));
        }
    }

    fn hold_all(&mut self, name: &str, values: DVec3, bounds: [f64; 2]) {
        for (k, value) in values.to_array().into_iter().enumerate() {
            self.hold(&format!("{name}.{k}"), value, bounds);
        }
    }
}

fn rotation(field: &str, rotation: glam::DQuat, problems: &mut Vec<Problem>) {
    if rotation.is_nan() || rotation.length() < SHORTEST_ROTATION {
        let text = format!("{field}: all four are 0; give a rotation, such as [0, 0, 0, 1] for none");
        problems.push(Problem::new(field, text));
    }
}

fn given(field: &str, body: &PlacedBody, scene: &Scene, problems: &mut Vec<Problem>) {
    if body.prop >= scene.props.len() {
        let text = format!("{field}.prop: there is no prop {}; the scene has {}", body.prop, scene.props.len());
        problems.push(Problem::new(format!("{field}.prop"), text));
    }
    rotation(&format!("{field}.rotation"), body.pose.rotation, problems);
    let mut ranges = Ranges { field, problems };
    ranges.hold_all("position", body.pose.translation, [-FARTHEST, FARTHEST]);
    ranges.hold("scale", body.scale, [1e-6, 1e6]);
    ranges.hold_all("velocity", body.velocity, [-FASTEST, FASTEST]);
    ranges.hold_all("angular_velocity", body.angular_velocity, [-FASTEST, FASTEST]);
    ranges.hold("mass", body.mass.unwrap_or(1.0), [1e-9, 1e12]);
    ranges.hold("start", body.start, [0.0, LATEST]);
    ranges.hold("kept_until", body.pinned_until.unwrap_or(0.0), [0.0, LATEST]);
    let mut tell = |name: &str, what: &str| {
        let field = format!("{field}.{name}");
        problems.push(Problem::new(field.clone(), format!("{field}: {what}")));
    };
    if body.pinned && body.moves() {
        tell("kept", "a body that stays where it is cannot have a velocity; leave one of them out");
    }
    if !body.pinned && body.pinned_until.is_some() {
        tell("kept_until", "the body is not kept; set kept = true");
    }
    if body.pinned_until.is_some_and(|until| until < body.start) {
        tell("kept_until", "it is let go before it appears; give a later moment");
    }
}

fn emitter(field: &str, emitter: &Emitter, scene: &Scene, problems: &mut Vec<Problem>) {
    let mut ranges = Ranges { field, problems };
    match &emitter.place {
        Place::Box { center, size } => {
            ranges.hold_all("center", *center, [-FARTHEST, FARTHEST]);
            ranges.hold_all("size", *size, [1e-6, 1e6]);
        }
        Place::Mesh(model) => {
            if model.mesh.triangles.is_empty() || !crate::geometry::topology::inspect(&model.mesh).closed {
                let text = format!("{}: the emitter's mesh is not closed; fill its holes, or give a box", model.name);
                problems.push(Problem::new(format!("{field}.mesh"), text));
            }
        }
    }
    let mut ranges = Ranges { field, problems };
    ranges.hold("rate", emitter.rate, [1e-3, 1e6]);
    ranges.hold("count", f64::from(emitter.count), [1.0, 1e5]);
    ranges.hold_all("velocity", emitter.velocity, [-FASTEST, FASTEST]);
    ranges.hold("start", emitter.start, [0.0, LATEST]);
    if !scene.props.is_empty() && scene.emitted(emitter).next().is_none() {
        let text = format!("{field}.props: none of them has a weight; name one that has");
        problems.push(Problem::new(format!("{field}.props"), text));
    }
}

fn keys(field: &str, model: &StaticModel, problems: &mut Vec<Problem>) {
    for (k, key) in model.keys.iter().enumerate() {
        let field = format!("{field}.{k}");
        rotation(&format!("{field}.rotation"), key.pose.rotation, problems);
        let mut ranges = Ranges { field: &field, problems };
        ranges.hold_all("position", key.pose.translation, [-FARTHEST, FARTHEST]);
        ranges.hold("frame", key.time, [0.0, LATEST]);
        if k > 0 && key.time <= model.keys[k - 1].time {
            let text = format!("{field}.frame: it is not after the key before it; put the keys in order");
            problems.push(Problem::new(format!("{field}.frame"), text));
        }
    }
}

/// How common each prop is in the pile.
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

/// A body that arrives with more than this, in m g d, throws those that lie there about instead of joining them: it
/// has fallen from six times its own size.
const MOST_ENERGY: f64 = 6.0;

/// Where a drop brings more energy than a pile can hold (paper, section 5).
pub fn energy_warnings(scene: &Scene, params: &Params, ground: f64, diameter: f64) -> Vec<String> {
    let target = scene.target().map(|model| model.mesh.bounds());
    // Where it first meets the pile: the top of what is there.
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
                    "bodies.{i}: it arrives with {energy:.1} times the energy of a fall from one prop's size; above \
                 {MOST_ENERGY:.0} the control does not keep what it hits together"
                )
            })
        });
    drops.chain(thrown).collect()
}
