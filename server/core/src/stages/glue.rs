//! Glue: where friction cannot carry the pile, bodies are glued, and the glued pile is let go to see that it stands.

mod proof;

pub use proof::{LetGo, MOST_MOVED, let_go};

use crate::equilibrium::glue::{self, GlueDot, GlueError, GlueOptions, Placement};
use crate::error::Error;
use crate::geometry::pose::Pose;
use crate::geometry::region::DistanceGrid;
use crate::geometry::topology::Parts;
use crate::input::observer::{Observer, Progress, Stage, observe};
use crate::input::params::{Params, Switch};
use crate::prepare::effects::{EffectName, Resolved};
use crate::sim::glue::{Dot, Glue, Sites};
use crate::sim::step::Simulation;
use crate::world::{BodyId, Side};
use glam::{DQuat, DVec3};
use proof::{IN_PLACES, LEANS, SAGS};
use std::collections::BTreeSet;
use std::ops::ControlFlow;

/// The price of normal forces is the one that is asked for, and at least the next of these where the pile fails in many places: dear
/// normal forces let glue carry what stands on paper by wedging alone.
const PRICES: [f64; 4] = [0.0, 0.3, 0.6, 1.0];
const ATTEMPTS: usize = 7;
/// What moves in few places is held without its friction; from this attempt on it is fastened, so many times, and what moves next, too.
const FASTENED_FROM: usize = 5;
const FASTENINGS: usize = 3;
/// The ground tilts by this much to four sides, degrees.
const TILT: f64 = 5.0;

/// What was glued, and what that proved. Engine units.
#[derive(Clone, Debug, Default)]
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
    /// A normal force cost so much, against a dot's as 1.
    pub normal_price: f64,
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
    // Glue of bounded strength is not to make up for its bound.
    let fastens = !resolved.glue_bound.is_finite();
    let mut anchors_all = params.glue.anchor == Switch::On;
    let mut proving = Proving { turn_over, bodies: sites.ids.len(), begin: 0.0, end: 0.0, steps: 0, seconds: 0.0 };
    let mut iterations = 0;
    let mut level = 0;
    let mut known = Vec::new();
    let mut is_last = false;
    let mut best: Option<Attempt> = None;
    for number in 0..ATTEMPTS {
        let of = ATTEMPTS as f64;
        (proving.begin, proving.end) = (number as f64 / of, (number + 1) as f64 / of);
        observe(observer, &proving.progress(0.0))?;
        let normal_price = params.glue.normal_price.max(PRICES[level]);
        let options = GlueOptions {
            friction_factor: params.glue.friction_factor,
            normal_price,
            strength: Some(resolved.glue_bound).filter(|bound| bound.is_finite()),
        };
        let mut going = || observer.progress(&proving.progress(0.0));
        let placement = place(&sites, &options, &known, &mut going)?;
        iterations += placement.iterations;
        // Where nothing is to prove that the foot is wide enough, all of it is glued.
        anchors_all |= anchors && !proves && !placement.dots.is_empty();
        let dots = dots(&sites, &placement, anchors_all, least_limit, params.glue.breaking);
        let gaps = || placement.dots.iter().map(|dot| sites.gaps[dot.touch]).filter(|gap| *gap > 0.0);
        let glued = Glued {
            dots,
            touches: sites.real_with(&placement),
            at_least: placement.at_least,
            bridges: gaps().count(),
            widest: gaps().fold(0.0, f64::max),
            apart: sites.apart.len(),
            fallen: placement.fallen.len(),
            imbalance: placement.imbalance,
            normal_price,
            anchors_all,
            ..Glued::default()
        };
        let absent: Vec<BodyId> =
            placement.fallen.iter().map(|&body| sites.ids[body]).chain(sites.apart.iter().copied()).collect();
        let mut attempt = Attempt { glued, absent, way: f64::INFINITY, moving: BTreeSet::new(), is_fastened: false };
        if !proves {
            best = Some(attempt);
            break;
        }
        is_last |= number + 1 == ATTEMPTS;
        let freed = proving.prove(&attempt.glued.dots, &attempt.absent, DVec3::NEG_Y, is_last, observer)?;
        let leans = anchors && freed.way > LEANS && !anchors_all;
        let sags = freed.way > SAGS && !leans;
        let fails_in_places = freed.moved <= IN_PLACES && !sags;
        attempt.stood(freed);
        let is_dearest = level + 1 == PRICES.len();
        let distrusts = (fails_in_places || is_dearest) && sites.distrust(&attempt.moving);
        let is_to_be_fastened = !leans && (attempt.stands() || number >= FASTENED_FROM || !distrusts);
        if fastens && fails_in_places && is_to_be_fastened {
            proving.fasten(&mut attempt, &sites, least_limit, observer)?;
        }
        let stands = attempt.stands();
        if best.as_ref().is_none_or(|best| attempt.is_as_good_as(best)) {
            best = Some(attempt);
        }
        if is_last || stands && !leans {
            break;
        }
        // Where the next attempt is the same, it shows how this one ends.
        is_last = is_dearest && !distrusts && !leans;
        anchors_all |= leans;
        if fails_in_places || is_dearest {
            known = placement.dots;
        } else {
            level += 1;
            known.clear();
        }
    }
    let mut best = best.ok_or_else(|| Error::Internal("no dots were placed".into()))?;
    proving.end = 1.0;
    if fastens && proves && !best.is_fastened {
        proving.fasten(&mut best, &sites, least_limit, observer)?;
    }
    let mut glued = best.glued;
    if params.glue.proof == Switch::On && proves {
        glued.natural = proving.prove(&[], &sites.apart, DVec3::NEG_Y, true, observer)?.poses;
        let mut worst = 0.0f64;
        for side in [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z] {
            let down = DQuat::from_axis_angle(side, TILT.to_radians()) * DVec3::NEG_Y;
            worst = worst.max(proving.prove(&glued.dots, &sites.apart, down, false, observer)?.moved);
        }
        glued.moved_tilted = Some(worst);
    }
    (glued.iterations, glued.proof_steps, glued.proof_seconds) = (iterations, proving.steps, proving.seconds);
    let breaks = resolved.is_on(EffectName::Breaking);
    sim.pile.glue = Glue::new(glued.dots.clone(), breaks, &mut sim.pile.world, &mut sim.pile.policy);
    Ok(glued)
}

/// A choice of dots, and how the pile stood with them.
struct Attempt {
    glued: Glued,
    /// Bodies that are not there when the pile is let go.
    absent: Vec<BodyId>,
    /// How far the bodies have moved in the mean, d.
    way: f64,
    /// Bodies that have moved, with these dots or fewer.
    moving: BTreeSet<BodyId>,
    is_fastened: bool,
}

impl Attempt {
    fn stands(&self) -> bool {
        self.glued.moved.is_none_or(|moved| moved <= MOST_MOVED && self.way <= SAGS)
    }

    fn is_as_good_as(&self, other: &Attempt) -> bool {
        if self.stands() == other.stands() { self.way <= other.way } else { self.stands() }
    }

    fn stood(&mut self, freed: LetGo) {
        // What was not waited for is worse than all else.
        self.way = if freed.poses.is_some() { freed.way } else { f64::INFINITY };
        self.moving.extend(freed.who);
        (self.glued.moved, self.glued.freed) = (Some(freed.moved), freed.poses);
    }
}

/// Proves, and counts what that takes.
struct Proving<'p, 'a> {
    turn_over: &'p dyn Fn() -> Result<Simulation<'a>, Error>,
    bodies: usize,
    /// Progress when the proof begins, and at the end of the attempt: each proof takes half of what is left of it.
    begin: f64,
    end: f64,
    steps: u64,
    /// CPU seconds.
    seconds: f64,
}

impl Proving<'_, '_> {
    fn progress(&self, part: f64) -> Progress {
        let fraction = self.begin + part * (self.end - self.begin) / 2.0;
        Progress { stage: Stage::Glue, fraction, bodies: self.bodies, released: 0, at_rest: 0, nails: 0 }
    }

    fn prove(
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

    /// Fastens what moves to all that it touches, and what moves next, too; as long as anything does.
    fn fasten(
        &mut self,
        attempt: &mut Attempt,
        sites: &Sites,
        limit: f64,
        observer: &mut dyn Observer,
    ) -> Result<(), Error> {
        attempt.is_fastened = true;
        let (mut dots, mut moving) = (attempt.glued.dots.clone(), attempt.moving.clone());
        for _ in 0..FASTENINGS {
            if attempt.glued.moved == Some(0.0) {
                break;
            }
            let more = fastening(sites, &dots, &moving, limit);
            if more.is_empty() {
                break;
            }
            dots.extend(more);
            let freed = self.prove(&dots, &attempt.absent, DVec3::NEG_Y, true, observer)?;
            moving.extend(&freed.who);
            if freed.way < attempt.way {
                attempt.glued.dots.clone_from(&dots);
                attempt.stood(freed);
            }
        }
        Ok(())
    }
}

fn place(
    sites: &Sites,
    options: &GlueOptions,
    known: &[GlueDot],
    going: &mut dyn FnMut() -> ControlFlow<()>,
) -> Result<Placement, Error> {
    glue::place_again(&sites.problem(DVec3::NEG_Y), options, known, going).map_err(|error| match error {
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
            let is_foot = matches!(sites.between[t].1, Side::Ground | Side::Scenery) && sites.is_real(t);
            is_foot && !chosen(t) && stands(t)
        });
        dots.extend(feet.map(|touch| dot(touch, DVec3::ZERO, DVec3::ZERO)));
    }
    dots
}

/// More dots, so that each of these bodies is one solid with all that it touches. They carry nothing in the certified equilibrium:
/// they hold against what no statics knows, such as bodies that the fill left pressed into each other.
fn fastening(sites: &Sites, dots: &[Dot], moving: &BTreeSet<BodyId>, limit: f64) -> Vec<Dot> {
    let pile = sites.problem(DVec3::NEG_Y);
    // All that stands still is one more solid.
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
        if site.may && sites.is_real(touch) && (moves(a) || moves(b)) && solids.find(a) != solids.find(b) {
            solids.join(a, b);
            more.push(sites.dot(touch, DVec3::ZERO, DVec3::ZERO, limit, 1.0));
        }
    }
    more
}
