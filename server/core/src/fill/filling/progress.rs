//! Progress and frames of a fill, for its observer.

use super::FillTask;
use crate::fill::world::FillWorld;
use cairn_engine::world::BodyId;
use cairn_input::error::Error;
use cairn_input::observer::{Frame, FrameBody, Observer, Progress, Stage, State, observe};

/// The usual work of a fill: body-times simulated, in characteristic times times the expected bodies.
const USUAL_WORK: f64 = 15.0;
/// Progress when the usual work is done; the rest is for fills that take longer.
const USUAL_END: f64 = 0.9;

pub struct FillProgress {
    /// Bodies simulated so far, times characteristic times.
    work: f64,
    /// Number of the next frame; `None` where no frames are shown.
    next_frame: Option<usize>,
}

impl FillProgress {
    pub fn new(with_frames: bool) -> FillProgress {
        FillProgress { work: 0.0, next_frame: with_frames.then_some(0) }
    }

    /// After a step.
    pub fn step(&mut self, task: &FillTask, world: &FillWorld, observer: &mut dyn Observer) -> Result<(), Error> {
        self.show_frame(task, world, observer);
        let bodies = world.loose().count();
        self.work += bodies as f64 * world.step_length();
        let share = self.work / (USUAL_WORK * task.expected as f64);
        let beyond = (1.0 - USUAL_END) * (1.0 - 1.0 / share.max(1.0));
        report(bodies, (USUAL_END * share.min(1.0) + beyond).min(LAST), observer)
    }

    /// Shows the bodies at the frame rate, at the end of the step that a frame falls into.
    fn show_frame(&mut self, task: &FillTask, world: &FillWorld, observer: &mut dyn Observer) {
        let Some(number) = self.next_frame.filter(|_| observer.wants_frames()) else { return };
        let time = world.steps() as f64 * world.step_length() * task.units.time;
        if time * task.params.output.fps < number as f64 {
            return;
        }
        let shown = |id: BodyId| {
            let (prop, scale) = (world.body(id).prop, world.body(id).scale);
            world.is_present(id).then(|| FrameBody {
                prop,
                scale,
                pose: task.shapes[prop].prop_pose(&task.units.pose_to_si(&world.pose(id)), scale),
                state: State::Free,
            })
        };
        let bodies: Vec<Option<FrameBody>> = (0..world.next_id()).map(shown).collect();
        observer.frame(&Frame { stage: Stage::Fill, number, time, bodies: &bodies, comers: &[] });
        self.next_frame = Some(number + 1);
    }
}

/// Progress of a fill that has not ended.
pub const LAST: f64 = 0.99;

pub fn report(bodies: usize, fraction: f64, observer: &mut dyn Observer) -> Result<(), Error> {
    observe(observer, &Progress { stage: Stage::Fill, fraction, bodies, released: 0, at_rest: 0, nails: 0, frames: 0 })
}
