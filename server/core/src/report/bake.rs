//! A finished bake: what the stages leave behind.

use crate::geometry::pose::Pose;
use crate::report::Report;
use crate::sim::pile::Pile;

/// The result of a bake. Frame 0 is the pile right after turning over.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Bake {
    /// Frames per second.
    pub fps: f64,
    /// In the order of insertion.
    pub bodies: Vec<BakedBody>,
    /// Shape `[frame][body]`: from the prop's own frame, scaled, to the world; metres. A body that is not there yet has the
    /// pose in which it will appear.
    pub frames: Vec<Vec<Pose>>,
    /// Shape `[static][frame]`: from where the file places it to the world; empty for one that stands still.
    pub scenery: Vec<Vec<Pose>>,
    pub report: Report,
}

impl Bake {
    /// Only the last frame, as the only one.
    pub fn last_frame(mut self) -> Bake {
        self.frames.drain(..self.frames.len() - 1);
        self.bodies.iter_mut().for_each(|body| body.first_frame = 0);
        self.scenery.iter_mut().for_each(|poses| drop(poses.drain(..poses.len().saturating_sub(1))));
        self
    }
}

/// One prop in the pile.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct BakedBody {
    /// Index into the scene's props.
    pub prop: usize,
    /// Uniform scale applied to the prop before its pose.
    pub scale: f64,
    /// The first frame that has it; 0 for all that the fill or the scene put there at the beginning.
    pub first_frame: usize,
}

/// The bodies that some frame has, and the frames in SI, from the props' own frames. Shape `[frame][body]`.
pub fn prop_frames(pile: &Pile) -> (Vec<BakedBody>, Vec<Vec<Pose>>) {
    let count = pile.recorder.frames.last().map_or(0, Vec::len);
    let all = pile.instances.iter().zip(&pile.recorder.first_frames).take(count);
    let bodies: Vec<BakedBody> =
        all.map(|(b, &first_frame)| BakedBody { prop: b.prop, scale: b.scale, first_frame }).collect();
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
