//! Welds: pairs of bodies that a trial shows to move against each other become one solid. Statics does not know of
//! them; they carry nothing in the certified equilibrium.

use super::attempt::Attempt;
use super::policy::{IN_PLACES, LEANS, SAGS, SLIP_ROUNDS, SLIPS, WELD_ROUNDS};
use super::search::Search;
use super::trial::{Ends, TrialResult};
use crate::sight;
use cairn_engine::world::{BodyId, PairSide};
use cairn_input::error::Error;
use cairn_input::observer::Observer;
use glam::DVec3;

impl Search<'_, '_> {
    /// Adds to an attempt what can be seen from its trial alone: the first two rows of the policy. The last trial.
    pub fn hold(
        &mut self,
        attempt: &mut Attempt,
        trial: TrialResult,
        observer: &mut dyn Observer,
    ) -> Result<TrialResult, Error> {
        let trial = self.glue_feet(attempt, trial, observer)?;
        if self.bound.is_some() || trial.moved <= IN_PLACES && trial.displacement <= SAGS {
            return Ok(trial);
        }
        match self.weld_slips(attempt, &trial, observer)? {
            Some(welded) => self.glue_feet(attempt, welded, observer),
            None => Ok(trial),
        }
    }

    /// Glues all feet of a pile that leans as a whole to the ground, and tries it again. The last trial.
    fn glue_feet(
        &mut self,
        attempt: &mut Attempt,
        trial: TrialResult,
        observer: &mut dyn Observer,
    ) -> Result<TrialResult, Error> {
        let leans = trial.displacement > LEANS && trial.moved <= IN_PLACES;
        if !(leans && self.anchors) || attempt.anchors_all {
            return Ok(trial);
        }
        (self.anchors_all, self.has_leaned, attempt.anchors_all) = (true, true, true);
        attempt.glue_feet();
        self.release(attempt, if trial.is_whole { Ends::Late } else { Ends::Soon }, observer)
    }

    /// Welds the pairs that slip in the trial of a pile that fails in many places, and those that slip next, if the
    /// first are no more than its joints. The trial in which it stands; if there is none, nothing is welded.
    fn weld_slips(
        &mut self,
        attempt: &mut Attempt,
        trial: &TrialResult,
        observer: &mut dyn Observer,
    ) -> Result<Option<TrialResult>, Error> {
        let before = attempt.more.clone();
        let mut slipping = self.slipping(attempt, trial);
        if slipping.len() > attempt.choice.joints().len() {
            return Ok(None);
        }
        for _ in 0..SLIP_ROUNDS {
            if slipping.is_empty() {
                break;
            }
            attempt.more.extend(slipping);
            let trial = self.release(attempt, Ends::Soon, observer)?;
            if trial.stands() {
                return Ok(Some(trial));
            }
            slipping = self.slipping(attempt, &trial);
        }
        attempt.more = before;
        Ok(None)
    }

    /// Further sites, so that no two bodies slip along each other as in this trial.
    fn slipping(&self, attempt: &Attempt, trial: &TrialResult) -> Vec<usize> {
        let before = &self.trials.pile.world;
        let problem = attempt.sites.problem(DVec3::NEG_Y);
        let slip = |(&(a, b), center): (&(BodyId, PairSide), DVec3)| {
            let beside = match b {
                PairSide::Body(b) => trial.moved_point(b, center, before),
                _ => center,
            };
            trial.moved_point(a, center, before).distance(beside)
        };
        let centers = problem.sites.iter().map(|site| site.center);
        let slips: Vec<f64> = attempt.sites.between.iter().zip(centers).map(slip).collect();
        attempt.joining(|site| slips[site] > SLIPS)
    }

    /// Bodies that are seen to hang where the trial ended are welded to what they are pressed into: they came down
    /// until they touched, and collision shapes, which hold their meshes, push them up again.
    pub fn weld_hanging(&self, attempt: &mut Attempt) {
        let Some(poses) = &attempt.poses else { return };
        let hanging = sight::hanging(self.trials.pile, poses, self.params, self.ground);
        let between = &attempt.sites.between;
        let hangs = |site: usize| {
            let (a, b) = between[site];
            hanging.contains(&a) || matches!(b, PairSide::Body(b) if hanging.contains(&b))
        };
        let more = attempt.joining(|site| hangs(site) && attempt.sites.depths[site] > 0.0);
        attempt.more.extend(more);
    }

    /// Welds moving bodies to all that they touch, and bodies that move next, too.
    pub fn weld(&mut self, attempt: &mut Attempt, observer: &mut dyn Observer) -> Result<(), Error> {
        attempt.is_welded = true;
        let (mut kept, mut moving) = (attempt.more.clone(), attempt.moving.clone());
        for _ in 0..WELD_ROUNDS {
            if attempt.moved == Some(0.0) {
                break;
            }
            let more = attempt.welds(&moving);
            if more.is_empty() {
                break;
            }
            attempt.more.extend(more);
            let trial = self.release(attempt, Ends::Late, observer)?;
            moving.extend(&trial.moved_bodies);
            if trial.displacement < attempt.displacement {
                kept.clone_from(&attempt.more);
                attempt.stood(trial);
                if attempt.stands() {
                    break;
                }
            }
        }
        attempt.more = kept;
        Ok(())
    }
}
