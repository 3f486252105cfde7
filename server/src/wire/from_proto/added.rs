//! What a scene adds to the fill: placed bodies, emitters, moving scenery. Also their values that are not set.

use crate::problem::{Problem, nearest};
use crate::wire::proto;
use cairn_core::geometry::pose::Pose;
use cairn_core::input::scene::{Emitter, Key, Place, PlacedBody};
use glam::{DQuat, DVec3};

const EMITTER_SIZE: f64 = 1.0;
const EMITTER_RATE: f64 = 10.0;
const EMITTER_COUNT: i32 = 100;
const SCALE: f64 = 1.0;
const NO_ROTATION: [f64; 4] = [0.0, 0.0, 0.0, 1.0];
/// The last frame that can be named.
pub const LAST_FRAME: f64 = 100_000.0;

/// Reads these messages and gathers what is wrong with them.
pub struct Added<'a> {
    /// What bodies call each prop.
    names: Vec<&'a str>,
    fps: f64,
    pub problems: Vec<Problem>,
}

/// What bodies call a prop: its node, or its file without folder and ending.
fn prop_name(path: &str) -> &str {
    let (file, node) = crate::files::split_node(path);
    node.unwrap_or_else(|| {
        let name = file.rsplit(['/', '\\']).next().unwrap_or(file);
        name.rsplit_once('.').map_or(name, |(stem, _)| stem)
    })
}

impl<'a> Added<'a> {
    pub fn new(scene: &'a proto::Scene, fps: f64) -> Added<'a> {
        Added { names: scene.props.iter().map(|prop| prop_name(&prop.path)).collect(), fps, problems: Vec::new() }
    }

    fn tell(&mut self, field: &str, what: String, remedy: impl Into<String>) {
        self.problems.push(Problem::new(field, what, remedy).of_field(field));
    }

    pub fn body(&mut self, index: usize, body: &proto::Body) -> PlacedBody {
        use proto::body::{KeptUntil, Start};
        let field = |name: &str| format!("bodies.{index}.{name}");
        let start = match body.start {
            None => 0.0,
            Some(Start::StartFrame(frame)) => self.frame(&field("start_frame"), f64::from(frame)),
            Some(Start::StartSeconds(seconds)) => seconds,
        };
        let kept_until = body.kept_until.map(|until| match until {
            KeptUntil::KeptUntilFrame(frame) => self.frame(&field("kept_until_frame"), f64::from(frame)),
            KeptUntil::KeptUntilSeconds(seconds) => seconds,
        });
        PlacedBody {
            prop: self.prop(&field("prop"), &body.prop),
            pose: self.pose(&field(""), &body.position, &body.rotation),
            scale: body.scale.unwrap_or(SCALE),
            velocity: self.vector(&field("velocity"), &body.velocity, 0.0),
            angular_velocity: self.vector(&field("angular_velocity"), &body.angular_velocity, 0.0),
            mass: body.mass,
            start,
            pinned: body.kept.unwrap_or(false),
            pinned_until: kept_until,
        }
    }

    /// `mesh`: what reads the emitter's mesh, where it has one.
    pub fn emitter(&mut self, index: usize, emitter: &proto::Emitter, mesh: Option<Place>) -> Emitter {
        use proto::emitter::Start;
        let field = |name: &str| format!("emitters.{index}.{name}");
        let place = mesh.unwrap_or_else(|| Place::Box {
            center: self.vector(&field("center"), &emitter.center, 0.0),
            size: self.vector(&field("size"), &emitter.size, EMITTER_SIZE),
        });
        let props = (0..).zip(&emitter.props).map(|(i, name)| self.prop(&field(&format!("props.{i}")), name)).collect();
        let count = emitter.count.unwrap_or(EMITTER_COUNT);
        let start = match emitter.start {
            None => 0.0,
            Some(Start::StartFrame(frame)) => self.frame(&field("start_frame"), f64::from(frame)),
            Some(Start::StartSeconds(seconds)) => seconds,
        };
        Emitter {
            place,
            props,
            rate: emitter.rate.unwrap_or(EMITTER_RATE),
            count: u32::try_from(count).unwrap_or(0),
            velocity: self.vector(&field("velocity"), &emitter.velocity, 0.0),
            start,
        }
    }

    pub fn keys(&mut self, index: usize, model: &proto::StaticModel) -> Vec<Key> {
        let key = |(k, key): (usize, &proto::Keyframe)| {
            let field = format!("statics.{index}.keyframes.{k}.");
            let time = self.frame(&format!("{field}frame"), key.frame.unwrap_or(0.0));
            Key { time, pose: self.pose(&field, &key.position, &key.rotation) }
        };
        model.keyframes.iter().enumerate().map(key).collect()
    }

    /// The time of a frame, s.
    fn frame(&mut self, field: &str, frame: f64) -> f64 {
        if !(0.0..=LAST_FRAME).contains(&frame) {
            self.tell(field, format!("{frame} is out of range"), format!("Give 0 to {LAST_FRAME}."));
            return 0.0;
        }
        frame / self.fps
    }

    fn prop(&mut self, field: &str, name: &str) -> usize {
        let named: Vec<usize> = (0..self.names.len()).filter(|&i| self.names[i] == name).collect();
        match (&named[..], name.parse::<usize>()) {
            (&[one], _) => return one,
            ([], Ok(number)) if number < self.names.len() => return number,
            ([], _) => {
                let meant = nearest(name, self.names.iter().copied()).map(|meant| format!("Did you mean `{meant}`?"));
                let known = || format!("Known: {}.", self.names.join(", "));
                let remedy = meant.unwrap_or_else(known);
                self.tell(field, format!("no prop is called `{name}`"), remedy);
            }
            (several, _) => {
                let what = format!("{} props are called `{name}`", several.len());
                self.tell(field, what, format!("Give its number in props instead: {several:?}."));
            }
        }
        0
    }

    fn vector(&mut self, field: &str, given: &[f64], default: f64) -> DVec3 {
        match *given {
            [] => DVec3::splat(default),
            [x, y, z] => DVec3::new(x, y, z),
            _ => {
                self.tell(field, format!("{} numbers are given", given.len()), "Give three: x, y, z.");
                DVec3::splat(default)
            }
        }
    }

    fn pose(&mut self, prefix: &str, position: &[f64], rotation: &[f64]) -> Pose {
        let rotation = match *rotation {
            [] => DQuat::IDENTITY,
            [x, y, z, w] => self.rotation(&format!("{prefix}rotation"), DQuat::from_xyzw(x, y, z, w)),
            _ => {
                let what = format!("{} numbers are given", rotation.len());
                self.tell(&format!("{prefix}rotation"), what, "Give four: x, y, z, w.");
                DQuat::IDENTITY
            }
        };
        Pose { translation: self.vector(&format!("{prefix}position"), position, 0.0), rotation }
    }

    /// Made unit length; what cannot be is left to the core to tell.
    fn rotation(&mut self, field: &str, given: DQuat) -> DQuat {
        if given.to_array().into_iter().any(|part| !(-1.0..=1.0).contains(&part)) {
            self.tell(field, format!("{:?} is out of range", given.to_array()), "Give each from -1 to 1.");
            return DQuat::IDENTITY;
        }
        if given.length() > 0.0 { given.normalize() } else { given }
    }
}

/// A body with every value set.
pub fn effective_body(body: &proto::Body) -> proto::Body {
    proto::Body {
        position: or_default(&body.position, &[0.0; 3]),
        rotation: or_default(&body.rotation, &NO_ROTATION),
        scale: body.scale.or(Some(SCALE)),
        velocity: or_default(&body.velocity, &[0.0; 3]),
        angular_velocity: or_default(&body.angular_velocity, &[0.0; 3]),
        kept: body.kept.or(Some(false)),
        ..body.clone()
    }
}

/// An emitter with every value set.
pub fn effective_emitter(emitter: &proto::Emitter) -> proto::Emitter {
    proto::Emitter {
        center: or_default(&emitter.center, &[0.0; 3]),
        size: or_default(&emitter.size, &[EMITTER_SIZE; 3]),
        rate: emitter.rate.or(Some(EMITTER_RATE)),
        count: emitter.count.or(Some(EMITTER_COUNT)),
        velocity: or_default(&emitter.velocity, &[0.0; 3]),
        ..emitter.clone()
    }
}

/// A key with every value set.
pub fn effective_key(key: &proto::Keyframe) -> proto::Keyframe {
    proto::Keyframe {
        frame: key.frame.or(Some(0.0)),
        position: or_default(&key.position, &[0.0; 3]),
        rotation: or_default(&key.rotation, &NO_ROTATION),
    }
}

fn or_default(given: &[f64], default: &[f64]) -> Vec<f64> {
    if given.is_empty() { default.to_vec() } else { given.to_vec() }
}
