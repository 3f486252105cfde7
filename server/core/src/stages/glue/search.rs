//! The search for dots with which a pile stands, not only on paper: it is let go, and what moved is known in the next attempt.

use super::Glued;
use super::proof::{IN_PLACES, LEANS, LetGo, Proving, SAGS};
use crate::error::Error;
use crate::geometry::topology::DisjointSets;
use crate::input::observer::{Observer, observe};
use crate::input::params::{Params, Switch};
use crate::prepare::effects::{EffectName, Resolved};
use crate::sim::glue::{Dot, Sites};
use crate::world::{BodyId, PairSide};
use cairn_statics::glue::{self, GlueError, GlueJoint, GlueOptions, GluePlacement};
use glam::DVec3;
use std::collections::BTreeSet;
use std::ops::{ControlFlow, Range};

/// The price of normal forces is the one that is asked for, and at least the next of these where the pile fails in many places: dear
/// normal forces let glue carry what stands on paper by wedging alone.
const PRICES: [f64; 4] = [0.0, 0.3, 0.6, 1.0];
/// After these attempts, only normal forces of bodies that have stirred grow dearer, where no larger share has moved; else all.
const LOCAL: Range<usize> = 1..5;
const LOCAL_MOVED: f64 = 0.3;
const ATTEMPTS: usize = 8;
/// What moves in few places is held without its friction; from this attempt on it is fastened, so many times, and what moves next, too.
const FASTENED_FROM: usize = 6;
const FASTENINGS: usize = 3;
/// Statics knows nothing of overlaps: bodies that are pressed into each other by more than this are glued, in the thinner one's thickness.
const PRESSED: f64 = 0.2;
/// The search for dots with which the pile stands, not only on paper.
pub struct Search<'p, 'a> {
    params: &'p Params,
    /// What each dot carries at least before it breaks.
    least_limit: f64,
    /// Strength of the glue; `None`: no bound. What is bounded is not to be made up for by more dots.
    bound: Option<f64>,
    /// Bodies may be glued to what stands still.
    anchors: bool,
    /// The pile is let go to see whether it stands.
    proves: bool,
    pub proving: Proving<'p, 'a>,
    pub sites: Sites,
    anchors_all: bool,
    /// Dots of the attempt before, if the next one goes on from them.
    known: Vec<GlueJoint>,
    pub iterations: u64,
}

impl<'p, 'a> Search<'p, 'a> {
    pub fn new(sites: Sites, params: &'p Params, resolved: &Resolved, proving: Proving<'p, 'a>) -> Search<'p, 'a> {
        Search {
            params,
            least_limit: params.control.break_limit(params.gravity),
            bound: Some(resolved.glue_bound).filter(|bound| bound.is_finite()),
            anchors: params.glue.anchor != Switch::Off,
            proves: resolved.is_on(EffectName::GlueProof),
            proving,
            sites,
            anchors_all: params.glue.anchor == Switch::On,
            known: Vec::new(),
            iterations: 0,
        }
    }

    /// The first choice with which the pile stands when it is let go, or the best one.
    pub fn stable(&mut self, observer: &mut dyn Observer) -> Result<Glued, Error> {
        let mut is_last = false;
        let mut best: Option<Attempt> = None;
        for number in 0..ATTEMPTS {
            let mut attempt = self.attempt(number, observer)?;
            is_last |= number + 1 == ATTEMPTS;
            let freed = self.proving.prove(&attempt.glued.dots, &attempt.absent, DVec3::NEG_Y, is_last, observer)?;
            let next = self.next(number, &mut attempt, freed, observer)?;
            if best.as_ref().is_none_or(|best| attempt.is_as_good_as(best)) {
                best = Some(attempt);
            }
            match next {
                Next::None => break,
                _ if is_last => break,
                Next::Other => {}
                // It shows how this one ends.
                Next::Same => is_last = true,
            }
        }
        let mut best = best.ok_or_else(|| Error::Internal("no dots were placed".into()))?;
        self.proving.end = 1.0;
        if self.bound.is_none() && !best.is_fastened {
            self.fasten(&mut best, observer)?;
        }
        Ok(best.glued)
    }

    /// Chooses dots for what is known of the pile so far.
    pub fn attempt(&mut self, number: usize, observer: &mut dyn Observer) -> Result<Attempt, Error> {
        // Most piles need one or two: each attempt is half of what is left.
        let left = 0.5f64.powi(number as i32);
        (self.proving.begin, self.proving.end) = (1.0 - left, 1.0 - left / 2.0);
        observe(observer, &self.proving.progress(0.0))?;
        let glue = &self.params.glue;
        let (friction_factor, normal_price) = (glue.friction_factor, glue.normal_price);
        let rounds = glue.rounds as usize;
        let options = GlueOptions { friction_factor, normal_price, strength: self.bound, rounds };
        let mut going = || observer.progress(&self.proving.progress(0.0));
        let sites = &self.sites;
        let placement = place(sites, &options, &self.known, &mut going)?;
        self.iterations += placement.iterations;
        // Where nothing is to prove that the foot is wide enough, all of it is glued.
        self.anchors_all |= self.anchors && !self.proves && !placement.joints.is_empty();
        let mut dots = dots(sites, &placement, self.anchors_all, self.least_limit, glue.breaking);
        if self.bound.is_none() {
            let pressed = joining(sites, &dots, self.least_limit, |touch| sites.depths[touch] > PRESSED);
            dots.extend(pressed);
        }
        let gaps = || placement.joints.iter().map(|dot| sites.gaps[dot.site]).filter(|gap| *gap > 0.0);
        let glued = Glued {
            dots,
            touches: sites.real_with(&placement),
            at_least: placement.at_least,
            bridges: gaps().count(),
            widest: gaps().fold(0.0, f64::max),
            apart: sites.apart.len(),
            fallen: placement.fallen.len(),
            imbalance: placement.imbalance,
            normal_price: normal_price.max(sites.dearest()),
            anchors_all: self.anchors_all,
            ..Glued::default()
        };
        let absent = placement.fallen.iter().map(|&body| sites.ids[body]).chain(sites.apart.iter().copied()).collect();
        Ok(Attempt { glued, absent, chosen: placement.joints, moving: BTreeSet::new(), is_fastened: false })
    }

    /// What to try after an attempt, and after what the pile did when it was let go. What fails in few places only is fastened there:
    /// late, or where nothing else is left to try.
    fn next(
        &mut self,
        number: usize,
        attempt: &mut Attempt,
        freed: LetGo,
        observer: &mut dyn Observer,
    ) -> Result<Next, Error> {
        let (way, moved, stirred) = (freed.way, freed.moved, freed.stirred.iter().copied().collect());
        attempt.stood(freed);
        let leans = self.anchors && way > LEANS && !self.anchors_all;
        let fails_in_places = moved <= IN_PLACES && (leans || way <= SAGS);
        let is_dearest = self.sites.is_dearest(&PRICES);
        let distrusts = (fails_in_places || is_dearest) && self.sites.distrust(&attempt.moving);
        let is_to_be_fastened = !leans && (attempt.stands() || number >= FASTENED_FROM || !distrusts);
        if self.bound.is_none() && fails_in_places && is_to_be_fastened {
            self.fasten(attempt, observer)?;
        }
        self.anchors_all |= leans;
        if fails_in_places || is_dearest {
            self.known.clone_from(&attempt.chosen);
        } else {
            let is_local =
                LOCAL.contains(&number) && moved <= LOCAL_MOVED && self.sites.make_dearer(Some(&stirred), &PRICES);
            if !is_local {
                self.sites.make_dearer(None, &PRICES);
            }
            self.known.clear();
        }
        Ok(match attempt.stands() && !leans {
            true => Next::None,
            false if is_dearest && !distrusts && !leans => Next::Same,
            false => Next::Other,
        })
    }

    /// Fastens what moves to all that it touches, and what moves next, too; as long as anything does.
    fn fasten(&mut self, attempt: &mut Attempt, observer: &mut dyn Observer) -> Result<(), Error> {
        attempt.is_fastened = true;
        let (mut dots, mut moving) = (attempt.glued.dots.clone(), attempt.moving.clone());
        for _ in 0..FASTENINGS {
            if attempt.glued.moved == Some(0.0) {
                break;
            }
            let more = fastening(&self.sites, &dots, &moving, self.least_limit);
            if more.is_empty() {
                break;
            }
            dots.extend(more);
            let freed = self.proving.prove(&dots, &attempt.absent, DVec3::NEG_Y, true, observer)?;
            moving.extend(&freed.who);
            if freed.way < attempt.glued.way {
                attempt.glued.dots.clone_from(&dots);
                attempt.stood(freed);
            }
        }
        Ok(())
    }
}

/// What follows an attempt.
enum Next {
    None,
    /// The next choice would be the same.
    Same,
    Other,
}

/// A choice of dots, and how the pile stood with them.
pub struct Attempt {
    pub glued: Glued,
    /// Bodies that are not there when the pile is let go.
    absent: Vec<BodyId>,
    /// Dots of the certified equilibrium.
    chosen: Vec<GlueJoint>,
    /// Bodies that have moved, with these dots or fewer.
    moving: BTreeSet<BodyId>,
    is_fastened: bool,
}

impl Attempt {
    fn stands(&self) -> bool {
        self.glued.stands()
    }

    fn is_as_good_as(&self, other: &Attempt) -> bool {
        if self.stands() == other.stands() { self.glued.way <= other.glued.way } else { self.stands() }
    }

    fn stood(&mut self, freed: LetGo) {
        // What was not waited for is worse than all else.
        self.glued.way = if freed.poses.is_some() { freed.way } else { f64::INFINITY };
        self.moving.extend(freed.who);
        (self.glued.moved, self.glued.freed) = (Some(freed.moved), freed.poses);
    }
}

fn place(
    sites: &Sites,
    options: &GlueOptions,
    known: &[GlueJoint],
    going: &mut dyn FnMut() -> ControlFlow<()>,
) -> Result<GluePlacement, Error> {
    glue::place_again(&sites.problem(DVec3::NEG_Y), options, known, going).map_err(|error| match error {
        GlueError::Cancelled => Error::Cancelled,
        other => Error::Internal(other.to_string()),
    })
}

/// The dots of a placement, engine units; and, where the foot is too narrow, dots at all that touches the ground.
/// `least_limit`: what each dot carries at least before it breaks.
pub fn dots(sites: &Sites, placement: &GluePlacement, anchors_all: bool, least_limit: f64, breaking: f64) -> Vec<Dot> {
    let pile = sites.problem(DVec3::NEG_Y);
    let dot = |touch: usize, force: DVec3, moment: DVec3| sites.dot(touch, force, moment, least_limit, breaking);
    let mut dots: Vec<Dot> = placement.joints.iter().map(|d| dot(d.site, d.force, d.moment)).collect();
    if anchors_all {
        let chosen = |touch: usize| placement.joints.iter().any(|d| d.site == touch);
        let stands = |touch: usize| placement.fallen.binary_search(&pile.sites[touch].body).is_err();
        let feet = (0..pile.sites.len()).filter(|&t| {
            let is_foot = matches!(sites.between[t].1, PairSide::Ground | PairSide::Scenery) && sites.is_real(t);
            is_foot && !chosen(t) && stands(t)
        });
        dots.extend(feet.map(|touch| dot(touch, DVec3::ZERO, DVec3::ZERO)));
    }
    dots
}

/// More dots, so that each of these bodies is one solid with all that it touches: they hold against what no statics knows.
fn fastening(sites: &Sites, dots: &[Dot], moving: &BTreeSet<BodyId>, limit: f64) -> Vec<Dot> {
    let moves = |side: PairSide| matches!(side, PairSide::Body(id) if moving.contains(&id));
    joining(sites, dots, limit, |touch| {
        let (a, b) = sites.between[touch];
        moves(PairSide::Body(a)) || moves(b)
    })
}

/// More dots, so that the two bodies of each of these touches are one solid. They carry nothing in the certified equilibrium.
fn joining(sites: &Sites, dots: &[Dot], limit: f64, joins: impl Fn(usize) -> bool) -> Vec<Dot> {
    let pile = sites.problem(DVec3::NEG_Y);
    // All that stands still is one more solid.
    let still = sites.ids.len();
    let index = |id: BodyId| sites.ids.binary_search(&id).unwrap_or(still);
    let mut solids = DisjointSets::new(still + 1);
    for dot in dots {
        solids.join(index(dot.a), dot.b.map_or(still, index));
    }
    let mut more = Vec::new();
    for (touch, site) in pile.sites.iter().enumerate() {
        let (a, b) = (site.body, site.other.unwrap_or(still));
        if site.may_glue && sites.is_real(touch) && joins(touch) && solids.find(a) != solids.find(b) {
            solids.join(a, b);
            more.push(sites.dot(touch, DVec3::ZERO, DVec3::ZERO, limit, 1.0));
        }
    }
    more
}
