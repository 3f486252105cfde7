//! Glue: where friction cannot carry the pile, bodies are glued, and the glued pile is released in a trial to see that
//! it stands.
//!
//! [`policy`]: what is tried, in which order, and why. [`sites`]: where glue may be. [`search`]: attempts. [`trial`]:
//! releases. What moves with the pile at run time (joints, clusters, breaking) is in [`crate::sim::glue`]; the solver
//! is [`cairn_statics::glue`].

pub mod policy;
mod search;
mod sites;
mod trial;

pub use policy::MOST_MOVED;
pub use search::joints;
pub use sites::Sites;
pub use trial::{TrialResult, release_trial};

use crate::error::Error;
use crate::geometry::pose::Pose;
use crate::geometry::region::DistanceGrid;
use crate::input::observer::Observer;
use crate::input::params::{Params, Switch};
use crate::prepare::effects::{EffectName, Resolved};
use crate::sim::glue::{Joint, PileGlue};
use crate::sim::step::Simulation;
use glam::{DQuat, DVec3};
use policy::{SAGS, TILT};
use search::Search;
use trial::Trials;

/// The joints, and the result of their trial. Engine units.
#[derive(Clone, Debug, Default)]
pub struct Glued {
    pub joints: Vec<Joint>,
    /// Contact pairs that could have been glued, pegs not counted.
    pub touches: usize,
    /// No choice has fewer joints.
    pub at_least: usize,
    /// Joints across gaps, where no chain of contacts joins bodies to the ground, and the widest of those gaps.
    pub bridges: usize,
    pub widest: f64,
    /// Bodies that nothing joins to the ground.
    pub apart: usize,
    /// Bodies that the glue is too weak for.
    pub fallen: usize,
    /// Imbalance of the certified forces: sum over the bodies, each by its own weight; for each thousand of them where
    /// there are more.
    pub imbalance: f64,
    /// Highest price of a normal force, against a joint's as 1.
    pub normal_price: f64,
    /// Every contact with the ground is glued.
    pub anchors_all: bool,
    /// Mean displacement of the bodies in the trial, d.
    pub displacement: f64,
    /// Share of the bodies that moved in the trial, on level ground and on the worst of the tilted ones.
    pub moved: Option<f64>,
    pub moved_tilted: Option<f64>,
    /// Where the bodies were after the trial, on level ground, and where they would be without glue. Shape `[body]`;
    /// `None`: the body was not there, since nothing holds it.
    pub freed: Option<Vec<Option<Pose>>>,
    pub natural: Option<Vec<Option<Pose>>>,
    pub iterations: u64,
    pub proof_steps: u64,
    /// CPU seconds of the trials.
    pub proof_seconds: f64,
}

impl Glued {
    /// Whether the pile stood in its trial, if there was one.
    pub fn stands(&self) -> bool {
        self.moved.is_none_or(|moved| moved <= MOST_MOVED && self.displacement <= SAGS)
    }
}

/// Places the joints of a pile that has been turned over, and glues it. `turn_over`: the same pile again, for the
/// trials. `region`: where glue may be, engine units.
pub fn run<'a>(
    sim: &mut Simulation<'a>,
    turn_over: &dyn Fn() -> Result<Simulation<'a>, Error>,
    region: Option<&DistanceGrid>,
    params: &Params,
    resolved: &Resolved,
    observer: &mut dyn Observer,
) -> Result<Glued, Error> {
    let anchors = params.glue.anchor != Switch::Off;
    let proves = resolved.is_on(EffectName::GlueProof);
    let sites = Sites::new(&sim.pile.world, region, anchors);
    let trials = Trials::new(turn_over, sites.ids.len());
    let mut search = Search::new(sites, params, resolved, trials);
    let mut glued = if proves { search.stable(observer)? } else { search.attempt(0, observer)?.glued };
    let Search { mut trials, sites, iterations, .. } = search;
    if params.glue.proof == Switch::On && proves {
        glued.natural = trials.run(&[], &sites.apart, DVec3::NEG_Y, true, observer)?.poses;
        let mut worst = 0.0f64;
        for side in [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z] {
            let down = DQuat::from_axis_angle(side, TILT.to_radians()) * DVec3::NEG_Y;
            worst = worst.max(trials.run(&glued.joints, &sites.apart, down, false, observer)?.moved);
        }
        glued.moved_tilted = Some(worst);
    }
    (glued.iterations, glued.proof_steps, glued.proof_seconds) = (iterations, trials.steps, trials.seconds);
    let breaks = resolved.is_on(EffectName::Breaking);
    sim.pile.glue = PileGlue::new(glued.joints.clone(), breaks, &mut sim.pile.world, &mut sim.pile.policy);
    Ok(glued)
}
