//! Frames for the observer.

use super::pile::Pile;
use crate::instance::Instance;
use cairn_geometry::pose::Pose;
use cairn_input::observer::{Frame, FrameBody, Observer, Stage, State};
use cairn_input::params::Output;

/// Shows the frames of a pile, each once.
pub struct FramePublisher {
    /// Frames per second.
    fps: f64,
    /// The last frame that the result will have.
    last: usize,
    /// Frames shown.
    shown: usize,
    /// Of frames that are shown once all are known: their stages and states.
    late: Option<Vec<(Stage, Vec<State>)>>,
}

impl FramePublisher {
    pub fn new(output: &Output) -> FramePublisher {
        FramePublisher { fps: output.fps, last: output.frames.map_or(usize::MAX, |n| n as usize), shown: 0, late: None }
    }

    /// From now on, frames wait for [`FramePublisher::publish`].
    pub fn wait(&mut self) {
        self.late = Some(Vec::new());
    }

    /// Shows the frames that were recorded since, except those that the result will not have.
    pub fn run(&mut self, pile: &Pile, observer: &mut dyn Observer, stage: Stage) {
        if !observer.wants_frames() || !pile.recorder.keeps() {
            return;
        }
        let count = pile.recorder.frames.len();
        if self.shown >= count {
            return;
        }
        let states = pile.control.states(&pile.world);
        while self.shown < count && self.shown <= self.last {
            if let Some(late) = &mut self.late {
                late.push((stage, states.clone()));
                self.shown += 1;
                continue;
            }
            let (number, time) = (self.shown, self.shown as f64 / self.fps);
            send(pile, number, &states, observer, |bodies| Frame { stage, number, time, bodies, comers: &[] });
            self.shown += 1;
        }
    }

    /// Shows the final pose, as the only frame, where none are kept.
    pub fn end(&self, pile: &Pile, observer: &mut dyn Observer, stage: Stage) {
        if observer.wants_frames() && !pile.recorder.keeps() && self.late.is_none() {
            let time = pile.recorder.count().min(self.last) as f64 / self.fps;
            let states = pile.control.states(&pile.world);
            let latest = pile.recorder.frames.len() - 1;
            send(pile, latest, &states, observer, |bodies| Frame { stage, number: 0, time, bodies, comers: &[] });
        }
    }

    /// Shows the frames that have waited, as the result has them. Shape `[frame][body]`, SI, from the props' own
    /// frames.
    pub fn publish(&self, pile: &Pile, frames: &[Vec<Pose>], observer: &mut dyn Observer) {
        let Some(late) = self.late.as_ref().filter(|_| observer.wants_frames()) else { return };
        let mut show = |number: usize, time: f64, frame: &[Pose], stage: Stage, states: &[State]| {
            let shown = |((&pose, b), &state): ((&Pose, &Instance), &State)| {
                Some(FrameBody { prop: b.prop, scale: b.scale, pose, state })
            };
            let bodies: Vec<Option<FrameBody>> = frame.iter().zip(&pile.instances).zip(states).map(shown).collect();
            observer.frame(&Frame { stage, number, time, bodies: &bodies, comers: &[] });
        };
        if pile.recorder.keeps() {
            let recorded = &pile.recorder.frames;
            for (number, (frame, (stage, states))) in frames.iter().zip(late).enumerate() {
                // Not those that appear later.
                let here = recorded[number].len().min(frame.len());
                show(number, number as f64 / self.fps, &frame[..here], *stage, states);
            }
        } else if let Some(frame) = frames.last() {
            let time = pile.recorder.count().min(self.last) as f64 / self.fps;
            show(0, time, frame, Stage::Hold, &pile.control.states(&pile.world));
        }
    }
}

/// Shows the recorded frame of this number as the frame that `of` makes of its bodies.
fn send(
    pile: &Pile,
    recorded: usize,
    states: &[State],
    observer: &mut dyn Observer,
    of: impl FnOnce(&[Option<FrameBody>]) -> Frame<'_>,
) {
    let shown = |((pose, b), &state): ((Pose, &Instance), &State)| {
        Some(FrameBody { prop: b.prop, scale: b.scale, pose, state })
    };
    let bodies: Vec<Option<FrameBody>> =
        pile.prop_frame(recorded).zip(&pile.instances).zip(states).map(shown).collect();
    observer.frame(&of(&bodies));
}
