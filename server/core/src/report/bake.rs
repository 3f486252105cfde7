//! A finished bake: what the stages leave behind.

use crate::geometry::pose::Pose;
use crate::report::Report;
use crate::sim::pile::Pile;

/// A finished bake: the pile, and what is told of it.
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
    /// Shape `[frame][body]`: from the prop's own frame, scaled, to the world; metres. A body that is not there yet has the
    /// pose in which it will appear.
    pub frames: Vec<Vec<Pose>>,
    /// Shape `[static][frame]`: from where the file places it to the world; empty for one that stands still.
    pub scenery: Vec<Vec<Pose>>,
    /// What is glued; `None` where nothing may be.
    pub glue: Option<BakedGlue>,
}

impl BakedPile {
    /// Only the last frame, as the only one.
    pub fn last_frame(&self) -> BakedPile {
        let last = |poses: &Vec<Pose>| poses.last().copied().into_iter().collect();
        BakedPile {
            fps: self.fps,
            bodies: self.bodies.iter().map(|body| BakedBody { first_frame: 0, ..*body }).collect(),
            frames: self.frames.last().cloned().into_iter().collect(),
            scenery: self.scenery.iter().map(last).collect(),
            glue: self.glue.clone(),
        }
    }
}

/// The glue of a finished pile, SI, where its bodies are at the last frame: so that others can simulate it further.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct BakedGlue {
    pub dots: Vec<BakedGlueDot>,
    /// Bodies that move as one, by their indices, rising: joined by dots that hold.
    pub clusters: Vec<Vec<usize>>,
    /// Bodies that dots join to the ground or to scenery, directly or through others, rising.
    pub anchored: Vec<usize>,
}

/// A glued touch.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct BakedGlueDot {
    pub body: usize,
    /// The other body; `None`: the ground or scenery.
    pub other: Option<usize>,
    /// m.
    pub point: [f64; 3],
    /// Of the touch, unit, into `body`.
    pub normal: [f64; 3],
    /// What it carries in the equilibrium for which it was placed, beside the contacts: on `body`, N.
    pub force: [f64; 3],
    /// About `point`, N m.
    pub moment: [f64; 3],
    /// It broke while the bake ran.
    pub is_broken: bool,
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
