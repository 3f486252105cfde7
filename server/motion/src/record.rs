//! Frames: the poses of all bodies at the frame rate, between steps where a frame falls there.
//!
//! Frames do not pace the physics: another frame rate gives the same motion, and so does none.

use cairn_engine::world::{BodyId, Role, Units, World};
use cairn_geometry::pose::Pose;
use cairn_input::params::Params;
use glam::DVec3;
use std::collections::BTreeMap;

/// When frames are due, and whether they are kept.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    /// Engine time of a frame.
    interval: f64,
    keeps: bool,
    /// Frames after frame 0, at most.
    most: usize,
}

impl Pace {
    pub fn new(params: &Params, keeps: bool, units: Units) -> Pace {
        Pace {
            interval: 1.0 / params.output.fps / units.time,
            keeps,
            most: params.output.frames.map_or(usize::MAX, |n| n as usize),
        }
    }
}

/// A body this far from its final pose still moves, d.
const SEEN: f64 = 0.01;
/// Share of the bodies that may still move in a frame that is left out, and how far, d.
const FEW: f64 = 1e-3;
const NEAR: f64 = 0.1;

/// Collects frames while a world runs. Poses are those of the bodies (center of mass), engine units.
pub struct Recorder {
    pace: Pace,
    /// No frame is due before it starts again.
    pub waits: bool,
    time: f64,
    /// Frames due so far, without frame 0.
    due: usize,
    last: Vec<Pose>,
    /// The latest frame, where none are kept.
    latest: Vec<Pose>,
    /// Shape `[frame][body]`; a frame has the bodies that were there at its time: more from frame to frame. Where none
    /// are kept: the marked ones.
    pub frames: Vec<Vec<Pose>>,
    /// Per body: the first frame that has it.
    pub first_frames: Vec<usize>,
    /// The frame at which the hold began.
    pub hold_frame: usize,
    /// Frames left out at the end, because nothing was to be seen in them.
    pub trimmed: usize,
    /// The frame at which the hold was first disturbed: by a body thrown in, or by the end of the control.
    pub disturbed_frame: Option<usize>,
    /// Where bodies are that were taken out of the world.
    pub carried: BTreeMap<BodyId, Pose>,
}

impl Recorder {
    /// Frame 0 is the world as it stands.
    pub fn new(world: &World, pace: Pace) -> Recorder {
        let first = poses(world, &[], &BTreeMap::new());
        Recorder {
            pace,
            waits: false,
            time: 0.0,
            due: 0,
            last: first.clone(),
            latest: first.clone(),
            first_frames: vec![0; first.len()],
            frames: vec![first],
            hold_frame: 0,
            trimmed: 0,
            disturbed_frame: None,
            carried: BTreeMap::new(),
        }
    }

    /// Starts again: frame 0 is the world as it stands.
    pub fn restart(&mut self, world: &World) {
        *self = Recorder::new(world, self.pace);
    }

    /// A body appears: the next frame is the first that has it.
    pub fn expect(&mut self) {
        self.first_frames.push(self.frames.len());
    }

    /// The hold begins.
    pub fn begin_hold(&mut self) {
        self.hold_frame = self.mark();
    }

    /// Something moves the pile from outside.
    pub fn disturb(&mut self) {
        if self.hold_frame > 0 && self.disturbed_frame.is_none() {
            self.disturbed_frame = Some(self.mark());
        }
    }

    /// Called when bodies were added since the last step.
    pub fn join(&mut self, world: &World) {
        let now = poses(world, &self.last, &self.carried);
        self.last.extend_from_slice(&now[self.last.len()..]);
    }

    /// Called after every step.
    pub fn step(&mut self, world: &World) {
        let now = poses(world, &self.last, &self.carried);
        if self.waits {
            self.last = now;
            return;
        }
        let length = world.step_length();
        loop {
            let due = (self.due + 1) as f64 * self.pace.interval;
            // A frame at the end of a step belongs to it, whatever the rounding.
            if due > self.time + length * (1.0 + 1e-9) {
                break;
            }
            self.due += 1;
            let s = ((due - self.time) / length).clamp(0.0, 1.0);
            let frame = self.last.iter().zip(&now).map(|(a, b)| a.interpolate(b, s)).collect();
            if self.pace.keeps {
                self.frames.push(frame);
            } else if self.due <= self.pace.most {
                self.latest = frame;
            }
        }
        self.time += length;
        self.last = now;
    }

    /// Whether the frames are kept.
    pub fn keeps(&self) -> bool {
        self.pace.keeps
    }

    /// Frames due so far, without frame 0.
    pub fn count(&self) -> usize {
        self.due
    }

    /// The index of the latest frame, which is kept for it.
    pub fn mark(&mut self) -> usize {
        if !self.pace.keeps {
            self.frames.push(self.latest.clone());
        }
        self.frames.len() - 1
    }

    /// Leaves the last frames out in which nothing is to be seen (`output.trim`), but none before the step of this
    /// number: something is still to happen then.
    pub fn trim(&mut self, world: &World, step: u64) {
        let Some(last) = self.frames.last().filter(|_| self.pace.keeps).cloned() else { return };
        let is_settled = |frame: &Vec<Pose>| {
            let way = |(id, pose): (usize, &Pose)| pose.moved(&last[id], world.bodies()[id].radius);
            let ways: Vec<f64> = frame.iter().enumerate().map(way).filter(|&way| way > SEEN).collect();
            frame.len() == last.len()
                && ways.len() as f64 <= FEW * last.len() as f64
                && ways.iter().all(|&way| way <= NEAR)
        };
        let settled = self.frames.iter().rev().take_while(|frame| is_settled(frame)).count();
        let event = (step as f64 * world.step_length() / self.pace.interval).ceil() as usize;
        let count = (self.frames.len() - settled).max(event).max(self.hold_frame) + 1;
        self.trimmed = self.frames.len().saturating_sub(count);
        self.frames.truncate(count);
    }

    /// The time of the latest frame, s; of frame 0 where it waits.
    pub fn time(&self, units: Units) -> f64 {
        self.due as f64 * self.pace.interval * units.time
    }

    /// Adds a frame like the latest one, but for bodies that are moved: by the number of each, in engine units.
    pub fn amend(&mut self, shifts: &[(usize, DVec3)]) {
        for &(id, by) in shifts {
            self.last[id].translation += by;
        }
        self.due += 1;
        match self.pace.keeps {
            true => self.frames.push(self.last.clone()),
            false => self.latest = self.last.clone(),
        }
    }

    /// Whether this holds of a body's pose in all frames, as far as they are kept, and now.
    pub fn always(&self, id: BodyId, holds: impl Fn(&Pose) -> bool) -> bool {
        let frames = self.frames.iter().chain([&self.last, &self.latest]);
        frames.filter_map(|frame| frame.get(id)).all(holds)
    }

    /// Lets a body stay where it is in frame 0.
    pub fn stay(&mut self, id: BodyId) {
        let Some(pose) = self.frames.first().and_then(|frame| frame.get(id)).copied() else { return };
        let frames = self.frames.iter_mut().chain([&mut self.last, &mut self.latest]);
        frames.filter_map(|frame| frame.get_mut(id)).for_each(|now| *now = pose);
    }

    /// Makes it `count` frames after frame 0, repeating the last pose.
    pub fn fit(&mut self, count: usize) {
        if self.pace.keeps {
            self.frames.resize(count + 1, self.last.clone());
        }
    }
}

/// A body that is gone is where it is carried, or stays where it was last seen.
fn poses(world: &World, last: &[Pose], carried: &BTreeMap<BodyId, Pose>) -> Vec<Pose> {
    let pose = |id: usize| match world.bodies()[id].role {
        Role::Gone => carried.get(&id).or(last.get(id)).copied().unwrap_or(Pose::IDENTITY),
        _ => {
            let pose = world.pose(id);
            // The same rotation has two quaternions: keep to the one nearer to the last frame.
            let turned = last.get(id).is_some_and(|l| l.rotation.dot(pose.rotation) < 0.0);
            Pose { rotation: if turned { -pose.rotation } else { pose.rotation }, ..pose }
        }
    };
    (0..world.bodies().len()).map(pose).collect()
}
