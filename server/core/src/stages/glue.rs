//! Glue: where friction cannot carry the pile, bodies are glued, and the glued pile is let go to see that it stands.

mod proof;
mod search;

pub use proof::{LetGo, MOST_MOVED, let_go};
pub use search::dots;

use crate::error::Error;
use crate::geometry::pose::Pose;
use crate::geometry::region::DistanceGrid;
use crate::input::observer::Observer;
use crate::input::params::{Params, Switch};
use crate::prepare::effects::{EffectName, Resolved};
use crate::sim::glue::{Dot, Glue, Sites};
use crate::sim::step::Simulation;
use glam::{DQuat, DVec3};
use proof::{Proving, SAGS};
use search::Search;

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
    /// What the certified forces leave unbalanced: sum over the bodies, each by its own weight; for each thousand of them where
    /// there are more.
    pub imbalance: f64,
    /// A normal force cost so much, against a dot's as 1.
    pub normal_price: f64,
    /// All that touches the ground is glued to it.
    pub anchors_all: bool,
    /// How far the bodies moved in the mean when the pile was let go, d.
    pub way: f64,
    /// Share of the bodies that moved then, on level ground and on the worst of the tilted ones.
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

impl Glued {
    /// Whether the pile stood when it was let go, if it was.
    pub fn stands(&self) -> bool {
        self.moved.is_none_or(|moved| moved <= MOST_MOVED && self.way <= SAGS)
    }
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
    let proves = resolved.is_on(EffectName::GlueProof);
    let sites = Sites::new(&sim.pile.world, region, anchors);
    let proving = Proving::new(turn_over, sites.ids.len());
    let mut search = Search::new(sites, params, resolved, proving);
    let mut glued = if proves { search.stable(observer)? } else { search.attempt(0, observer)?.glued };
    let Search { mut proving, sites, iterations, .. } = search;
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
