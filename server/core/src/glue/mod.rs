//! Glue: where friction cannot carry the pile, bodies are glued, and the glued pile is released in a trial to see that
//! it stands.
//!
//! [`policy`]: the order of the attempts, with the reasons. [`Sites`]: places for glue. [`search`]: attempts.
//! [`trial`]: releases. Joints, clusters and breaking at run time are in [`cairn_motion::glue`]; the solver is
//! [`cairn_statics::glue`].

mod attempt;
mod natural;
pub mod policy;
mod search;
mod trial;
mod welds;

pub use policy::MOST_MOVED;
pub use trial::{Ends, TrialResult, Watch, release_trial};

use cairn_geometry::interior::DistanceGrid;
use cairn_geometry::pose::Pose;
use cairn_input::error::Error;
use cairn_input::observer::Observer;
use cairn_input::params::{Params, Switch};
use cairn_motion::glue::sites::{KnownGlue, Sites};
use cairn_motion::glue::{Joint, PileGlue};
use cairn_motion::step::Simulation;
use cairn_prepare::effects::{EffectName, Resolved};
use glam::{DQuat, DVec3};
use natural::Natural;
use policy::{SAGS, TILT};
use search::Search;
use std::collections::BTreeSet;
use trial::Trials;

/// The joints, and the result of their trial. Engine units.
#[derive(Clone, Debug, Default)]
pub struct Glued {
    pub joints: Vec<Joint>,
    /// Number of contact pairs, and of the joints that are pegs or bridges.
    pub contact_pairs: usize,
    /// Lower bound on the number of joints.
    pub at_least: usize,
    /// Number of joints across gaps, where no chain of contacts joins bodies to the ground.
    pub bridges: usize,
    /// The widest of those gaps, d.
    pub widest: f64,
    /// Number of bodies without a chain of sites to the ground.
    pub unreachable: usize,
    /// Number of bodies that the glue is too weak to hold.
    pub too_weak: usize,
    /// Imbalance of the certified forces: sum over the bodies, each relative to its weight; per thousand bodies where
    /// there are more.
    pub imbalance: f64,
    /// Highest price of a normal force, relative to a joint force (1).
    pub normal_price: f64,
    /// The pile leaned as a whole, so that every contact with the ground is glued.
    pub leans: bool,
    /// Mean displacement of the bodies in the trial, d.
    pub displacement: f64,
    /// Share of the bodies that moved in the trial on level ground.
    pub moved: Option<f64>,
    /// The largest such share of the trials on tilted ground.
    pub moved_tilted: Option<f64>,
    /// Poses after the trial on level ground; `None` if it ended early. Shape `[body]`; `None`: the body was left out,
    /// since no glue holds it.
    pub poses_with_glue: Option<Vec<Option<Pose>>>,
    /// Poses after a trial without glue, if there was one. As above.
    pub poses_without_glue: Option<Vec<Option<Pose>>>,
    pub iterations: u64,
    pub proof_steps: u64,
    /// CPU seconds of the trials.
    pub proof_seconds: f64,
}

impl Glued {
    /// No glue, where the pile stands by itself.
    fn of(natural: Option<&Natural>) -> Glued {
        let Some(Natural { trial, .. }) = natural else { return Glued::default() };
        Glued {
            displacement: trial.displacement,
            moved: Some(trial.moved),
            poses_with_glue: trial.final_poses(),
            ..Glued::default()
        }
    }

    /// The pile stood in its trial, or there was none.
    pub fn stands(&self) -> bool {
        stands(self.moved, self.displacement)
    }
}

/// Share of the bodies that moved in a trial, if there was one, and their mean displacement, d.
fn stands(moved: Option<f64>, displacement: f64) -> bool {
    moved.is_none_or(|moved| moved <= MOST_MOVED && displacement <= SAGS)
}

/// Places the joints of a pile that has been turned over, and glues it. `region`: where glue may be, engine units.
/// `known`: the glue of an earlier pile, which stays among bodies that are as they were. `ground`: its height, m.
pub fn run(
    sim: &mut Simulation,
    region: Option<&DistanceGrid>,
    known: &KnownGlue,
    params: &Params,
    resolved: &Resolved,
    ground: f64,
    observer: &mut dyn Observer,
) -> Result<Glued, Error> {
    let anchors = params.glue.anchor != Switch::Off;
    let proves = resolved.is_on(EffectName::GlueProof);
    let world = &sim.pile.world;
    let mut trials = Trials::new(&sim.pile, params.glue.proof_engine);
    let all = proves && params.glue.proof == Switch::On;
    let seeks = proves && (all || params.accuracy.traits().seeks_natural);
    let natural = match seeks && params.glue.anchor != Switch::On {
        true => Some(Natural::run(world, &mut trials, all, observer)?),
        false => None,
    };
    let standing = natural.as_ref().map_or(BTreeSet::new(), |natural| natural.standing(world));
    let sites = Sites::with_known(world, region, anchors, &standing, &known.joints);
    let joints = sites.known(&known.joints);
    let kept = sites.among(&known.still, &joints);
    let mut search = Search::new(sites, params, resolved, trials, ground);
    search.kept = kept;
    search.known = if known.is_start { joints } else { Vec::new() };
    let mut glued = match proves {
        true if search.sites.assembly.ids.is_empty() => Glued::of(natural.as_ref()),
        true => search.stable(observer)?,
        false => search.unproven(observer)?,
    };
    let Search { mut trials, sites, iterations, .. } = search;
    if params.glue.proof == Switch::On && proves {
        glued.poses_without_glue = match natural {
            Some(natural) => natural.trial.final_poses(),
            None => trials.run(&[], &[], DVec3::NEG_Y, Ends::Late, observer)?.final_poses(),
        };
        let mut worst = 0.0f64;
        for side in [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z] {
            let down = DQuat::from_axis_angle(side, TILT.to_radians()) * DVec3::NEG_Y;
            worst = worst.max(trials.run(&glued.joints, &sites.unreachable, down, Ends::Soon, observer)?.moved);
        }
        glued.moved_tilted = Some(worst);
    }
    (glued.iterations, glued.proof_steps, glued.proof_seconds) = (iterations, trials.steps, trials.seconds);
    let breaks = resolved.is_on(EffectName::Breaking);
    sim.pile.glue = PileGlue::new(glued.joints.clone(), breaks, &mut sim.pile.world, &mut sim.pile.policy);
    Ok(glued)
}
