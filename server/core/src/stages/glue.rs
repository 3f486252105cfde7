//! Glue: where friction cannot carry the pile, bodies are glued, and the glued pile is let go to see that it stands.

use crate::equilibrium::glue::{self, GlueError, GlueOptions, Placement};
use crate::error::Error;
use crate::geometry::pose::Pose;
use crate::geometry::region::DistanceGrid;
use crate::geometry::topology::Parts;
use crate::input::observer::{Observer, Progress, Stage, observe};
use crate::input::params::{Params, Switch};
use crate::prepare::effects::{EffectName, Resolved};
use crate::sim::glue::{Dot, Glue, Sites};
use crate::sim::step::Simulation;
use crate::world::{BodyId, Side, World};
use glam::{DQuat, DVec3};
use std::collections::BTreeSet;
use std::ops::ControlFlow;

/// For how long the glued pile is let go, natural times.
const PROOF_TIME: f64 = 20.0;
/// A body has moved if it did by more than this, d.
const MOVED: f64 = 0.25;
/// The pile stands if no larger share of its bodies has moved.
pub const MOST_MOVED: f64 = 0.01;
/// It leans as a whole, on a foot that is too narrow, if its bodies have moved by more than this in the mean, d.
const LEANS: f64 = 0.03;
/// It fails in places if no larger share has moved.
const IN_PLACES: f64 = 0.2;
/// It plainly does not stand if a larger share of its bodies has moved.
const COLLAPSED: f64 = 0.4;
/// The friction factor of each attempt, against the one that is asked for.
const ATTEMPTS: [f64; 5] = [1.0, 0.7, 0.5, 0.5, 0.5];
/// What still moves then is fastened to all that it touches, so many times; what moves next, too.
const FASTENINGS: usize = 3;
/// The ground tilts by this much to four sides, degrees.
const TILT: f64 = 5.0;
/// Steps of the proof between two looks at what has moved.
const LOOK: u64 = 50;

/// What was glued, and what that proved. Engine units.
#[derive(Clone, Debug)]
pub struct Glued {
    pub dots: Vec<Dot>,
    /// Touches that could have been glued, pegs not counted.
    pub touches: usize,
    /// No choice has fewer dots.
    pub at_least: usize,
    /// Dots across gaps, where no chain of touches joins bodies to the ground, and the widest of those gaps.
    pub bridges: usize,
    pub widest: f64,
    /// Bodies that no touch joins to the ground.
    pub apart: usize,
    /// Bodies that the glue is too weak for.
    pub fallen: usize,
    /// What the certified forces leave unbalanced: sum over the bodies, each by its own weight.
    pub imbalance: f64,
    /// Friction counted by this factor.
    pub factor: f64,
    /// All that touches the ground is glued to it.
    pub anchors_all: bool,
    /// Share of the bodies that moved when the pile was let go, on level ground and on the worst of the tilted ones.
    pub moved: Option<f64>,
    pub moved_tilted: Option<f64>,
    /// Where the bodies were after that, on level ground, and where they would be without glue. Shape `[body]`; `None`: it was not
    /// there, since nothing holds it.
    pub freed: Option<Vec<Option<Pose>>>,
    pub natural: Option<Vec<Option<Pose>>>,
    pub iterations: u64,
    pub proof_steps: u64,
    /// CPU seconds of the proof.
    pub proof_seconds: f64,
}

/// Places the dots of a pile that has been turned over, and glues it. `turn_over`: the same pile again, for the proof.
/// `region`: where glue may be, engine units.
pub fn run<'a>(
    sim: &mut Simulation<'a>,
    turn_over: &dyn Fn() -> Result<Simulation<'a>, Error>,
    region: Option<&DistanceGrid>,
    params: &Params,
    resolved: &Resolved,
    observer: &mut dyn Observer,
) -> Result<Glued, Error> {
    let anchors = params.glue.anchor != Switch::Off;
    let mut sites = Sites::new(&sim.pile.world, region, anchors);
    let proves = resolved.is_on(EffectName::GlueProof);
    let least_limit = params.control.break_limit(params.gravity);
    let mut anchors_all = params.glue.anchor == Switch::On;
    let (mut iterations, mut proof_steps, mut proof_seconds) = (0, 0, 0.0);
    let mut attempts = ATTEMPTS.iter().enumerate().peekable();
    let (mut best, mut least_way): (Option<Glued>, f64) = (None, f64::INFINITY);
    // What moved in the best attempt, and what was not there.
    let (mut moving, mut absent) = (BTreeSet::new(), Vec::new());
    while let Some((number, share)) = attempts.next() {
        let bodies = sites.ids.len();
        let progress =
            |fraction: f64| Progress { stage: Stage::Glue, fraction, bodies, released: 0, at_rest: 0, nails: 0 };
        let begin = number as f64 / ATTEMPTS.len() as f64;
        observe(observer, &progress(begin))?;
        let factor = params.glue.friction_factor * share;
        let options = GlueOptions {
            friction_factor: factor,
            normal_price: params.glue.normal_price,
            strength: Some(resolved.glue_bound).filter(|bound| bound.is_finite()),
        };
        let mut going = || observer.progress(&progress(begin));
        let placement = place(&sites, &options, &mut going)?;
        iterations += placement.iterations;
        // Where nothing is to prove that the foot is wide enough, all of it is glued.
        anchors_all |= anchors && !proves && !placement.dots.is_empty();
        let dots = dots(&sites, &placement, anchors_all, least_limit, params.glue.breaking);
        let gaps = || placement.dots.iter().map(|dot| sites.gaps[dot.touch]).filter(|gap| *gap > 0.0);
        let mut glued = Glued {
            dots,
            touches: sites.real_with(&placement),
            at_least: placement.at_least,
            bridges: gaps().count(),
            widest: gaps().fold(0.0, f64::max),
            apart: sites.apart.len(),
            fallen: placement.fallen.len(),
            imbalance: placement.imbalance,
            factor,
            anchors_all,
            moved: None,
            moved_tilted: None,
            freed: None,
            natural: None,
            iterations,
            proof_steps,
            proof_seconds: 0.0,
        };
        if !proves {
            best = Some(glued);
            break;
        }
        let loose: Vec<BodyId> =
            placement.fallen.iter().map(|&body| sites.ids[body]).chain(sites.apart.iter().copied()).collect();
        let is_last = attempts.peek().is_none();
        let clock = observer.cpu_seconds();
        let mut tell = |part: f64| observe(observer, &progress(begin + part / ATTEMPTS.len() as f64));
        let freed = let_go(turn_over()?, &glued.dots, &loose, DVec3::NEG_Y, is_last, &mut tell)?;
        proof_steps += freed.steps;
        proof_seconds += observer.cpu_seconds() - clock;
        (glued.moved, glued.freed) = (Some(freed.moved), freed.poses);
        // Where it fails in places, friction there counts less; once less friction everywhere does not help, wherever it fails.
        let is_lowest = *share <= ATTEMPTS[ATTEMPTS.len() - 1];
        let distrusts = (freed.moved <= IN_PLACES || is_lowest) && sites.distrust(&freed.who);
        let leans = anchors && freed.way > LEANS;
        let changes = distrusts || !is_lowest || leans && !anchors_all;
        let stands = freed.moved <= MOST_MOVED && freed.way <= LEANS;
        anchors_all |= leans;
        if freed.way < least_way {
            (least_way, best) = (freed.way, Some(glued));
            (moving, absent) = (freed.who.iter().copied().collect(), loose);
        }
        if stands || !changes {
            break;
        }
    }
    let mut glued = best.ok_or_else(|| Error::Internal("no dots were placed".into()))?;
    // Glue of bounded strength is not to make up for its bound.
    let fastenings = if resolved.glue_bound.is_finite() { 0 } else { FASTENINGS };
    let mut dots = glued.dots.clone();
    for _ in 0..fastenings {
        let more = fasten(&sites, &dots, &moving, least_limit);
        if more.is_empty() || glued.moved.is_none_or(|moved| moved <= MOST_MOVED) {
            break;
        }
        dots.extend(more);
        let progress =
            Progress { stage: Stage::Glue, fraction: 1.0, bodies: sites.ids.len(), released: 0, at_rest: 0, nails: 0 };
        let clock = observer.cpu_seconds();
        let mut tell = |_: f64| observe(observer, &progress);
        let freed = let_go(turn_over()?, &dots, &absent, DVec3::NEG_Y, true, &mut tell)?;
        proof_steps += freed.steps;
        proof_seconds += observer.cpu_seconds() - clock;
        moving.extend(freed.who);
        if freed.way < least_way {
            least_way = freed.way;
            (glued.dots, glued.moved, glued.freed) = (dots.clone(), Some(freed.moved), freed.poses);
        }
    }
    if params.glue.proof == Switch::On && proves {
        let clock = observer.cpu_seconds();
        let loose: Vec<BodyId> = sites.apart.clone();
        let bodies = sites.ids.len();
        let progress = Progress { stage: Stage::Glue, fraction: 1.0, bodies, released: 0, at_rest: 0, nails: 0 };
        let mut tell = |_: f64| observe(observer, &progress);
        let natural = let_go(turn_over()?, &[], &loose, DVec3::NEG_Y, true, &mut tell)?;
        proof_steps += natural.steps;
        glued.natural = natural.poses;
        let mut worst = 0.0f64;
        for side in [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z] {
            let down = DQuat::from_axis_angle(side, TILT.to_radians()) * DVec3::NEG_Y;
            let freed = let_go(turn_over()?, &glued.dots, &loose, down, false, &mut tell)?;
            proof_steps += freed.steps;
            worst = worst.max(freed.moved);
        }
        glued.moved_tilted = Some(worst);
        proof_seconds += observer.cpu_seconds() - clock;
    }
    (glued.iterations, glued.proof_steps, glued.proof_seconds) = (iterations, proof_steps, proof_seconds);
    let breaks = resolved.is_on(EffectName::Breaking);
    sim.pile.glue = Glue::new(glued.dots.clone(), breaks, &mut sim.pile.world, &mut sim.pile.policy);
    Ok(glued)
}

fn place(sites: &Sites, options: &GlueOptions, going: &mut dyn FnMut() -> ControlFlow<()>) -> Result<Placement, Error> {
    glue::place(&sites.problem(DVec3::NEG_Y), options, going).map_err(|error| match error {
        GlueError::Cancelled => Error::Cancelled,
        other => Error::Internal(other.to_string()),
    })
}

/// The dots of a placement, engine units; and, where the foot is too narrow, dots at all that touches the ground.
/// `least_limit`: what each dot carries at least before it breaks.
pub fn dots(sites: &Sites, placement: &Placement, anchors_all: bool, least_limit: f64, breaking: f64) -> Vec<Dot> {
    let pile = sites.problem(DVec3::NEG_Y);
    let dot = |touch: usize, force: DVec3, moment: DVec3| sites.dot(touch, force, moment, least_limit, breaking);
    let mut dots: Vec<Dot> = placement.dots.iter().map(|d| dot(d.touch, d.force, d.moment)).collect();
    if anchors_all {
        let chosen = |touch: usize| placement.dots.iter().any(|d| d.touch == touch);
        let stands = |touch: usize| placement.fallen.binary_search(&pile.touches[touch].body).is_err();
        let feet = (0..pile.touches.len()).filter(|&t| {
            let is_foot =
                matches!(sites.between[t].1, Side::Ground | Side::Scenery) && !pile.touches[t].contacts.is_empty();
            is_foot && !chosen(t) && stands(t)
        });
        dots.extend(feet.map(|touch| dot(touch, DVec3::ZERO, DVec3::ZERO)));
    }
    dots
}

/// More dots, so that each of these bodies is one solid with all that it touches. They carry nothing in the certified equilibrium:
/// they hold against what no statics knows, such as bodies that the fill left pressed into each other.
fn fasten(sites: &Sites, dots: &[Dot], moving: &BTreeSet<BodyId>, limit: f64) -> Vec<Dot> {
    let pile = sites.problem(DVec3::NEG_Y);
    // All that stands still is one more set.
    let still = sites.ids.len();
    let index = |id: BodyId| sites.ids.binary_search(&id).unwrap_or(still);
    let mut solids = Parts::new(still + 1);
    for dot in dots {
        solids.join(index(dot.a), dot.b.map_or(still, index));
    }
    let mut more = Vec::new();
    for (touch, site) in pile.touches.iter().enumerate() {
        let (a, b) = (site.body, site.other.unwrap_or(still));
        let moves = |body: usize| sites.ids.get(body).is_some_and(|id| moving.contains(id));
        if site.may && !site.contacts.is_empty() && (moves(a) || moves(b)) && solids.find(a) != solids.find(b) {
            solids.join(a, b);
            more.push(sites.dot(touch, DVec3::ZERO, DVec3::ZERO, limit, 1.0));
        }
    }
    more
}

/// What a pile did, left to itself.
pub struct LetGo {
    /// Share of the bodies that have moved by more than d/4.
    pub moved: f64,
    /// Those that have, rising.
    pub who: Vec<BodyId>,
    /// How far the bodies have moved in the mean, d.
    pub way: f64,
    /// Where the bodies are in the end, engine units; `None` where it was ended early. Shape `[body]`; `None`: not there.
    pub poses: Option<Vec<Option<Pose>>>,
    pub steps: u64,
}

/// Lets a pile with these dots go for 20 natural times, awake, without any control; `loose` bodies are not there. Unless it is to go
/// `to_the_end`, it ends early where the pile plainly does not stand.
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
    for step in 1..=steps {
        world.step();
        if step % LOOK == 0 || step == steps {
            tell(step as f64 / steps as f64)?;
            let (who, moved, way) = moved(world, &before);
            if step == steps || moved > COLLAPSED && !to_the_end {
                let poses = (step == steps).then(|| poses(world));
                // What was not waited for counts as the most that it could be.
                let way = if step == steps { way } else { 2.0 - step as f64 / steps as f64 };
                return Ok(LetGo { moved, who, way, poses, steps: step });
            }
        }
    }
    Ok(LetGo { moved: 0.0, who: Vec::new(), way: 0.0, poses: Some(before), steps: 0 })
}

/// The bodies that have moved, their share, and how far all have in the mean, d. What flew away counts as 1 d.
fn moved(world: &World, before: &[Option<Pose>]) -> (Vec<BodyId>, f64, f64) {
    let way = |id: BodyId| before[id].map_or(0.0, |pose| world.pose(id).translation.distance(pose.translation));
    let who: Vec<BodyId> = world.present().filter(|&id| way(id) > MOVED).collect();
    let count = world.present().count().max(1) as f64;
    let share = who.len() as f64 / count;
    (who, share, world.present().map(|id| way(id).min(1.0)).sum::<f64>() / count)
}

fn poses(world: &World) -> Vec<Option<Pose>> {
    let pose = |id: BodyId| world.is_present(id).then(|| world.pose(id));
    (0..world.bodies().len()).map(pose).collect()
}
