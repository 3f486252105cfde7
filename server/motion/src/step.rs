//! One step of a pile, as a list of stages in their order.
//!
//! | stage | reads | writes |
//! | --- | --- | --- |
//! | events | events of the scene that are due | bodies, poses of moving scenery, roles, the control's end |
//! | withdrawal | since when the control is withdrawn | where the control acts, its end, the latest event |
//! | control | contact pairs, poses, speeds | verdicts, supports, roles, reasons for resistance, friction |
//! | policy | reasons | resistance |
//! | engine | all of the world | poses, velocities, contacts; bodies that the guard sets aside |
//! | fallen | heights | bodies that are gone |
//! | breaking | loads of the step | supports, glue, roles; reasons for resistance, for the next step |
//! | record | poses | the number of the step; frames, their observer |
//! | progress | roles, speeds | the top speed, counts, the caller's progress |
//!
//! Only [`Policy`](super::policy::Policy) writes roles, friction and resistance, whichever stage has the reason; only a
//! body that is removed from the world gets its role there. Between steps, the stages of the bake release layers, and
//! quiet or end the hold.

pub use super::events::Departure;
use super::events::Events;
use super::frame_publisher::FramePublisher;
use super::guard::Guard;
use super::pile::{Pile, REST_SPEED};
use cairn_engine::world::{BodyId, Role};
use cairn_geometry::pose::Pose;
use cairn_input::error::Error;
use cairn_input::observer::{Observer, Progress, Stage, observe};
use cairn_input::params::Params;
use strum::VariantArray;

/// The stages of a step, in their order: [`Simulation::advance`] takes them as they stand here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::VariantArray)]
pub enum StepStage {
    Events,
    Withdrawal,
    Control,
    Policy,
    Engine,
    Fallen,
    Breaking,
    Record,
    Progress,
}

/// CPU seconds so far, by stage of a step.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seconds([f64; StepStage::VARIANTS.len()]);

impl Seconds {
    fn add(&mut self, stage: StepStage, seconds: f64) {
        self.0[stage as usize] += seconds;
    }

    fn of(&self, stages: &[StepStage]) -> f64 {
        stages.iter().map(|&stage| self.0[stage as usize]).sum()
    }

    /// CPU seconds of analysis, candidates and supports.
    pub fn control(&self) -> f64 {
        self.of(&[StepStage::Control, StepStage::Policy, StepStage::Breaking])
    }

    /// CPU seconds of the engine's steps and of their checks.
    pub fn engine(&self) -> f64 {
        self.of(&[StepStage::Engine, StepStage::Fallen])
    }

    /// CPU seconds of frames.
    pub fn frames(&self) -> f64 {
        self.of(&[StepStage::Record])
    }
}

/// A pile, and all that acts on it in each step.
pub struct Simulation<'a> {
    pub pile: Pile<'a>,
    pub guard: Guard,
    events: Events<'a>,
    show: FramePublisher,
    /// Without a ground: height below which bodies (by center of mass) are set aside, engine units.
    depth: Option<f64>,
    /// Bodies set aside so.
    pub fallen: usize,
    /// Largest speed of any body in the latest step, d per characteristic time.
    pub top_speed: f64,
    /// Bodies that were not at rest in it.
    pub moving: usize,
    pub seconds: Seconds,
    /// The observer does not see the frames: others take their place.
    pub hides_frames: bool,
}

impl<'a> Simulation<'a> {
    /// `pile`: turned over, with all bodies of the beginning. `depth`: below it, engine units, bodies have fallen past
    /// all of the scene. `settles_first`: nothing happens and no frame is recorded until [`Simulation::begin`].
    pub fn new(
        mut pile: Pile<'a>,
        guard: Guard,
        depth: Option<f64>,
        params: &Params,
        settles_first: bool,
    ) -> Result<Simulation<'a>, Error> {
        let events = Events::new(&mut pile, params, settles_first)?;
        pile.recorder.restart(&pile.world);
        pile.recorder.waits = settles_first;
        let show = FramePublisher::new(&params.output);
        let seconds = Seconds::default();
        Ok(Simulation {
            pile,
            guard,
            events,
            show,
            depth,
            fallen: 0,
            top_speed: 0.0,
            moving: 0,
            seconds,
            hides_frames: false,
        })
    }

    /// Frame 0 is now: what waited for it begins.
    pub fn begin(&mut self, observer: &mut dyn Observer) -> Result<(), Error> {
        self.pile.policy.set_quiet(0.0);
        self.pile.latest_event = self.pile.step;
        self.events.begin(&mut self.pile)?;
        self.pile.recorder.restart(&self.pile.world);
        self.show(observer, Stage::Hold);
        Ok(())
    }

    /// The step at which frame 0 was.
    pub fn first_step(&self) -> u64 {
        self.events.first_step()
    }

    /// No event and no end of the control is to come.
    pub fn is_left_alone(&self) -> bool {
        !self.pile.withdrawal.is_under_way() && self.events.are_over()
    }

    /// Time so far, s after frame 0.
    pub fn seconds_so_far(&self) -> f64 {
        self.events.now(&self.pile)
    }

    /// Takes a body out of the world, from where it leaves on this way. The others are free to move.
    pub fn take_away(&mut self, id: BodyId, way: Departure) {
        self.pile.disturb();
        self.pile.motion.expect_collapse();
        self.pile.policy.set_quiet(0.0);
        self.pile.world.remove(id);
        self.events.take_away(&mut self.pile, id, way);
    }

    /// Shows the frames that were recorded since.
    pub fn show(&mut self, observer: &mut dyn Observer, stage: Stage) {
        if self.pile.recorder.waits || self.hides_frames {
            return;
        }
        self.show.run(&self.pile, observer, stage);
    }

    /// From now on, frames are not shown before [`Simulation::publish`].
    pub fn show_late(&mut self) {
        self.show.wait();
    }

    /// Shows the frames that have waited, as the result has them.
    pub fn publish(&self, frames: &[Vec<Pose>], observer: &mut dyn Observer) {
        if !self.hides_frames {
            self.show.publish(&self.pile, frames, observer);
        }
    }

    /// Shows the final pose where no frames are kept.
    pub fn show_end(&self, observer: &mut dyn Observer, stage: Stage) {
        self.show.end(&self.pile, observer, stage);
    }

    /// One step. `stage`: of the bake; `fraction`: its progress, 0 to 1.
    pub fn advance(
        &mut self,
        observer: &mut dyn Observer,
        stage: Stage,
        fraction: impl Fn(&Simulation) -> f64,
    ) -> Result<(), Error> {
        let mut begin = observer.cpu_seconds();
        for &step_stage in StepStage::VARIANTS {
            match step_stage {
                StepStage::Events => self.events.before_step(&mut self.pile)?,
                StepStage::Withdrawal => self.withdraw(),
                StepStage::Control => self.control(),
                StepStage::Policy => self.pile.policy.apply(&mut self.pile.world),
                StepStage::Engine => {
                    self.pile.motion.before_step(&self.pile.world);
                    self.guard.step(&mut self.pile.world)?;
                    self.pile.motion.after_step(&self.pile.world);
                }
                StepStage::Fallen => self.set_fallen_aside(),
                StepStage::Breaking => self.break_overloaded(),
                StepStage::Record => self.record(observer, stage),
                StepStage::Progress => self.report_progress(observer, stage, &fraction)?,
            }
            let end = observer.cpu_seconds();
            self.seconds.add(step_stage, end - begin);
            begin = end;
        }
        Ok(())
    }

    fn withdraw(&mut self) {
        let pile = &mut self.pile;
        if pile.withdrawal.is_under_way() {
            let Pile { world, policy, control, withdrawal, step, .. } = pile;
            withdrawal.before_step(*step, world, policy, control);
            pile.latest_event = pile.step;
        }
    }

    fn control(&mut self) {
        let Pile { world, policy, control, motion, step, .. } = &mut self.pile;
        let freed = control.free_before_hits(world, policy);
        if !freed.is_empty() {
            motion.expect_collapse();
            freed.into_iter().for_each(|id| motion.disturb(id));
        }
        if control.is_due(*step) {
            control.cycle(world, policy, &motion.rested());
        }
    }

    fn set_fallen_aside(&mut self) {
        let Some(depth) = self.depth else { return };
        let world = &mut self.pile.world;
        for id in world.present().collect::<Vec<_>>() {
            if world.pose(id).translation.y < depth {
                world.remove(id);
                self.fallen += 1;
            }
        }
    }

    fn break_overloaded(&mut self) {
        let Pile { world, policy, control, glue, motion, .. } = &mut self.pile;
        let let_go = control.break_overloaded(world, policy);
        let unglued = glue.break_overloaded(world, policy);
        unglued.iter().for_each(|&id| control.release(id));
        motion.expect_falls(let_go.into_iter().chain(unglued));
    }

    fn record(&mut self, observer: &mut dyn Observer, stage: Stage) {
        self.pile.step += 1;
        let Pile { recorder, world, motion, carried, .. } = &mut self.pile;
        let before = recorder.count();
        recorder.step(world);
        if recorder.count() > before {
            motion.hanging.look(world, carried);
        }
        self.show(observer, stage);
    }

    fn report_progress(
        &mut self,
        observer: &mut dyn Observer,
        stage: Stage,
        fraction: &impl Fn(&Simulation) -> f64,
    ) -> Result<(), Error> {
        let world = &self.pile.world;
        self.top_speed = world.present().map(|id| world.speed(id)).fold(0.0, f64::max);
        self.pile.counters.active_body_steps += world.present().filter(|&id| world.is_awake(id)).count() as u64;
        let bodies = world.present().count();
        let released = bodies - world.count(Role::Waiting);
        let at_rest = world.present().filter(|&id| world.speed(id) < REST_SPEED).count();
        self.moving = bodies - at_rest;
        let nails = world.nail_count();
        let fraction = fraction(self).clamp(0.0, 1.0);
        observe(observer, &Progress { stage, fraction, bodies, released, at_rest, nails, frames: 0 })
    }
}
