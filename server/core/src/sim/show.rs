//! Frames for those who watch.

use super::pile::Pile;
use crate::geometry::pose::Pose;
use crate::input::observer::{Frame, Observer, Shown, Stage, State};
use crate::input::params::Output;
use crate::sim::instance::Instance;

/// Shows the frames of a pile, each once.
pub struct Show {
    /// Frames per second.
    fps: f64,
    /// The last frame that the result will have.
    last: usize,
    /// Frames shown.
    shown: usize,
}

impl Show {
    pub fn new(output: &Output) -> Show {
        Show { fps: output.fps, last: output.frames.map_or(usize::MAX, |n| n as usize), shown: 0 }
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
            let number = self.shown;
            let shown = |((pose, b), &state): ((Pose, &Instance), &State)| {
                Some(Shown { prop: b.prop, scale: b.scale, pose, state })
            };
            let poses = pile.prop_frame(number).zip(&pile.instances);
            let bodies: Vec<Option<Shown>> = poses.zip(&states).map(shown).collect();
            let time = number as f64 / self.fps;
            observer.frame(&Frame { stage, number, time, bodies: &bodies });
            self.shown += 1;
        }
    }
}
