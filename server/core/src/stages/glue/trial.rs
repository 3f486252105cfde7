//! A trial: the glued pile is released without control, and its motion is measured.

use super::policy::{LOOK, MOST_MOVED, MOVED, STILL, STILL_LOOKS, TRIAL_TIME};
use crate::error::Error;
use crate::geometry::RESOLUTION;
use crate::geometry::pose::Pose;
use crate::input::observer::{Observer, Progress, Stage, observe};
use crate::sim::glue::{Joint, PileGlue};
use crate::sim::step::Simulation;
use crate::world::{BodyId, World};
use glam::DVec3;

/// Motion of a released pile.
#[derive(Default)]
pub struct TrialResult {
    /// Share of the bodies that have moved by more than [`MOVED`].
    pub moved: f64,
    /// The bodies that have moved by more than [`MOVED`], ascending.
    pub moved_bodies: Vec<BodyId>,
    /// The bodies that have moved by more than the figures resolve ([`RESOLUTION`]), ascending.
    pub moved_a_little: Vec<BodyId>,
    /// Mean displacement of the bodies, d.
    pub displacement: f64,
    /// Final poses of the bodies, engine units; `None` if the trial ended early. Shape `[body]`; `None`: the body was
    /// left out.
    pub poses: Option<Vec<Option<Pose>>>,
    pub steps: u64,
}

/// Runs trials, and counts their cost.
pub struct Trials<'p, 'a> {
    turn_over: &'p dyn Fn() -> Result<Simulation<'a>, Error>,
    bodies: usize,
    /// Progress when a trial begins, and at the end of the attempt: each trial takes half of the rest.
    pub begin: f64,
    pub end: f64,
    pub steps: u64,
    /// CPU seconds.
    pub seconds: f64,
}

impl<'p, 'a> Trials<'p, 'a> {
    pub fn new(turn_over: &'p dyn Fn() -> Result<Simulation<'a>, Error>, bodies: usize) -> Trials<'p, 'a> {
        Trials { turn_over, bodies, begin: 0.0, end: 0.0, steps: 0, seconds: 0.0 }
    }

    pub fn progress(&self, part: f64) -> Progress {
        let fraction = self.begin + part * (self.end - self.begin) / 2.0;
        Progress { stage: Stage::Glue, fraction, bodies: self.bodies, released: 0, at_rest: 0, nails: 0, frames: 0 }
    }

    /// One trial of a pile that is turned over again.
    pub fn run(
        &mut self,
        joints: &[Joint],
        absent: &[BodyId],
        down: DVec3,
        to_the_end: bool,
        observer: &mut dyn Observer,
    ) -> Result<TrialResult, Error> {
        let clock = observer.cpu_seconds();
        let mut report = |part: f64| observe(observer, &self.progress(part));
        let trial = release_trial((self.turn_over)()?, joints, absent, down, to_the_end, &mut report)?;
        self.begin = self.progress(1.0).fraction;
        self.steps += trial.steps;
        self.seconds += observer.cpu_seconds() - clock;
        Ok(trial)
    }
}

/// Releases a pile with these joints for [`TRIAL_TIME`], awake, without control and without the `absent` bodies. The
/// trial ends early once no body moves, and, unless `to_the_end`, soon after bodies have moved.
pub fn release_trial(
    mut sim: Simulation,
    joints: &[Joint],
    absent: &[BodyId],
    down: DVec3,
    to_the_end: bool,
    report: &mut dyn FnMut(f64) -> Result<(), Error>,
) -> Result<TrialResult, Error> {
    let pile = &mut sim.pile;
    let _glue = PileGlue::new(joints.to_vec(), false, &mut pile.world, &mut pile.policy);
    absent.iter().for_each(|&id| pile.world.remove(id));
    pile.policy.leave_to_physics(&mut pile.world);
    let world = &mut pile.world;
    world.set_gravity(down);
    let before = poses(world);
    let steps = (TRIAL_TIME / world.step_length()).ceil() as u64;
    let (mut failing, mut still, mut latest) = (0, 0, before.clone());
    for step in 1..=steps {
        world.step();
        if step % LOOK == 0 || step == steps {
            report(step as f64 / steps as f64)?;
            let mut trial = look(world, &before, step);
            failing += u64::from(trial.moved > MOST_MOVED);
            if step == steps {
                trial.poses = Some(poses(world));
                return Ok(trial);
            }
            if failing > 1 && !to_the_end {
                return Ok(trial);
            }
            let now = poses(world);
            let looks_left = (steps - step) as f64 / LOOK as f64;
            still = if predicted(&latest, &now, looks_left) < STILL { still + 1 } else { 0 };
            latest = now;
            if still == STILL_LOOKS {
                trial.poses = Some(latest);
                return Ok(trial);
            }
        }
    }
    Ok(TrialResult { poses: Some(before), ..TrialResult::default() })
}

/// Farthest displacement of a body in the rest of the trial, at the pace of the latest look, d.
fn predicted(latest: &[Option<Pose>], now: &[Option<Pose>], looks_left: f64) -> f64 {
    let pairs = latest.iter().zip(now).filter_map(|(&latest, &now)| latest.zip(now));
    looks_left * pairs.map(|(latest, now)| latest.translation.distance(now.translation)).fold(0.0, f64::max)
}

/// Displacements so far. The displacement of a body that flew away is limited to 1 d.
fn look(world: &World, before: &[Option<Pose>], steps: u64) -> TrialResult {
    let displacement =
        |id: BodyId| before[id].map_or(0.0, |pose| world.pose(id).translation.distance(pose.translation));
    let beyond = |least: f64| world.present().filter(move |&id| displacement(id) > least).collect::<Vec<BodyId>>();
    let count = world.present().count().max(1) as f64;
    let (moved_bodies, moved_a_little) = (beyond(MOVED), beyond(RESOLUTION));
    let mean = world.present().map(|id| displacement(id).min(1.0)).sum::<f64>() / count;
    let moved = moved_bodies.len() as f64 / count;
    TrialResult { moved, moved_bodies, moved_a_little, displacement: mean, poses: None, steps }
}

fn poses(world: &World) -> Vec<Option<Pose>> {
    let pose = |id: BodyId| world.is_present(id).then(|| world.pose(id));
    (0..world.bodies().len()).map(pose).collect()
}
