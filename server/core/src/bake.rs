//! A finished bake: what the stages leave behind.

use crate::pose::Pose;
use crate::report::Report;

/// The result of a bake. Frame 0 is the pile right after turning over.
#[derive(Clone, Debug)]
pub struct Bake {
    /// Frames per second.
    pub fps: f64,
    /// In the order of insertion.
    pub bodies: Vec<Body>,
    /// Shape `[frame][body]`: from the prop's own frame, scaled, to the world; metres.
    pub frames: Vec<Vec<Pose>>,
    pub report: Report,
}

/// One prop in the pile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Index into the scene's props.
    pub prop: usize,
    /// Uniform scale applied to the prop before its pose.
    pub scale: f64,
}
