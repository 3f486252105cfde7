//! The files that engines exchange: a pile right after turning over, or a problem with a known answer, and where an
//! engine left it. The package of other engines reads this file, too, so it knows nothing of Cairn.

use serde::{Deserialize, Serialize};

/// Bodies, and what they stand on. SI, Y up, right-handed; quaternions x y z w.
#[derive(Serialize, Deserialize)]
pub struct PeerScene {
    /// The scene file and the assignments that a pile was made of.
    #[serde(default)]
    pub file: std::path::PathBuf,
    #[serde(default)]
    pub set: Vec<String>,
    /// A problem whose answer is known: no engine damps by itself, and the run has the poses of every frame.
    #[serde(default)]
    pub exact: bool,
    /// m/s^2, downward.
    pub gravity: f64,
    /// Coulomb friction of every pair of bodies, and of a body and the ground. Engines that multiply the two of a pair
    /// are given its square root.
    pub friction: f64,
    /// Height of the ground, m.
    pub ground: f64,
    /// Frames after the first, and frames per second.
    pub frames: u32,
    pub fps: f64,
    pub shapes: Vec<PeerShape>,
    pub bodies: Vec<PeerBody>,
    /// Bodies that move in the beginning.
    #[serde(default)]
    pub launched: Vec<PeerLaunch>,
    #[serde(default)]
    pub scenery: Vec<PeerScenery>,
}

/// The velocities with which a body begins.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub struct PeerLaunch {
    /// Index into the bodies.
    pub body: usize,
    /// Of the centre of mass, m/s.
    pub velocity: [f64; 3],
    /// rad/s, in the axes of the world.
    pub angular_velocity: [f64; 3],
}

/// What no body moves.
#[derive(Serialize, Deserialize)]
pub struct PeerScenery {
    /// Its shape, and where it begins.
    pub place: PeerBody,
    /// m/s, all the time; zero: it stands still.
    pub velocity: [f64; 3],
}

/// A shape about its centre of mass, in axes in which the inertia is (nearly) diagonal.
#[derive(Serialize, Deserialize)]
pub struct PeerShape {
    /// Index into the scene's props.
    pub prop: usize,
    pub scale: f64,
    /// From these axes to the prop's.
    pub frame: [f64; 4],
    /// kg.
    pub mass: f64,
    /// Diagonal, kg m^2.
    pub inertia: [f64; 3],
    pub solid: PeerSolid,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PeerSolid {
    /// Half extents, m.
    Box([f64; 3]),
    /// Radius, m.
    Ball(f64),
    /// Corners of convex parts, m.
    Hulls(Vec<Vec<[f64; 3]>>),
}

#[derive(Clone, Copy, Serialize, Deserialize)]
pub struct PeerBody {
    /// Index into the shapes.
    pub shape: usize,
    /// Of the centre of mass, m.
    pub position: [f64; 3],
    pub rotation: [f64; 4],
}

/// What an engine did with it.
#[derive(Serialize, Deserialize)]
pub struct PeerRun {
    pub engine: String,
    pub settings: String,
    /// CPU seconds of the simulation alone, of all threads.
    pub cpu: f64,
    /// CPU seconds until every frame of every body is a key of an F-curve, where the engine makes some.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub keyframes_cpu: Option<f64>,
    /// Steps in which the contacts of a body resisted its motion, mean of the bodies; of Cairn alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resisted_steps: Option<f64>,
    /// Simulated seconds: fewer than asked for where the engine was stopped for the time that it took.
    pub seconds: f64,
    /// In the order of the scene.
    pub bodies: Vec<PeerBody>,
    /// Positions and rotations at each frame, the first included; of a problem with a known answer alone.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub motion: Vec<Vec<[f64; 7]>>,
}
