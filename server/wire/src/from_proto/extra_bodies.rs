//! Converts placed bodies, emitters, removals, a fall, several shapes and moving scenery from the wire. Defaults are
//! already filled in.

use crate::proto;
use cairn_files::problem::{Problem, nearest};
use cairn_geometry::pose::Pose;
use cairn_input::scene::{
    CollapseRequest, Emitter, EmitterVolume, Keyframe, PlacedBody, RemovalChoice, RemovalRequest,
};
use glam::{DQuat, DVec3};

/// The last frame that can be named.
pub const LAST_FRAME: f64 = 100_000.0;

/// Converts these messages and collects their problems.
pub struct ExtraBodies<'a> {
    /// Names of the props, by which bodies and emitters refer to them.
    names: Vec<&'a str>,
    fps: f64,
    pub problems: Vec<Problem>,
}

/// The name of a prop: its node, or its file without folder and ending.
fn prop_name(path: &str) -> &str {
    let (file, node) = cairn_files::split_node(path);
    node.unwrap_or_else(|| {
        let name = file.rsplit(['/', '\\']).next().unwrap_or(file);
        name.rsplit_once('.').map_or(name, |(stem, _)| stem)
    })
}

impl<'a> ExtraBodies<'a> {
    pub fn new(scene: &'a proto::Scene, fps: f64) -> ExtraBodies<'a> {
        ExtraBodies { names: scene.props.iter().map(|prop| prop_name(&prop.path)).collect(), fps, problems: Vec::new() }
    }

    fn report(&mut self, field: &str, what: String, remedy: impl Into<String>) {
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
            scale: body.scale(),
            velocity: self.vector(&field("velocity"), &body.velocity),
            angular_velocity: self.vector(&field("angular_velocity"), &body.angular_velocity),
            mass: body.mass,
            start,
            pinned: body.kept(),
            pinned_until: kept_until,
        }
    }

    /// `mesh`: the emitter's, where it has one.
    pub fn emitter(&mut self, index: usize, emitter: &proto::Emitter, mesh: Option<EmitterVolume>) -> Emitter {
        use proto::emitter::Start;
        let field = |name: &str| format!("emitters.{index}.{name}");
        let place = mesh.unwrap_or_else(|| EmitterVolume::Box {
            center: self.vector(&field("center"), &emitter.center),
            size: self.vector(&field("size"), &emitter.size),
        });
        let props = (0..).zip(&emitter.props).map(|(i, name)| self.prop(&field(&format!("props.{i}")), name)).collect();
        let start = match emitter.start {
            None => 0.0,
            Some(Start::StartFrame(frame)) => self.frame(&field("start_frame"), f64::from(frame)),
            Some(Start::StartSeconds(seconds)) => seconds,
        };
        Emitter {
            place,
            props,
            rate: emitter.rate(),
            count: u32::try_from(emitter.count()).unwrap_or(0),
            velocity: self.vector(&field("velocity"), &emitter.velocity),
            start,
        }
    }

    /// The props and the seed of one of several shapes.
    pub fn pile(&mut self, index: usize, pile: &proto::Pile) -> (Vec<usize>, Option<u64>) {
        let field = |name: &str| format!("piles.{index}.{name}");
        let props = (0..).zip(&pile.props).map(|(i, name)| self.prop(&field(&format!("props.{i}")), name)).collect();
        let seed = pile.seed.and_then(|seed| {
            u64::try_from(seed)
                .map_err(|_| {
                    self.report(&field("seed"), format!("{seed} is out of range"), "Give 0 to 9223372036854775807.");
                })
                .ok()
        });
        (props, seed)
    }

    pub fn removal(&mut self, index: usize, removal: &proto::Removal) -> RemovalRequest {
        use proto::removal::Start;
        let field = |name: &str| format!("remove.{index}.{name}");
        let most = usize::try_from(removal.count()).unwrap_or(0);
        let choice = match removal.choice() {
            proto::RemovalChoice::Unspecified | proto::RemovalChoice::Named => RemovalChoice::Named {
                prop: removal.prop.as_ref().map(|name| self.prop(&field("prop"), name)),
                number: usize::try_from(removal.number()).unwrap_or(usize::MAX),
            },
            proto::RemovalChoice::Safe => RemovalChoice::Safe { most },
            proto::RemovalChoice::Order => RemovalChoice::Order { most },
            proto::RemovalChoice::Any => RemovalChoice::Any { most },
        };
        let start = removal.start.map(|start| match start {
            Start::StartFrame(frame) => self.frame(&field("start_frame"), f64::from(frame)),
            Start::StartSeconds(seconds) => seconds,
        });
        RemovalRequest { choice, start }
    }

    pub fn collapse(&mut self, collapse: &proto::Collapse) -> CollapseRequest {
        use proto::collapse::Start;
        let start = collapse.start.map(|start| match start {
            Start::StartFrame(frame) => self.frame("collapse.start_frame", f64::from(frame)),
            Start::StartSeconds(seconds) => seconds,
        });
        CollapseRequest {
            prop: collapse.prop.as_ref().map(|name| self.prop("collapse.prop", name)),
            number: collapse.number.map(|number| usize::try_from(number).unwrap_or(usize::MAX)),
            azimuth: collapse.azimuth(),
            start,
            duration: collapse.duration,
            speed: collapse.speed,
        }
    }

    pub fn keys(&mut self, index: usize, model: &proto::StaticModel) -> Vec<Keyframe> {
        let key = |(k, key): (usize, &proto::Keyframe)| {
            let field = format!("statics.{index}.keyframes.{k}.");
            let time = self.frame(&format!("{field}frame"), key.frame());
            Keyframe { time, pose: self.pose(&field, &key.position, &key.rotation) }
        };
        model.keyframes.iter().enumerate().map(key).collect()
    }

    /// The time of a frame, s.
    fn frame(&mut self, field: &str, frame: f64) -> f64 {
        if !(0.0..=LAST_FRAME).contains(&frame) {
            self.report(field, format!("{frame} is out of range"), format!("Give 0 to {LAST_FRAME}."));
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
                self.report(field, format!("no prop is called `{name}`"), remedy);
            }
            (several, _) => {
                let what = format!("{} props are called `{name}`", several.len());
                self.report(field, what, format!("Give its number in props instead: {several:?}."));
            }
        }
        0
    }

    fn vector(&mut self, field: &str, given: &[f64]) -> DVec3 {
        DVec3::from_array(self.numbers(field, given, "Give three: x, y, z."))
    }

    /// The numbers of a list, which must have N.
    fn numbers<const N: usize>(&mut self, field: &str, given: &[f64], remedy: &str) -> [f64; N] {
        given.try_into().unwrap_or_else(|_| {
            self.report(field, format!("{} numbers are given", given.len()), remedy);
            [1.0; N]
        })
    }

    fn pose(&mut self, prefix: &str, position: &[f64], rotation: &[f64]) -> Pose {
        let field = format!("{prefix}rotation");
        let rotation = DQuat::from_array(self.numbers(&field, rotation, "Give four: x, y, z, w."));
        let translation = self.vector(&format!("{prefix}position"), position);
        Pose { translation, rotation: self.rotation(&field, rotation) }
    }

    /// Scales a rotation to unit length. The core reports one of length zero.
    fn rotation(&mut self, field: &str, given: DQuat) -> DQuat {
        if given.to_array().into_iter().any(|part| !(-1.0..=1.0).contains(&part)) {
            self.report(field, format!("{:?} is out of range", given.to_array()), "Give each from -1 to 1.");
            return DQuat::IDENTITY;
        }
        if given.length() > 0.0 { given.normalize() } else { given }
    }
}
