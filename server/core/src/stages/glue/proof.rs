//! The proof: a glued pile is let go, to see that it stands.

use crate::error::Error;
use crate::geometry::pose::Pose;
use crate::input::observer::{Observer, Progress, Stage, observe};
use crate::sim::glue::{Dot, Glue};
use crate::sim::step::Simulation;
use crate::world::{BodyId, World};
use glam::DVec3;

/// For how long the glued pile is let go at most, natural times.
const PROOF_TIME: f64 = 20.0;
/// A body has moved if it did by more than this, d.
const MOVED: f64 = 0.25;
/// It has stirred if it did by more than this, d.
const STIRRED: f64 = 0.1;
/// The pile stands if no larger share of its bodies has moved.
pub const MOST_MOVED: f64 = 0.01;
/// It leans as a whole, on a foot that is too narrow, if its bodies have moved by more than this in the mean, d.
pub const LEANS: f64 = 0.03;
/// It fails in few places if no larger share has moved.
pub const IN_PLACES: f64 = 0.1;
/// It plainly does not stand if a larger share of its bodies has moved.
const COLLAPSED: f64 = 0.4;
/// It sags, and a little more would bring it down, if its bodies have moved by more than this in the mean, d.
pub const SAGS: f64 = 0.06;
/// Steps between two looks at what has moved.
const LOOK: u64 = 25;
/// Once so many looks in a row find that nobody would get farther than this in what is left of the time, d, nothing more is to be
/// learnt.
const STILL_LOOKS: u32 = 3;
const STILL: f64 = 0.02;

/// What a pile did, left to itself.
#[derive(Default)]
pub struct LetGo {
    /// Share of the bodies that have moved by more than d/4.
    pub moved: f64,
    /// Those that have, rising.
    pub who: Vec<BodyId>,
    /// Those that have moved by more than d/10, rising.
    pub stirred: Vec<BodyId>,
    /// How far the bodies have moved in the mean, d.
    pub way: f64,
    /// Where the bodies are in the end, engine units; `None` where it was ended early. Shape `[body]`; `None`: not there.
    pub poses: Option<Vec<Option<Pose>>>,
    pub steps: u64,
}

/// Proves, and counts what that takes.
pub struct Proving<'p, 'a> {
    turn_over: &'p dyn Fn() -> Result<Simulation<'a>, Error>,
    bodies: usize,
    /// Progress when the proof begins, and at the end of the attempt: each proof takes half of what is left of it.
    pub begin: f64,
    pub end: f64,
    pub steps: u64,
    /// CPU seconds.
    pub seconds: f64,
}

impl<'p, 'a> Proving<'p, 'a> {
    pub fn new(turn_over: &'p dyn Fn() -> Result<Simulation<'a>, Error>, bodies: usize) -> Proving<'p, 'a> {
        Proving { turn_over, bodies, begin: 0.0, end: 0.0, steps: 0, seconds: 0.0 }
    }

    pub fn progress(&self, part: f64) -> Progress {
        let fraction = self.begin + part * (self.end - self.begin) / 2.0;
        Progress { stage: Stage::Glue, fraction, bodies: self.bodies, released: 0, at_rest: 0, nails: 0 }
    }

    pub fn prove(
        &mut self,
        dots: &[Dot],
        absent: &[BodyId],
        down: DVec3,
        to_the_end: bool,
        observer: &mut dyn Observer,
    ) -> Result<LetGo, Error> {
        let clock = observer.cpu_seconds();
        let mut tell = |part: f64| observe(observer, &self.progress(part));
        let freed = let_go((self.turn_over)()?, dots, absent, down, to_the_end, &mut tell)?;
        self.begin = self.progress(1.0).fraction;
        self.steps += freed.steps;
        self.seconds += observer.cpu_seconds() - clock;
        Ok(freed)
    }
}

/// Lets a pile with these dots go for 20 natural times, awake, without any control; `loose` bodies are not there. It ends early
/// once nothing moves any more; and, unless it is to go `to_the_end`, where the pile plainly does not stand: soon after the first bodies
/// have moved.
pub fn let_go(
    mut sim: Simulation,
    dots: &[Dot],
    loose: &[BodyId],
    down: DVec3,
    to_the_end: bool,
    tell: &mut dyn FnMut(f64) -> Result<(), Error>,
) -> Result<LetGo, Error> {
    let pile = &mut sim.pile;
    let _glue = Glue::new(dots.to_vec(), false, &mut pile.world, &mut pile.policy);
    loose.iter().for_each(|&id| pile.world.remove(id));
    pile.policy.leave_to_physics(&mut pile.world);
    let world = &mut pile.world;
    world.set_gravity(down);
    let before = poses(world);
    let steps = (PROOF_TIME / world.step_length()).ceil() as u64;
    let (mut failing, mut still, mut latest) = (0, 0, before.clone());
    for step in 1..=steps {
        world.step();
        if step % LOOK == 0 || step == steps {
            tell(step as f64 / steps as f64)?;
            let mut freed = look(world, &before, step);
            failing += u64::from(freed.moved > MOST_MOVED);
            if step == steps {
                freed.poses = Some(poses(world));
                return Ok(freed);
            }
            if (freed.moved > COLLAPSED || failing > 1) && !to_the_end {
                return Ok(freed);
            }
            let now = poses(world);
            let looks_left = (steps - step) as f64 / LOOK as f64;
            still = if to_come(&latest, &now, looks_left) < STILL { still + 1 } else { 0 };
            latest = now;
            if still == STILL_LOOKS {
                freed.poses = Some(latest);
                return Ok(freed);
            }
        }
    }
    Ok(LetGo { poses: Some(before), ..LetGo::default() })
}

/// How far anyone would still get, at the pace of the latest look, d.
fn to_come(latest: &[Option<Pose>], now: &[Option<Pose>], looks_left: f64) -> f64 {
    let ways = latest.iter().zip(now).filter_map(|(&latest, &now)| latest.zip(now));
    looks_left * ways.map(|(latest, now)| latest.translation.distance(now.translation)).fold(0.0, f64::max)
}

/// What has moved so far. What flew away counts as 1 d.
fn look(world: &World, before: &[Option<Pose>], steps: u64) -> LetGo {
    let way = |id: BodyId| before[id].map_or(0.0, |pose| world.pose(id).translation.distance(pose.translation));
    let beyond = |least: f64| world.present().filter(move |&id| way(id) > least).collect::<Vec<BodyId>>();
    let count = world.present().count().max(1) as f64;
    let (who, stirred) = (beyond(MOVED), beyond(STIRRED));
    let mean = world.present().map(|id| way(id).min(1.0)).sum::<f64>() / count;
    LetGo { moved: who.len() as f64 / count, who, stirred, way: mean, poses: None, steps }
}

fn poses(world: &World) -> Vec<Option<Pose>> {
    let pose = |id: BodyId| world.is_present(id).then(|| world.pose(id));
    (0..world.bodies().len()).map(pose).collect()
}
