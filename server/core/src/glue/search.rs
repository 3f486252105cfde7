//! The search for joints with which a pile stands: place, release in a trial, and place again with the result of
//! the trial. The module [`super::policy`] states the order of the steps.

use super::Glued;
use super::attempt::{Attempt, Choice};
use super::policy::{ATTEMPTS, IN_PLACES, LEANS, LOCAL, LOCAL_MOVED, PRESSED, PRICES, SAGS, WELD_FROM};
use super::trial::{Ends, TrialResult, Trials};
use cairn_input::error::Error;
use cairn_input::observer::{Observer, observe};
use cairn_input::params::{Params, ProofEngine, Switch};
use cairn_motion::glue::Joint;
use cairn_motion::glue::sites::Sites;
use cairn_prepare::effects::{EffectName, Resolved};
use cairn_statics::glue::{self, GlueError, GlueJoint, GlueOptions};
use glam::DVec3;
use std::collections::BTreeSet;
use std::iter;

/// The search for joints with which the pile stands, not only on paper.
pub struct Search<'p, 'a> {
    pub params: &'p Params,
    /// Least load at which a joint breaks.
    least_limit: f64,
    /// Strength of the glue; `None`: no bound. Bounded glue gets no further joints in place of strength.
    pub bound: Option<f64>,
    /// Bodies may be glued to the fixed surroundings.
    pub anchors: bool,
    /// The glued pile is released in trials.
    proves: bool,
    pub trials: Trials<'p, 'a>,
    pub sites: Sites,
    /// Prices of normal forces, ascending, from the caller's on.
    prices: Vec<f64>,
    /// Height of the ground, m, if there is one.
    pub ground: Option<f64>,
    pub anchors_all: bool,
    /// A trial showed the pile to lean as a whole.
    pub has_leaned: bool,
    /// Joints of the attempt before, if the next one starts from them; at first, those of an earlier pile.
    pub known: Vec<GlueJoint>,
    /// Sites that an earlier pile had glued, among bodies that are as they were: they stay glued.
    pub kept: BTreeSet<usize>,
    pub iterations: u64,
}

impl<'p, 'a> Search<'p, 'a> {
    /// `ground`: its height, m.
    pub fn new(
        sites: Sites,
        params: &'p Params,
        resolved: &Resolved,
        trials: Trials<'p, 'a>,
        ground: f64,
    ) -> Search<'p, 'a> {
        let higher = PRICES.into_iter().filter(|price| *price > params.glue.normal_price);
        Search {
            prices: iter::once(0.0).chain(higher).collect(),
            params,
            least_limit: params.control.break_limit(params.gravity),
            bound: Some(resolved.glue_bound).filter(|bound| bound.is_finite()),
            anchors: params.glue.anchor != Switch::Off,
            proves: resolved.is_on(EffectName::GlueProof),
            trials,
            sites,
            ground: params.ground.then_some(ground),
            anchors_all: params.glue.anchor == Switch::On,
            has_leaned: false,
            known: Vec::new(),
            kept: BTreeSet::new(),
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
            let trial = self.release(&attempt, if is_last { Ends::Late } else { Ends::Soon }, observer)?;
            let next = self.next(number, &mut attempt, trial, observer)?;
            if best.as_ref().is_none_or(|best| attempt.is_as_good_as(best)) {
                best = Some(attempt);
            }
            if is_last || next == Next::End {
                break;
            }
            is_last = next == Next::Last;
        }
        let mut best = best.ok_or_else(|| Error::Internal("no joints were placed".into()))?;
        self.trials.end = 1.0;
        if self.bound.is_none() && !best.is_welded {
            self.weld(&mut best, observer)?;
        }
        if best.stands() {
            let own = self.try_own_engine(&mut best, observer)?;
            if let OwnTrial::Fails(trial) = own {
                best.stood(trial);
            }
        }
        if self.bound.is_none() {
            self.weld_hanging(&mut best);
        }
        self.certified(best, observer)
    }

    /// The first choice, without a trial.
    pub fn unproven(&mut self, observer: &mut dyn Observer) -> Result<Glued, Error> {
        let attempt = self.attempt(0, observer)?;
        self.certified(attempt, observer)
    }

    /// Places joints with the prices and discounts so far.
    fn attempt(&mut self, number: usize, observer: &mut dyn Observer) -> Result<Attempt, Error> {
        // Most piles need one or two: each attempt is half of what is left.
        let left = 0.5f64.powi(number as i32);
        (self.trials.begin, self.trials.end) = (1.0 - left, 1.0 - left / 2.0);
        observe(observer, &self.trials.progress(0.0))?;
        let options = self.options();
        let mut going = || observer.progress(&self.trials.progress(0.0));
        let problem = self.sites.problem(DVec3::NEG_Y);
        let choice = match self.bound {
            // What it cannot hold is known with the certificate alone.
            Some(_) => Choice::Certified(failure(glue::place_again(&problem, &options, &self.known, &mut going))?),
            None => Choice::Near(failure(glue::choose(&problem, &options, &self.known, &mut going))?),
        };
        self.iterations += choice.iterations();
        // Where no trial shows that the foot is wide enough, or where attempts are to be few, all of it is glued.
        let seeks = self.proves && self.params.accuracy.traits().seeks_natural;
        self.anchors_all |= self.anchors && !seeks && !choice.joints().is_empty();
        let absent = choice.fallen().iter().map(|&body| self.sites.assembly.ids[body]);
        let mut attempt = Attempt {
            absent: absent.chain(self.sites.unreachable.iter().copied()).collect(),
            sites: self.sites.clone(),
            choice,
            more: BTreeSet::new(),
            anchors_all: self.anchors_all,
            moving: BTreeSet::new(),
            is_welded: false,
            is_confirmed: false,
            displacement: 0.0,
            moved: None,
            poses: None,
        };
        let kept: Vec<usize> = self.kept.iter().copied().filter(|&site| !attempt.is_chosen(site)).collect();
        attempt.more.extend(kept);
        attempt.glue_feet();
        if self.bound.is_none() {
            let pressed = attempt.joining(|site| attempt.sites.depths[site] > PRESSED);
            attempt.more.extend(pressed);
        }
        Ok(attempt)
    }

    fn options(&self) -> GlueOptions {
        let glue = &self.params.glue;
        let (friction_factor, normal_price) = (glue.friction_factor, glue.normal_price);
        GlueOptions { friction_factor, normal_price, strength: self.bound, rounds: glue.rounds as usize }
    }

    /// A trial of an attempt.
    pub fn release(
        &mut self,
        attempt: &Attempt,
        ends: Ends,
        observer: &mut dyn Observer,
    ) -> Result<TrialResult, Error> {
        // A lean matters where something can still be done against it.
        self.trials.most_displacement = if self.anchors && !attempt.anchors_all { LEANS } else { SAGS };
        let (joints, engine) = (self.joints(attempt), self.trials.engine);
        self.trials.run_in(engine, &joints, &attempt.absent, DVec3::NEG_Y, ends, observer)
    }

    /// Engine units.
    fn joints(&self, attempt: &Attempt) -> Vec<Joint> {
        let joint = |site: usize, force: DVec3, moment: DVec3| {
            attempt.sites.joint(site, force, moment, self.least_limit, self.params.glue.breaking)
        };
        let chosen = attempt.choice.joints().iter().map(|j| joint(j.site, j.force, j.moment));
        chosen.chain(attempt.more.iter().map(|&site| joint(site, DVec3::ZERO, DVec3::ZERO))).collect()
    }

    /// Balances an attempt's joints, and proves it. Joints that are added only hold more.
    fn certified(&mut self, mut attempt: Attempt, observer: &mut dyn Observer) -> Result<Glued, Error> {
        let options = self.options();
        let placement = match attempt.choice {
            Choice::Certified(placement) => placement,
            Choice::Near(choice) => {
                let mut going = || observer.progress(&self.trials.progress(1.0));
                let problem = attempt.sites.problem(DVec3::NEG_Y);
                let before = choice.iterations;
                let placement = failure(glue::certify(&problem, &options, &[], &choice, &mut going))?;
                self.iterations += placement.iterations - before;
                // Where all was chosen again, the trial was of these.
                let dropped = choice.joints.iter().map(|joint| joint.site);
                attempt.more.extend(dropped);
                placement
            }
        };
        for joint in &placement.joints {
            attempt.more.remove(&joint.site);
        }
        let sites = &attempt.sites;
        let gaps = || placement.joints.iter().map(|joint| sites.gaps[joint.site]).filter(|gap| *gap > 0.0);
        let glued = Glued {
            contact_pairs: sites.real_with(&placement),
            at_least: placement.at_least,
            bridges: gaps().count(),
            widest: gaps().fold(0.0, f64::max),
            unreachable: sites.unreachable.len(),
            too_weak: placement.fallen.len(),
            imbalance: placement.imbalance,
            normal_price: options.normal_price.max(sites.highest_price()),
            leans: attempt.anchors_all && self.has_leaned,
            displacement: attempt.displacement,
            moved: attempt.moved,
            poses_with_glue: attempt.poses.take(),
            ..Glued::default()
        };
        attempt.choice = Choice::Certified(placement);
        Ok(Glued { joints: self.joints(&attempt), ..glued })
    }

    /// The next step after a trial. What stands as in other engines must stand in its own, too.
    fn next(
        &mut self,
        number: usize,
        attempt: &mut Attempt,
        trial: TrialResult,
        observer: &mut dyn Observer,
    ) -> Result<Next, Error> {
        let next = self.apply_policy(number, attempt, trial, observer)?;
        if next != Next::End {
            return Ok(next);
        }
        let own = self.try_own_engine(attempt, observer)?;
        let OwnTrial::Fails(trial) = own else { return Ok(Next::End) };
        let next = self.apply_policy(number, attempt, trial, observer)?;
        // Welds that make it stand now have no trial in its own engine yet.
        Ok(if next == Next::End { Next::Again } else { next })
    }

    /// A trial of an attempt in the pile's own engine, unless there was one with these joints.
    fn try_own_engine(&mut self, attempt: &mut Attempt, observer: &mut dyn Observer) -> Result<OwnTrial, Error> {
        if attempt.is_confirmed || self.trials.engine == ProofEngine::Own {
            return Ok(OwnTrial::Stands);
        }
        let joints = self.joints(attempt);
        let own = self.trials.run_in(ProofEngine::Own, &joints, &attempt.absent, DVec3::NEG_Y, Ends::Late, observer)?;
        if !own.stands() {
            return Ok(OwnTrial::Fails(own));
        }
        attempt.displacement = attempt.displacement.max(own.displacement);
        attempt.moved = attempt.moved.map(|moved| moved.max(own.moved));
        (attempt.poses, attempt.is_confirmed) = (own.final_poses(), true);
        Ok(OwnTrial::Stands)
    }

    /// Applies the policy to a trial. Changes sites and prices for the next attempt, and may weld this one.
    fn apply_policy(
        &mut self,
        number: usize,
        attempt: &mut Attempt,
        trial: TrialResult,
        observer: &mut dyn Observer,
    ) -> Result<Next, Error> {
        let had_feet = attempt.anchors_all;
        let trial = self.hold(attempt, trial, observer)?;
        let leaned = attempt.anchors_all && !had_feet;
        let (displacement, moved) = (trial.displacement, trial.moved);
        let moved_a_little = trial.moved_a_little.iter().copied().collect();
        attempt.stood(trial);
        let fails_in_places = moved <= IN_PLACES && (leaned || displacement <= SAGS);
        let is_highest_price = self.sites.is_highest_price(&self.prices);
        let change = if fails_in_places || is_highest_price {
            Change::Friction
        } else if LOCAL.contains(&number) && moved <= LOCAL_MOVED {
            Change::PriceAround
        } else {
            Change::Price
        };
        let mut discounts = false;
        if change == Change::Friction {
            discounts = self.sites.discount_friction(&attempt.moving);
        }
        let is_to_be_welded = attempt.stands() || number >= WELD_FROM || !discounts;
        if self.bound.is_none() && fails_in_places && is_to_be_welded {
            self.weld(attempt, observer)?;
        }
        match change {
            Change::Friction => self.known = attempt.choice.joints().to_vec(),
            Change::PriceAround => {
                let is_raised = self.sites.raise_normal_price(Some(&moved_a_little), &self.prices);
                if !is_raised {
                    self.sites.raise_normal_price(None, &self.prices);
                }
                self.known.clear();
            }
            Change::Price => {
                self.sites.raise_normal_price(None, &self.prices);
                self.known.clear();
            }
        }
        Ok(match attempt.stands() {
            true => Next::End,
            false if is_highest_price && !discounts => Next::Last,
            false => Next::Again,
        })
    }
}

/// The step after an attempt.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Next {
    /// The pile stands: the search ends.
    End,
    /// One more attempt, whose trial runs to the end: the next choice would be the same.
    Last,
    Again,
}

/// What changes for the next attempt: rows 3, 4 and 5 of the policy.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Change {
    /// Friction is discounted. The next attempt goes on from these joints.
    Friction,
    /// The price rises around bodies that moved a little; everywhere, if it is at the top there.
    PriceAround,
    /// The price rises everywhere.
    Price,
}

/// A trial in the pile's own engine.
enum OwnTrial {
    /// It stands, or it had its trial there before.
    Stands,
    Fails(TrialResult),
}

fn failure<T>(result: Result<T, GlueError>) -> Result<T, Error> {
    result.map_err(|error| match error {
        GlueError::Cancelled => Error::Cancelled,
        other => Error::Internal(other.to_string()),
    })
}
