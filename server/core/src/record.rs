//! Frames: the poses of all bodies at the frame rate, between steps where a frame falls there.
//!
//! Frames do not pace the physics: another frame rate gives the same motion.

use crate::pose::Pose;
use crate::world::{Role, World};

/// Collects frames while a world runs. Poses are those of the bodies (centre of mass), engine units.
pub struct Recorder {
    /// Engine time of a frame.
    interval: f64,
    time: f64,
    last: Vec<Pose>,
    /// Shape `[frame][body]`; a frame has the bodies that were there at its time: more from frame to frame.
    pub frames: Vec<Vec<Pose>>,
}

impl Recorder {
    /// Frame 0 is the world as it stands. `interval`: engine time between frames.
    pub fn new(world: &World, interval: f64) -> Recorder {
        let first = poses(world, &[]);
        Recorder { interval, time: 0.0, last: first.clone(), frames: vec![first] }
    }

    /// Called when bodies were added since the last step.
    pub fn join(&mut self, world: &World) {
        let now = poses(world, &self.last);
        self.last.extend_from_slice(&now[self.last.len()..]);
    }

    /// Called after every step.
    pub fn step(&mut self, world: &World) {
        let now = poses(world, &self.last);
        let length = world.step_length();
        loop {
            let due = self.frames.len() as f64 * self.interval;
            // A frame at the end of a step belongs to it, whatever the rounding.
            if due > self.time + length * (1.0 + 1e-9) {
                break;
            }
            let s = ((due - self.time) / length).clamp(0.0, 1.0);
            self.frames.push(self.last.iter().zip(&now).map(|(a, b)| a.interpolate(b, s)).collect());
        }
        self.time += length;
        self.last = now;
    }

    /// Frames so far, without frame 0.
    pub fn count(&self) -> usize {
        self.frames.len() - 1
    }

    /// Repeats the last pose for `count` frames.
    pub fn hold(&mut self, count: usize) {
        self.frames.extend(std::iter::repeat_n(self.last.clone(), count));
    }
}

/// A body that is gone stays where it was last seen.
fn poses(world: &World, last: &[Pose]) -> Vec<Pose> {
    let pose = |id: usize| match world.bodies()[id].role {
        Role::Gone => last.get(id).copied().unwrap_or(Pose::IDENTITY),
        _ => {
            let pose = world.pose(id);
            // The same rotation has two quaternions: keep to the one nearer to the last frame.
            let turned = last.get(id).is_some_and(|l| l.rotation.dot(pose.rotation) < 0.0);
            Pose { rotation: if turned { -pose.rotation } else { pose.rotation }, ..pose }
        }
    };
    (0..world.bodies().len()).map(pose).collect()
}
