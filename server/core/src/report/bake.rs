//! The types of a finished bake.

use crate::report::Report;
use cairn_engine::shape::{Shape, Solid};
use cairn_engine::world::Role;
use cairn_geometry::pose::Pose;
use cairn_motion::instance::Instance;
use cairn_motion::pile::Pile;
use glam::{DQuat, DVec3};

/// Masses that differ by less than this share are one.
const ROUNDING: f64 = 1e-9;

/// A finished bake: the pile and its report.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Bake {
    pub pile: BakedPile,
    pub report: Report,
}

/// The result of a bake. Frame 0 is the pile right after turning over.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct BakedPile {
    /// Frames per second.
    pub fps: f64,
    /// In the order of insertion.
    pub bodies: Vec<BakedBody>,
    /// Number of them that the fill put there, the first ones.
    #[serde(default)]
    pub filled: usize,
    /// Shape `[frame][body]`: from the prop's own frame, scaled, to the world; metres. A body that is not there yet has
    /// the pose in which it will appear.
    pub frames: Vec<Vec<Pose>>,
    /// Shape `[static][frame]`: from where the file places it to the world; empty for one that stands still.
    pub scenery: Vec<Vec<Pose>>,
    /// `None` where nothing may be glued.
    pub glue: Option<BakedGlue>,
    /// Per prop.
    pub solids: Vec<BakedSolid>,
    pub world: BakedWorld,
}

impl BakedPile {
    /// Only the last frame, as the only one.
    pub fn last_frame(&self) -> BakedPile {
        let last = |poses: &Vec<Pose>| poses.last().copied().into_iter().collect();
        BakedPile {
            fps: self.fps,
            bodies: self.bodies.iter().map(|body| BakedBody { first_frame: 0, ..*body }).collect(),
            filled: self.filled,
            frames: self.frames.last().cloned().into_iter().collect(),
            scenery: self.scenery.iter().map(last).collect(),
            glue: self.glue.clone(),
            solids: self.solids.clone(),
            world: self.world,
        }
    }

    /// The pose of a body's pivot in a frame; its axes are the body's.
    pub fn pivot_pose(&self, frame: usize, body: usize) -> Pose {
        let (pose, BakedBody { prop, scale, .. }) = (self.frames[frame][body], self.bodies[body]);
        Pose { translation: pose.transform_point(self.solids[prop].pivot * scale), ..pose }
    }
}

/// A prop as it was simulated, at scale 1, SI: for programs that simulate the pile further.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct BakedSolid {
    /// The point about which it turns between two frames, in its own frame: its center of mass where its origin is far
    /// from it, else the origin.
    pub pivot: DVec3,
    /// Center of mass, in its own frame.
    pub center: DVec3,
    /// kg.
    pub mass: f64,
    /// Principal moments of inertia about the center of mass, kg m^2, and the rotation from their axes.
    pub inertia: (DVec3, DQuat),
    /// Coulomb friction coefficient; a pair has the mean of its two.
    pub friction: f64,
    /// Coefficient of restitution, 0 where no body bounces; a pair has the mean of its two.
    #[serde(default)]
    pub restitution: f64,
    /// The collision shape, about the center of mass, without the skin in which this engine lets bodies overlap.
    pub solid: Solid,
}

impl BakedSolid {
    pub fn new(shape: &Shape, friction: f64, restitution: f64) -> BakedSolid {
        BakedSolid {
            pivot: shape.pivot(),
            center: shape.center,
            mass: shape.mass,
            inertia: shape.inertia,
            friction,
            restitution,
            solid: shape.bare.clone(),
        }
    }
}

/// What a pile was simulated in, SI.
#[derive(Clone, Copy, Debug, serde::Serialize, serde::Deserialize)]
pub struct BakedWorld {
    /// m/s^2.
    pub gravity: f64,
    /// Height of the ground; `None`: there is none.
    pub ground: Option<f64>,
    /// Coulomb friction coefficient of the ground.
    pub ground_friction: f64,
    /// Diameter of the median prop.
    pub diameter: f64,
}

/// The glue of a finished pile, SI, for the poses of the last frame: for programs that simulate the pile further.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct BakedGlue {
    pub dots: Vec<BakedGlueDot>,
    /// Bodies that move as one, by their indices, ascending: joined by glue joints that hold.
    pub clusters: Vec<Vec<usize>>,
    /// Bodies that glue joints join to the ground or to scenery, directly or through others, ascending.
    pub anchored: Vec<usize>,
}

/// A glue joint.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct BakedGlueDot {
    pub body: usize,
    /// The other body; `None`: the ground or scenery.
    pub other: Option<usize>,
    /// m.
    pub point: [f64; 3],
    /// Of the contact, unit, into `body`.
    pub normal: [f64; 3],
    /// The force on `body` in the equilibrium for which the joint was placed, beside the contacts', N.
    pub force: [f64; 3],
    /// About `point`, N m.
    pub moment: [f64; 3],
    /// Force in N and moment in N m beyond which it breaks, each taken alone, where joints break; infinite: never.
    pub limit: [f64; 2],
    /// It broke during the bake.
    pub is_broken: bool,
}

/// One prop in the pile.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct BakedBody {
    /// Index into the scene's props.
    pub prop: usize,
    /// The number in its name.
    pub number: usize,
    /// Uniform scale applied to the prop before its pose.
    pub scale: f64,
    /// The first frame that has it; 0 for bodies of the fill, and those that the scene places at the beginning.
    pub first_frame: usize,
    /// Its mass in shares of that of its prop at its scale.
    pub mass_factor: f64,
    /// The scene keeps it where it is, in the last frame, too.
    pub is_pinned: bool,
}

/// The bodies that some frame has, and the frames in SI, from the props' own frames. Shape `[frame][body]`.
pub fn prop_frames(pile: &Pile) -> (Vec<BakedBody>, Vec<Vec<Pose>>) {
    let count = pile.recorder.frames.last().map_or(0, Vec::len);
    let all = pile.instances.iter().zip(&pile.recorder.first_frames).take(count);
    let body = |(number, (instance, &first_frame)): (usize, (&Instance, &usize))| {
        let &Instance { prop, scale, .. } = instance;
        let body = &pile.world.bodies()[number];
        let factor = body.mass * pile.world.units.mass / (pile.shapes[prop].mass * scale.powi(3));
        let mass_factor = if (factor - 1.0).abs() < ROUNDING { 1.0 } else { factor };
        BakedBody { prop, number, scale, first_frame, mass_factor, is_pinned: body.role == Role::Pinned }
    };
    let bodies: Vec<BakedBody> = all.enumerate().map(body).collect();
    let mut frames: Vec<Vec<Pose>> =
        (0..pile.recorder.frames.len()).map(|number| pile.prop_frame(number).collect()).collect();
    // Before it appears, a body has the pose that it will have then.
    for number in (1..frames.len()).rev() {
        let (before, after) = frames.split_at_mut(number);
        let known = before[number - 1].len();
        before[number - 1].extend_from_slice(&after[0][known..]);
    }
    (bodies, frames)
}
