//! The search for joints with which a pile stands: place, release in a trial, and place again with the result of
//! the trial. The module [`super::policy`] states the order of the steps.

use super::Glued;
use super::policy::{ATTEMPTS, IN_PLACES, LEANS, LOCAL, LOCAL_MOVED, PRESSED, PRICES, SAGS, WELD_FROM, WELD_ROUNDS};
use super::sites::Sites;
use super::trial::{TrialResult, Trials};
use crate::error::Error;
use crate::geometry::topology::DisjointSets;
use crate::input::observer::{Observer, observe};
use crate::input::params::{Params, Switch};
use crate::prepare::effects::{EffectName, Resolved};
use crate::sim::glue::Joint;
use crate::world::{BodyId, PairSide};
use cairn_statics::glue::{self, GlueError, GlueJoint, GlueOptions, GluePlacement};
use glam::DVec3;
use std::collections::BTreeSet;
use std::ops::ControlFlow;

/// The search for joints with which the pile stands, not only on paper.
pub struct Search<'p, 'a> {
    params: &'p Params,
    /// Least load at which a joint breaks.
    least_limit: f64,
    /// Strength of the glue; `None`: no bound. Bounded glue gets no further joints in place of strength.
    bound: Option<f64>,
    /// Bodies may be glued to the fixed surroundings.
    anchors: bool,
    /// The glued pile is released in trials.
    proves: bool,
    pub trials: Trials<'p, 'a>,
    pub sites: Sites,
    anchors_all: bool,
    /// Joints of the attempt before, if the next one starts from them.
    known: Vec<GlueJoint>,
    pub iterations: u64,
}

impl<'p, 'a> Search<'p, 'a> {
    pub fn new(sites: Sites, params: &'p Params, resolved: &Resolved, trials: Trials<'p, 'a>) -> Search<'p, 'a> {
        Search {
            params,
            least_limit: params.control.break_limit(params.gravity),
            bound: Some(resolved.glue_bound).filter(|bound| bound.is_finite()),
            anchors: params.glue.anchor != Switch::Off,
            proves: resolved.is_on(EffectName::GlueProof),
            trials,
            sites,
            anchors_all: params.glue.anchor == Switch::On,
            known: Vec::new(),
            iterations: 0,
        }
    }

    /// The first choice of joints with which the pile stands in its trial; if there is none, the best choice.
    pub fn stable(&mut self, observer: &mut dyn Observer) -> Result<Glued, Error> {
        let mut is_last = false;
        let mut best: Option<Attempt> = None;
        for number in 0..ATTEMPTS {
            let mut attempt = self.attempt(number, observer)?;
            is_last |= number + 1 == ATTEMPTS;
            let trial = self.trials.run(&attempt.glued.joints, &attempt.absent, DVec3::NEG_Y, is_last, observer)?;
            let next = self.next(number, &mut attempt, trial, observer)?;
            if best.as_ref().is_none_or(|best| attempt.is_as_good_as(best)) {
                best = Some(attempt);
            }
            match next {
                Next::None => break,
                _ if is_last => break,
                Next::Other => {}
                // Its trial runs to the end.
                Next::Same => is_last = true,
            }
        }
        let mut best = best.ok_or_else(|| Error::Internal("no joints were placed".into()))?;
        self.trials.end = 1.0;
        if self.bound.is_none() && !best.is_welded {
            self.weld(&mut best, observer)?;
        }
        Ok(best.glued)
    }

    /// Places joints with the prices and discounts so far.
    pub fn attempt(&mut self, number: usize, observer: &mut dyn Observer) -> Result<Attempt, Error> {
        // Most piles need one or two: each attempt is half of what is left.
        let left = 0.5f64.powi(number as i32);
        (self.trials.begin, self.trials.end) = (1.0 - left, 1.0 - left / 2.0);
        observe(observer, &self.trials.progress(0.0))?;
        let glue = &self.params.glue;
        let (friction_factor, normal_price) = (glue.friction_factor, glue.normal_price);
        let rounds = glue.rounds as usize;
        let options = GlueOptions { friction_factor, normal_price, strength: self.bound, rounds };
        let mut going = || observer.progress(&self.trials.progress(0.0));
        let sites = &self.sites;
        let placement = place(sites, &options, &self.known, &mut going)?;
        self.iterations += placement.iterations;
        // Where no trial shows that the foot is wide enough, all of it is glued.
        self.anchors_all |= self.anchors && !self.proves && !placement.joints.is_empty();
        let mut joints = joints(sites, &placement, self.anchors_all, self.least_limit, glue.breaking);
        if self.bound.is_none() {
            let pressed = joining(sites, &joints, self.least_limit, |site| sites.depths[site] > PRESSED);
            joints.extend(pressed);
        }
        let gaps = || placement.joints.iter().map(|joint| sites.gaps[joint.site]).filter(|gap| *gap > 0.0);
        let glued = Glued {
            joints,
            contact_pairs: sites.real_with(&placement),
            at_least: placement.at_least,
            bridges: gaps().count(),
            widest: gaps().fold(0.0, f64::max),
            unreachable: sites.unreachable.len(),
            too_weak: placement.fallen.len(),
            imbalance: placement.imbalance,
            normal_price: normal_price.max(sites.highest_price()),
            anchors_all: self.anchors_all,
            ..Glued::default()
        };
        let absent =
            placement.fallen.iter().map(|&body| sites.ids[body]).chain(sites.unreachable.iter().copied()).collect();
        Ok(Attempt { glued, absent, chosen: placement.joints, moving: BTreeSet::new(), is_welded: false })
    }

    /// Applies the policy to a trial. Changes sites and prices for the next attempt, and may weld this one.
    fn next(
        &mut self,
        number: usize,
        attempt: &mut Attempt,
        trial: TrialResult,
        observer: &mut dyn Observer,
    ) -> Result<Next, Error> {
        let (displacement, moved) = (trial.displacement, trial.moved);
        let moved_a_little = trial.moved_a_little.iter().copied().collect();
        attempt.stood(trial);
        let leans = self.anchors && displacement > LEANS && !self.anchors_all;
        let fails_in_places = moved <= IN_PLACES && (leans || displacement <= SAGS);
        let is_highest_price = self.sites.is_highest_price(&PRICES);
        let discounts = (fails_in_places || is_highest_price) && self.sites.discount_friction(&attempt.moving);
        let is_to_be_welded = !leans && (attempt.stands() || number >= WELD_FROM || !discounts);
        if self.bound.is_none() && fails_in_places && is_to_be_welded {
            self.weld(attempt, observer)?;
        }
        self.anchors_all |= leans;
        if fails_in_places || is_highest_price {
            self.known.clone_from(&attempt.chosen);
        } else {
            let is_local = LOCAL.contains(&number)
                && moved <= LOCAL_MOVED
                && self.sites.raise_normal_price(Some(&moved_a_little), &PRICES);
            if !is_local {
                self.sites.raise_normal_price(None, &PRICES);
            }
            self.known.clear();
        }
        Ok(match attempt.stands() && !leans {
            true => Next::None,
            false if is_highest_price && !discounts && !leans => Next::Same,
            false => Next::Other,
        })
    }

    /// Welds moving bodies to all that they touch, and bodies that move next, too.
    fn weld(&mut self, attempt: &mut Attempt, observer: &mut dyn Observer) -> Result<(), Error> {
        attempt.is_welded = true;
        let (mut joints, mut moving) = (attempt.glued.joints.clone(), attempt.moving.clone());
        for _ in 0..WELD_ROUNDS {
            if attempt.glued.moved == Some(0.0) {
                break;
            }
            let more = welds(&self.sites, &joints, &moving, self.least_limit);
            if more.is_empty() {
                break;
            }
            joints.extend(more);
            let trial = self.trials.run(&joints, &attempt.absent, DVec3::NEG_Y, true, observer)?;
            moving.extend(&trial.moved_bodies);
            if trial.displacement < attempt.glued.displacement {
                attempt.glued.joints.clone_from(&joints);
                attempt.stood(trial);
            }
        }
        Ok(())
    }
}

/// The step after an attempt.
enum Next {
    None,
    /// The next choice would be the same.
    Same,
    Other,
}

/// A choice of joints, and the result of its trial.
pub struct Attempt {
    pub glued: Glued,
    /// Bodies that are left out of the trial.
    absent: Vec<BodyId>,
    /// Joints of the certified equilibrium.
    chosen: Vec<GlueJoint>,
    /// Bodies that have moved, with these joints or fewer.
    moving: BTreeSet<BodyId>,
    is_welded: bool,
}

impl Attempt {
    fn stands(&self) -> bool {
        self.glued.stands()
    }

    fn is_as_good_as(&self, other: &Attempt) -> bool {
        if self.stands() == other.stands() {
            self.glued.displacement <= other.glued.displacement
        } else {
            self.stands()
        }
    }

    fn stood(&mut self, trial: TrialResult) {
        // A trial that ended early is worse than every other.
        self.glued.displacement = if trial.poses.is_some() { trial.displacement } else { f64::INFINITY };
        self.moving.extend(trial.moved_bodies);
        (self.glued.moved, self.glued.poses_with_glue) = (Some(trial.moved), trial.poses);
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

/// The joints of a placement, engine units; with `anchors_all`, also joints at every contact with the ground.
/// `least_limit`: least load at which a joint breaks.
pub fn joints(
    sites: &Sites,
    placement: &GluePlacement,
    anchors_all: bool,
    least_limit: f64,
    breaking: f64,
) -> Vec<Joint> {
    let pile = sites.problem(DVec3::NEG_Y);
    let joint = |site: usize, force: DVec3, moment: DVec3| sites.joint(site, force, moment, least_limit, breaking);
    let mut joints: Vec<Joint> = placement.joints.iter().map(|j| joint(j.site, j.force, j.moment)).collect();
    if anchors_all {
        let chosen = |site: usize| placement.joints.iter().any(|j| j.site == site);
        let stands = |site: usize| placement.fallen.binary_search(&pile.sites[site].body).is_err();
        let feet = (0..pile.sites.len()).filter(|&t| {
            let is_foot = matches!(sites.between[t].1, PairSide::Ground | PairSide::Scenery) && sites.is_real(t);
            is_foot && !chosen(t) && stands(t)
        });
        joints.extend(feet.map(|site| joint(site, DVec3::ZERO, DVec3::ZERO)));
    }
    joints
}

/// Further joints, so that each of these bodies is one solid with all that it touches: they hold against motion that
/// statics does not predict.
fn welds(sites: &Sites, joints: &[Joint], moving: &BTreeSet<BodyId>, limit: f64) -> Vec<Joint> {
    let moves = |side: PairSide| matches!(side, PairSide::Body(id) if moving.contains(&id));
    joining(sites, joints, limit, |site| {
        let (a, b) = sites.between[site];
        moves(PairSide::Body(a)) || moves(b)
    })
}

/// Further joints, so that the two bodies of each of these sites are one solid. They carry nothing in the certified
/// equilibrium.
fn joining(sites: &Sites, joints: &[Joint], limit: f64, joins: impl Fn(usize) -> bool) -> Vec<Joint> {
    let pile = sites.problem(DVec3::NEG_Y);
    // The fixed surroundings are one more solid.
    let still = sites.ids.len();
    let index = |id: BodyId| sites.ids.binary_search(&id).unwrap_or(still);
    let mut solids = DisjointSets::new(still + 1);
    for joint in joints {
        solids.join(index(joint.a), joint.b.map_or(still, index));
    }
    let mut more = Vec::new();
    for (number, site) in pile.sites.iter().enumerate() {
        let (a, b) = (site.body, site.other.unwrap_or(still));
        if site.may_glue && sites.is_real(number) && joins(number) && solids.find(a) != solids.find(b) {
            solids.join(a, b);
            more.push(sites.joint(number, DVec3::ZERO, DVec3::ZERO, limit, 1.0));
        }
    }
    more
}
