//! A finished bake: what the stages leave behind.

use crate::geometry::pose::Pose;
use crate::report::Report;

/// The result of a bake. Frame 0 is the pile right after turning over.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Bake {
    /// Frames per second.
    pub fps: f64,
    /// In the order of insertion.
    pub bodies: Vec<Body>,
    /// Shape `[frame][body]`: from the prop's own frame, scaled, to the world; metres. A body that is not there yet has the
    /// pose in which it will appear.
    pub frames: Vec<Vec<Pose>>,
    /// Shape `[static][frame]`: from where the file places it to the world; empty for one that stands still.
    pub scenery: Vec<Vec<Pose>>,
    pub report: Report,
}

/// One prop in the pile.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Body {
    /// Index into the scene's props.
    pub prop: usize,
    /// Uniform scale applied to the prop before its pose.
    pub scale: f64,
    /// The first frame that has it; 0 for all that the fill or the scene put there at the beginning.
    pub first_frame: usize,
}
