//! A trial: the glued pile is released without control, and its motion is measured.

use super::policy::{FADES, LEANS, LOOK, MOST_MOVED, MOVED, SAGS, STILL, STILL_LOOKS, SURELY, TRIAL_TIME};
use cairn_engine::world::{BodyId, World};
use cairn_geometry::RESOLUTION;
use cairn_geometry::pose::Pose;
use cairn_input::error::Error;
use cairn_input::observer::{Observer, Progress, Stage, observe};
use cairn_input::params::ProofEngine;
use cairn_motion::glue::{Joint, PileGlue};
use cairn_motion::pile::Pile;
use cairn_motion::policy::Policy;
use glam::DVec3;
use std::collections::BTreeSet;

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
    /// Displacement of each body, d. Shape `[body]`; 0: the body was left out.
    pub ways: Vec<f64>,
    /// The pile surely stands, or the whole time is over: the trial did not end early.
    pub is_whole: bool,
    /// Poses of the bodies at its end, engine units. Shape `[body]`; `None`: the body was left out.
    pub poses: Vec<Option<Pose>>,
    pub steps: u64,
}

impl TrialResult {
    pub fn stands(&self) -> bool {
        self.is_whole && super::stands(Some(self.moved), self.displacement)
    }

    /// Final poses, unless the trial ended early.
    pub fn final_poses(&self) -> Poses {
        self.is_whole.then(|| self.poses.clone())
    }

    /// Where a point that belonged to a body is at the end of the trial. `before`: the pile before it.
    pub fn moved_point(&self, id: BodyId, point: DVec3, before: &World) -> DVec3 {
        let Some(now) = self.poses.get(id).copied().flatten() else { return point };
        let then = before.pose(id);
        now.transform_point(then.rotation.inverse() * (point - then.translation))
    }

    /// The worse of two trials of the same pile, with the poses of this one.
    fn and(self, other: &TrialResult) -> TrialResult {
        let both = |a: &[BodyId], b: &[BodyId]| BTreeSet::from_iter(a.iter().chain(b).copied()).into_iter().collect();
        TrialResult {
            moved: self.moved.max(other.moved),
            moved_bodies: both(&self.moved_bodies, &other.moved_bodies),
            moved_a_little: both(&self.moved_a_little, &other.moved_a_little),
            displacement: self.displacement.max(other.displacement),
            ways: self.ways.iter().zip(&other.ways).map(|(a, b)| a.max(*b)).collect(),
            steps: self.steps + other.steps,
            is_whole: self.is_whole,
            poses: self.poses,
        }
    }
}

/// Final poses of the bodies, engine units; `None` if the trial ended early. Shape `[body]`; `None`: the body was left
/// out.
pub type Poses = Option<Vec<Option<Pose>>>;

/// When a trial ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ends<'h> {
    /// Once the pile surely falls, or surely stands.
    Soon,
    /// Once the pile surely stands, or surely falls with nearly all bodies of its heaps. The heap of each body.
    WithHeaps(&'h [BodyId]),
    /// Once the pile surely stands.
    Late,
}

/// How a trial is watched.
#[derive(Clone, Copy, Debug)]
pub struct Watch<'h> {
    pub ends: Ends<'h>,
    /// Of the bodies in the mean, up to which a forecast shows that the pile stands, d.
    pub most_displacement: f64,
}

impl Ends<'_> {
    /// Whether the trial of a pile that surely falls ends. `present`: of its bodies. `ways`: their displacements.
    fn is_over(self, present: &[BodyId], ways: &[f64]) -> bool {
        match self {
            Ends::Soon => true,
            Ends::WithHeaps(heaps) => {
                standing(heaps, present, |id| ways[id] > SAGS).len() as f64 <= MOST_MOVED * present.len() as f64
            }
            Ends::Late => false,
        }
    }
}

/// Bodies of the heaps in which none has moved.
pub fn standing(heaps: &[BodyId], present: &[BodyId], has_moved: impl Fn(BodyId) -> bool) -> BTreeSet<BodyId> {
    let falling: BTreeSet<BodyId> = present.iter().filter(|&&id| has_moved(id)).map(|&id| heaps[id]).collect();
    present.iter().copied().filter(|&id| !falling.contains(&heaps[id])).collect()
}

/// Runs trials, and counts their cost.
pub struct Trials<'p, 'a> {
    /// The pile as it is turned over: each trial begins with a copy.
    pub pile: &'p Pile<'a>,
    /// The same world as other engines have it, once a trial has asked for it.
    any_engine: Option<World>,
    bodies: usize,
    pub engine: ProofEngine,
    /// As in [`Watch`].
    pub most_displacement: f64,
    /// Progress when a trial begins, and at the end of the attempt: each trial takes half of the rest.
    pub begin: f64,
    pub end: f64,
    pub steps: u64,
    /// CPU seconds.
    pub seconds: f64,
}

impl<'p, 'a> Trials<'p, 'a> {
    pub fn new(pile: &'p Pile<'a>, engine: ProofEngine) -> Trials<'p, 'a> {
        let bodies = pile.world.present().count();
        let most_displacement = LEANS.min(SAGS);
        Trials {
            pile,
            any_engine: None,
            bodies,
            engine,
            most_displacement,
            begin: 0.0,
            end: 0.0,
            steps: 0,
            seconds: 0.0,
        }
    }

    pub fn progress(&self, part: f64) -> Progress {
        let fraction = self.begin + part * (self.end - self.begin) / 2.0;
        Progress { stage: Stage::Glue, fraction, bodies: self.bodies, released: 0, at_rest: 0, nails: 0, frames: 0 }
    }

    /// A trial of the pile. Where other engines count, the pile first stands as in them, and
    /// then in its own: the bodies are a little smaller there.
    pub fn run(
        &mut self,
        joints: &[Joint],
        absent: &[BodyId],
        down: DVec3,
        ends: Ends,
        observer: &mut dyn Observer,
    ) -> Result<TrialResult, Error> {
        let trial = self.run_in(self.engine, joints, absent, down, ends, observer)?;
        if self.engine == ProofEngine::Own || !trial.stands() {
            return Ok(trial);
        }
        let own = self.run_in(ProofEngine::Own, joints, absent, down, ends, observer)?;
        Ok(own.and(&trial))
    }

    fn as_any_engine(&mut self) -> &World {
        self.any_engine.get_or_insert_with(|| {
            let mut world = self.pile.world.clone();
            world.act_as_any_engine(self.pile.shapes);
            world
        })
    }

    /// A trial of the pile in one engine.
    pub fn run_in(
        &mut self,
        engine: ProofEngine,
        joints: &[Joint],
        absent: &[BodyId],
        down: DVec3,
        ends: Ends,
        observer: &mut dyn Observer,
    ) -> Result<TrialResult, Error> {
        let clock = observer.cpu_seconds();
        let world = match engine {
            ProofEngine::Own => self.pile.world.clone(),
            ProofEngine::Any => self.as_any_engine().clone(),
        };
        let mut report = |part: f64| observe(observer, &self.progress(part));
        let watch = Watch { ends, most_displacement: self.most_displacement };
        let trial = release_trial(world, self.pile.policy.clone(), joints, absent, down, watch, &mut report)?;
        self.begin = self.progress(1.0).fraction;
        self.steps += trial.steps;
        self.seconds += observer.cpu_seconds() - clock;
        Ok(trial)
    }
}

/// Releases a pile with these joints for [`TRIAL_TIME`] at most, awake, without control and without the `absent`
/// bodies.
pub fn release_trial(
    mut world: World,
    mut policy: Policy,
    joints: &[Joint],
    absent: &[BodyId],
    down: DVec3,
    watch: Watch,
    report: &mut dyn FnMut(f64) -> Result<(), Error>,
) -> Result<TrialResult, Error> {
    let _glue = PileGlue::new(joints.to_vec(), false, &mut world, &mut policy);
    absent.iter().for_each(|&id| world.remove(id));
    policy.leave_to_physics(&mut world);
    world.set_gravity(down);
    let before = poses(&world);
    let present: Vec<BodyId> = world.present().collect();
    let steps = (TRIAL_TIME / world.step_length()).ceil() as u64;
    let (mut failing, mut standing, mut latest) = (0, 0, before.clone());
    let mut fading = Fading::default();
    for step in 1..=steps {
        world.step();
        if step % LOOK == 0 || step == steps {
            report(step as f64 / steps as f64)?;
            let now = poses(&world);
            let mut trial = look(&before, &now, step);
            if step == steps {
                (trial.poses, trial.is_whole) = (now, true);
                return Ok(trial);
            }
            failing += u64::from(trial.moved > MOST_MOVED || trial.displacement > SURELY * SAGS);
            if failing > 1 && watch.ends.is_over(&present, &trial.ways) {
                trial.poses = now;
                return Ok(trial);
            }
            let looks_left = fading.looks(mean_way(&latest, &now)).min((steps - step) as f64 / LOOK as f64);
            let ahead = look(&before, &ahead(&latest, &now, looks_left), step);
            let is_to_stand = ahead.moved <= MOST_MOVED && ahead.displacement <= watch.most_displacement;
            standing = if is_to_stand || farthest(&latest, &now) * looks_left < STILL { standing + 1 } else { 0 };
            latest = now;
            if standing == STILL_LOOKS {
                (trial.poses, trial.is_whole) = (latest, true);
                return Ok(trial);
            }
        }
    }
    Ok(TrialResult { poses: before, is_whole: true, ..TrialResult::default() })
}

/// How motion fades from look to look.
#[derive(Default)]
struct Fading {
    /// Mean way of the bodies between the two latest looks, d.
    pace: Option<f64>,
    /// Its ratio to the one before.
    ratio: Option<f64>,
}

impl Fading {
    /// At the latest pace, how many looks take the bodies as far as they will get, and [`FADES`] times as far, if the
    /// pace goes on falling as it has over the latest three looks.
    fn looks(&mut self, pace: f64) -> f64 {
        let ratio =
            self.pace.replace(pace).map_or(f64::INFINITY, |before| if before > 0.0 { pace / before } else { 1.0 });
        let worst = self.ratio.replace(ratio).map_or(f64::INFINITY, |before| before.max(ratio));
        if worst < 1.0 { FADES * worst / (1.0 - worst) } else { f64::INFINITY }
    }
}

/// Mean way of the bodies between two looks, d.
fn mean_way(latest: &[Option<Pose>], now: &[Option<Pose>]) -> f64 {
    let ways: Vec<f64> = pairs(latest, now).map(|(latest, now)| latest.translation.distance(now.translation)).collect();
    ways.iter().sum::<f64>() / ways.len().max(1) as f64
}

fn pairs<'a>(latest: &'a [Option<Pose>], now: &'a [Option<Pose>]) -> impl Iterator<Item = (Pose, Pose)> + 'a {
    latest.iter().zip(now).filter_map(|(&latest, &now)| latest.zip(now))
}

/// Farthest way of a body between two looks, d.
fn farthest(latest: &[Option<Pose>], now: &[Option<Pose>]) -> f64 {
    pairs(latest, now).map(|(latest, now)| latest.translation.distance(now.translation)).fold(0.0, f64::max)
}

/// Where the bodies will be after so many looks, at the pace of the latest one.
fn ahead(latest: &[Option<Pose>], now: &[Option<Pose>], looks: f64) -> Vec<Option<Pose>> {
    let ahead = |(&latest, &now): (&Option<Pose>, &Option<Pose>)| {
        let (latest, now) = latest.zip(now)?;
        let way = now.translation - latest.translation;
        Some(Pose { translation: now.translation + way * looks, ..now })
    };
    latest.iter().zip(now).map(ahead).collect()
}

/// Displacements so far. The displacement of a body that flew away is limited to 1 d.
fn look(before: &[Option<Pose>], now: &[Option<Pose>], steps: u64) -> TrialResult {
    let way = |(id, (before, now)): (BodyId, (&Option<Pose>, &Option<Pose>))| {
        let (before, now) = before.zip(*now)?;
        Some((id, now.translation.distance(before.translation)))
    };
    let ways: Vec<(BodyId, f64)> = before.iter().zip(now).enumerate().filter_map(way).collect();
    let beyond = |least: f64| ways.iter().filter(|(_, way)| *way > least).map(|(id, _)| *id).collect::<Vec<BodyId>>();
    let count = ways.len().max(1) as f64;
    let mut all = vec![0.0; now.len()];
    ways.iter().for_each(|&(id, way)| all[id] = way);
    let (moved_bodies, moved_a_little) = (beyond(MOVED), beyond(RESOLUTION));
    let mean = ways.iter().map(|(_, way)| way.min(1.0)).sum::<f64>() / count;
    let moved = moved_bodies.len() as f64 / count;
    let found =
        TrialResult { moved, moved_bodies, moved_a_little, displacement: mean, ways: all, ..TrialResult::default() };
    TrialResult { steps, ..found }
}

fn poses(world: &World) -> Vec<Option<Pose>> {
    let pose = |id: BodyId| world.is_present(id).then(|| world.pose(id));
    (0..world.bodies().len()).map(pose).collect()
}
