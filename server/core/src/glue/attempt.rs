//! An attempt of the search: a choice of joints, and the result of its trial.

use super::trial::{Poses, TrialResult};
use cairn_engine::world::{BodyId, PairSide};
use cairn_geometry::topology::DisjointSets;
use cairn_motion::glue::sites::Sites;
use cairn_statics::glue::{GlueChoice, GlueJoint, GluePlacement};
use glam::DVec3;
use std::collections::BTreeSet;

/// Joints that were chosen.
pub enum Choice {
    /// Near balance, for a trial.
    Near(GlueChoice),
    Certified(GluePlacement),
}

impl Choice {
    pub fn joints(&self) -> &[GlueJoint] {
        match self {
            Choice::Near(choice) => &choice.joints,
            Choice::Certified(placement) => &placement.joints,
        }
    }

    pub fn fallen(&self) -> &[usize] {
        match self {
            Choice::Near(_) => &[],
            Choice::Certified(placement) => &placement.fallen,
        }
    }

    pub fn iterations(&self) -> u64 {
        match self {
            Choice::Near(choice) => choice.iterations,
            Choice::Certified(placement) => placement.iterations,
        }
    }
}

/// A choice of joints, and the result of its trial.
pub struct Attempt {
    /// With the prices and discounts of this choice.
    pub sites: Sites,
    pub choice: Choice,
    /// Sites that are glued beside the chosen ones: feet, pairs that are pressed, welds. They carry nothing in the
    /// certified equilibrium.
    pub more: BTreeSet<usize>,
    pub anchors_all: bool,
    /// Bodies that are left out of the trial.
    pub absent: Vec<BodyId>,
    /// Bodies that have moved, with these joints or fewer.
    pub moving: BTreeSet<BodyId>,
    pub is_welded: bool,
    /// It stands in its own engine, too.
    pub is_confirmed: bool,
    /// Mean displacement in the trial, d.
    pub displacement: f64,
    pub moved: Option<f64>,
    pub poses: Poses,
}

impl Attempt {
    pub fn stands(&self) -> bool {
        super::stands(self.moved, self.displacement)
    }

    pub fn is_as_good_as(&self, other: &Attempt) -> bool {
        if self.stands() == other.stands() { self.displacement <= other.displacement } else { self.stands() }
    }

    pub fn stood(&mut self, trial: TrialResult) {
        // A trial that ended early is worse than every other.
        self.displacement = if trial.is_whole { trial.displacement } else { f64::INFINITY };
        self.moving.extend(&trial.moved_bodies);
        self.is_confirmed = false;
        (self.moved, self.poses) = (Some(trial.moved), trial.final_poses());
    }

    pub fn is_chosen(&self, site: usize) -> bool {
        self.choice.joints().binary_search_by_key(&site, |joint| joint.site).is_ok()
    }

    /// With `anchors_all`, every contact with the fixed surroundings is glued.
    pub fn glue_feet(&mut self) {
        if !self.anchors_all {
            return;
        }
        let pile = self.sites.problem(DVec3::NEG_Y);
        let feet = (0..pile.sites.len()).filter(|&t| {
            let is_foot = matches!(self.sites.between[t].1, PairSide::Ground | PairSide::Scenery);
            let stands = self.choice.fallen().binary_search(&pile.sites[t].body).is_err();
            is_foot && self.sites.is_real(t) && stands && !self.is_chosen(t)
        });
        let feet: Vec<usize> = feet.collect();
        self.more.extend(feet);
    }

    /// Further sites, so that each of these bodies is one solid with all that it touches: they hold against motion
    /// that statics does not predict.
    pub fn welds(&self, moving: &BTreeSet<BodyId>) -> Vec<usize> {
        let moves = |side: PairSide| matches!(side, PairSide::Body(id) if moving.contains(&id));
        self.joining(|site| {
            let (a, b) = self.sites.between[site];
            moves(PairSide::Body(a)) || moves(b)
        })
    }

    /// Further sites, so that the two bodies of each of these are one solid.
    pub fn joining(&self, joins: impl Fn(usize) -> bool) -> Vec<usize> {
        let pile = self.sites.problem(DVec3::NEG_Y);
        // The fixed surroundings are one more solid.
        let still = self.sites.assembly.ids.len();
        let ends = |site: usize| (pile.sites[site].body, pile.sites[site].other.unwrap_or(still));
        let mut solids = DisjointSets::new(still + 1);
        for site in self.choice.joints().iter().map(|joint| joint.site).chain(self.more.iter().copied()) {
            let (a, b) = ends(site);
            solids.join(a, b);
        }
        let mut more = Vec::new();
        for (number, site) in pile.sites.iter().enumerate() {
            let (a, b) = ends(number);
            if site.may_glue && self.sites.is_real(number) && joins(number) && solids.find(a) != solids.find(b) {
                solids.join(a, b);
                more.push(number);
            }
        }
        more
    }
}
