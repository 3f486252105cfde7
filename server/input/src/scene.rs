//! The scene of a bake, with every mesh already read: plain values, no files.

use crate::earlier::EarlierPile;
pub use crate::params::Turns;
use crate::params::{Accuracy, Params};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use glam::DVec3;

/// Everything a bake needs besides its [`Params`].
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Scene {
    /// The pile's shape, as placed by the artist. Closed. Required for a fill.
    pub control: Option<Model>,
    /// The control acts inside it, or else inside `control`, or else everywhere. Closed.
    pub region: Option<Model>,
    /// At least one. A body is a copy of one of these, scaled and placed.
    pub props: Vec<Prop>,
    /// Several shapes, each filled on its own; `control` is then all of them together. Empty: `control` is one shape.
    pub piles: Vec<PileShape>,
    /// Scenery (besides the ground), as placed in the world.
    pub statics: Vec<StaticModel>,
    /// Placed by hand.
    pub bodies: Vec<PlacedBody>,
    pub emitters: Vec<Emitter>,
    /// Bodies that are taken away once the pile rests, in this order.
    pub removals: Vec<RemovalRequest>,
    /// How the pile comes down once it rests; `None`: it stays.
    pub collapse: Option<CollapseRequest>,
    /// An earlier pile, of which the fill keeps what fits.
    pub earlier: Option<EarlierPile>,
}

/// How a pile comes down.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct CollapseRequest {
    /// The body that goes first, by its number among the bodies of the prop, or among all; without a number, of the
    /// lowest ones the one that is farthest to the side of the fall.
    pub prop: Option<usize>,
    pub number: Option<usize>,
    /// Direction of the fall, degrees from +Z toward +X.
    pub azimuth: f64,
    /// Not before this time, s after frame 0, and not before the pile rests; `None`: as soon as it rests.
    pub start: Option<f64>,
    /// Time in which the pile breaks up, s; `None`: 0.7 of that of a fall from its top.
    pub duration: Option<f64>,
    /// Speed that the first body gets toward the side of the fall, m/s; `None`: that of a fall by half its diameter.
    pub speed: Option<f64>,
}

/// Bodies that are taken away once the pile rests.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct RemovalRequest {
    pub choice: RemovalChoice,
    /// Not before this time, s after frame 0, and not before the pile rests; `None`: as soon as it rests.
    pub start: Option<f64>,
}

/// Which bodies are taken away.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub enum RemovalChoice {
    /// One, by its number among the bodies of a prop, or among all.
    Named { prop: Option<usize>, number: usize },
    /// At most so many of those that are safe to remove at the beginning, from the top, while they still are.
    Safe { most: usize },
    /// At most so many, each the highest that is safe to remove at that moment.
    Order { most: usize },
    /// At most so many, drawn evenly from those that are there, whether safe or not.
    Any { most: usize },
}

/// A named mesh.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Model {
    /// The name in messages: the file, and the node if one was chosen (`kit.glb#Brick`).
    pub name: String,
    pub mesh: TriMesh,
    /// The file has a skin for it, which is not applied: its size may be another one than in other programs.
    pub is_skinned: bool,
}

impl Model {
    pub fn new(name: impl Into<String>, mesh: TriMesh) -> Model {
        Model { name: name.into(), mesh, is_skinned: false }
    }
}

/// One of several shapes of a scene.
#[derive(Clone, Debug, serde::Serialize)]
pub struct PileShape {
    /// Closed.
    pub control: Model,
    /// Indices into the scene's props; empty: all, by weight.
    pub props: Vec<usize>,
    /// Of its fill; `None`: from the scene's seed and its place in the list.
    pub seed: Option<u64>,
}

/// A model of which bodies are copies. Its mesh is in the prop's own frame.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Prop {
    pub model: Model,
    /// How far its mesh is from the one that is shown, m: a dense mesh was simplified.
    pub mesh_deviation: f64,
    /// Relative frequency among the props, >= 0. 0: only placed by hand.
    pub weight: f64,
    /// Coulomb friction coefficient, 0 to 2. A pair has the mean of its two.
    pub friction: f64,
    /// kg/m^3, > 0.
    pub density: f64,
    /// 0 to 1.
    pub restitution: f64,
    /// Uniform scale drawn between these two, both > 0.
    pub scale: [f64; 2],
    /// Largest angle between its up axis and the world's when it is drawn, degrees, 0 to 180. 180: any rotation.
    pub tilt_max: f64,
    /// Distribution of sizes between the two, -1 to 1: mostly large, evenly, mostly small.
    pub scale_skew: f64,
    pub stance: UprightRule,
}

/// The upright position of a prop in a tidy fill.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct UprightRule {
    /// Its own up direction; `None`: the one in which it lies flattest.
    pub up: Option<DVec3>,
    pub turns: Turns,
}

/// A piece of scenery.
#[derive(Clone, Debug, serde::Serialize)]
pub struct StaticModel {
    pub model: Model,
    /// Coulomb friction coefficient, 0 to 2.
    pub friction: f64,
    /// Its motion, ascending in time; empty: it stands still as placed. It also stands still before the first and after
    /// the last key.
    pub keys: Vec<Keyframe>,
}

impl Prop {
    /// A prop of 1000 kg/m^3 that does not bounce, in its own size, at any rotation, with the paper's friction (Table
    /// 1).
    pub fn new(model: Model) -> Prop {
        Prop {
            model,
            mesh_deviation: 0.0,
            weight: 1.0,
            friction: Params::new(Accuracy::Standard).ground_friction,
            density: 1000.0,
            restitution: 0.0,
            scale: [1.0; 2],
            tilt_max: 180.0,
            scale_skew: 0.0,
            stance: UprightRule::default(),
        }
    }

    /// A number drawn evenly from 0 to 1 is raised to this power before it becomes a scale.
    pub fn scale_power(&self) -> f64 {
        libm::pow(SKEW, self.scale_skew)
    }
}

/// Seeds of several shapes differ by this.
const SEED_STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// The power for a skew of 1: the median is then at 1/16 of the range.
const SKEW: f64 = 4.0;

impl StaticModel {
    /// A height that it never is below, m.
    fn lowest(&self) -> f64 {
        // For any rotation about its file's origin.
        let reach = || self.model.mesh.points.iter().map(|p| p.length()).fold(0.0, f64::max);
        let keyed = self.keys.iter().map(|key| key.pose.translation.y).reduce(f64::min);
        keyed.map_or_else(|| self.model.mesh.bounds().0.y, |low| low - reach())
    }

    /// The pose at a time in s; a point as placed -> the world.
    pub fn pose_at(&self, time: f64) -> Pose {
        let next = self.keys.partition_point(|k| k.time <= time);
        match (next.checked_sub(1).map(|i| &self.keys[i]), self.keys.get(next)) {
            (Some(a), Some(b)) => a.pose.interpolate_arc(&b.pose, (time - a.time) / (b.time - a.time)),
            (Some(only), None) | (None, Some(only)) => only.pose,
            (None, None) => Pose::IDENTITY,
        }
    }
}

/// A pose at a moment.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Keyframe {
    /// s after frame 0.
    pub time: f64,
    pub pose: Pose,
}

/// A body placed by hand.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct PlacedBody {
    /// Index into the scene's props.
    pub prop: usize,
    /// From the prop's own frame, scaled, to the world; metres.
    pub pose: Pose,
    /// Uniform, > 0.
    pub scale: f64,
    /// m/s.
    pub velocity: DVec3,
    /// rad/s.
    pub angular_velocity: DVec3,
    /// kg; `None`: from density and volume.
    pub mass: Option<f64>,
    /// When it appears, s after frame 0.
    pub start: f64,
    /// It stays exactly where it is.
    pub pinned: bool,
    /// When a pinned body is released, s after frame 0; `None`: never.
    pub pinned_until: Option<f64>,
}

impl PlacedBody {
    /// A body at rest that exists from the beginning.
    pub fn new(prop: usize, pose: Pose) -> PlacedBody {
        PlacedBody {
            prop,
            pose,
            scale: 1.0,
            velocity: DVec3::ZERO,
            angular_velocity: DVec3::ZERO,
            mass: None,
            start: 0.0,
            pinned: false,
            pinned_until: None,
        }
    }

    pub fn moves(&self) -> bool {
        self.velocity != DVec3::ZERO || self.angular_velocity != DVec3::ZERO
    }

    /// The body is part of the pile that is released. Other bodies are free as soon as they appear.
    pub fn is_stacked(&self) -> bool {
        self.start <= 0.0 && !self.moves()
    }
}

/// A place where bodies appear.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Emitter {
    pub place: EmitterVolume,
    /// Indices into the scene's props; empty: all, by weight.
    pub props: Vec<usize>,
    /// 1/s, > 0.
    pub rate: f64,
    pub count: u32,
    /// m/s.
    pub velocity: DVec3,
    /// When the first body appears, s after frame 0.
    pub start: f64,
}

/// The volume in which an emitter's bodies appear.
#[derive(Clone, Debug, serde::Serialize)]
pub enum EmitterVolume {
    /// Centre and edge lengths, m.
    Box { center: DVec3, size: DVec3 },
    /// The inside of a closed mesh.
    Mesh(Model),
}

impl EmitterVolume {
    /// Lowest and highest corner, m.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        match self {
            EmitterVolume::Box { center, size } => (*center - *size / 2.0, *center + *size / 2.0),
            EmitterVolume::Mesh(model) => model.mesh.bounds(),
        }
    }
}

impl Scene {
    /// The shape that the pile is measured against: the control mesh, or else the region.
    pub fn target(&self) -> Option<&Model> {
        self.control.as_ref().or(self.region.as_ref())
    }

    /// The scene of one of several shapes alone: its own props have a weight.
    pub fn of_pile(&self, index: usize) -> Scene {
        let pile = &self.piles[index];
        let mut props = self.props.clone();
        for (i, prop) in props.iter_mut().enumerate() {
            if !pile.props.is_empty() && !pile.props.contains(&i) {
                prop.weight = 0.0;
            }
        }
        Scene { control: Some(pile.control.clone()), props, piles: Vec::new(), ..self.clone() }
    }

    /// The parameters of its fill. The first of several shapes is filled as the only one would be.
    pub fn params_of_pile(&self, index: usize, params: &Params) -> Params {
        let own = || params.seed.wrapping_add((index as u64).wrapping_mul(SEED_STEP));
        Params { seed: self.piles[index].seed.unwrap_or_else(own), ..params.clone() }
    }

    /// A height below all models, placed bodies and emitters, m: a bound, not exact for moving scenery. Infinite for an
    /// empty scene.
    pub fn lowest(&self) -> f64 {
        let target = self.target().map(|model| model.mesh.bounds().0.y);
        let placed = self.bodies.iter().map(|body| body.pose.translation.y);
        let emitted = self.emitters.iter().map(|emitter| emitter.place.bounds().0.y);
        let scenery = self.statics.iter().map(StaticModel::lowest);
        target.into_iter().chain(placed).chain(emitted).chain(scenery).fold(f64::INFINITY, f64::min)
    }

    /// The middle of the control mesh; without one, of the places at which bodies come in. m.
    pub fn middle(&self) -> DVec3 {
        let placed = || self.bodies.iter().map(|body| (body.pose.translation, body.pose.translation));
        let emitted = || self.emitters.iter().map(|emitter| emitter.place.bounds());
        let bounds = match &self.control {
            Some(model) => Some(model.mesh.bounds()),
            None => placed().chain(emitted()).reduce(|(low, high), (l, h)| (low.min(l), high.max(h))),
        };
        bounds.map_or(DVec3::ZERO, |(low, high)| (low + high) / 2.0)
    }

    /// Whether the control mesh is filled.
    pub fn is_filled(&self, params: &Params) -> bool {
        self.control.is_some() && params.fill.method.traits().fills
    }

    /// The largest load of a glue joint, as [`Params::glue_bound`]; a pile that is taken apart has no glue.
    pub fn glue_bound(&self, params: &Params) -> f64 {
        if self.removals.is_empty() { params.glue_bound(self.is_filled(params)) } else { 0.0 }
    }

    /// Whether anything may hit a held body, besides the bodies of the pile.
    pub fn something_hits(&self) -> bool {
        let late = self.bodies.iter().any(|body| !body.is_stacked());
        let released = self.bodies.iter().any(|body| body.pinned_until.is_some());
        let moving = self.statics.iter().any(|model| !model.keys.is_empty());
        late || released || moving || !self.emitters.is_empty()
    }

    /// Bodies that are placed by hand or emitted.
    pub fn added_bodies(&self) -> usize {
        self.bodies.len() + self.emitters.iter().map(|emitter| emitter.count as usize).sum::<usize>()
    }

    /// The props that an emitter draws from.
    pub fn emitted<'a>(&'a self, emitter: &'a Emitter) -> impl Iterator<Item = usize> + Clone + 'a {
        let chosen = |i: &usize| self.props[*i].weight > 0.0 && (emitter.props.is_empty() || emitter.props.contains(i));
        (0..self.props.len()).filter(chosen)
    }
}
