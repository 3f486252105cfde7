//! What holds what: a standing pile, body by body, by statics alone.
//!
//! Nothing is simulated. The contacts of the pile as it stands ([`PileContacts`]) are one problem of statics, and each
//! figure is the answer to a question about it:
//!
//! - Which bodies stand? ([`mod@standing`]: forces that balance all of them, or those that miss support.)
//! - What does each carry, and what rests on it? ([`mod@loads`]: from these forces.)
//! - How far is a body from moving while its neighbours are held? ([`mod@own`])
//! - Which body may be removed, what would move otherwise, and in which order do all come apart? ([`mod@apart`])
//! - At which tilt, shake and friction does the whole go, and where? ([`mod@whole`])
//! - Which push at one body brings it down? ([`mod@knock`])
//! - Where is glue needed, if it does not stand? ([`mod@gluing`]) Or which bodies have to move a little?
//!   ([`mod@nudging`])
//!
//! No verdict rests on a solver's word: see [`cairn_statics::limit`] and [`cairn_statics::removal`]. What is not proven
//! either way is said to be open.
//!
//! It must never step a world or change one: it asks for contacts, and hands [`cairn_statics`] a problem
//! ([`assembly`] makes it, for the control and the glue, too).
//!
//! Invariants: engine units inside; a body's place in every answer is its number in the world.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod apart;
pub mod assembly;
mod forecast;
mod gluing;
mod horizon;
mod knock;
mod loads;
mod nudging;
mod own;
mod part;
pub mod pile_equilibrium;
mod problem;
mod standing;
mod whole;

pub use apart::Removal;
pub use forecast::{PileForecast, forecast};
pub use gluing::NeededDot;
pub use knock::KnockOver;
pub use nudging::Nudge;
pub use problem::PileContacts;
pub use whole::{TiltLimit, WholePile};

use cairn_engine::world::World;
use cairn_geometry::contact::REAL_CONTACT;
use cairn_input::error::Error;
use cairn_input::observer::{Observer, Progress, Stage, observe};
use nudging::Nudged;
use std::ops::ControlFlow;

/// Directions of tilts and pushes around the vertical.
pub const AZIMUTHS: usize = 16;

/// What is asked, and how carefully.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnalysisOptions {
    /// A body is safe to remove if the others stand with this share of their friction, 0 to 1, or with what they need
    /// as they are.
    pub friction_share: f64,
    /// Bodies touch up to this gap, in the thickness of the thinner one.
    pub gap: f64,
    /// Also look for removals and for the order in which all come apart.
    pub removals: bool,
    /// Also look for the tilt, shake and friction at which the whole goes.
    pub whole: bool,
}

impl Default for AnalysisOptions {
    fn default() -> Self {
        AnalysisOptions { friction_share: 0.8, gap: REAL_CONTACT, removals: true, whole: true }
    }
}

/// Why a body stands, or does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Standing {
    /// Forces balance it together with all others that stand.
    Stands,
    /// It is placed to stay.
    Pinned,
    /// It would fall even if all that it touches were held.
    FallsAlone,
    /// It falls together with others: no forces balance all of them at once.
    FallsWithOthers,
}

impl Standing {
    pub fn falls(self) -> bool {
        matches!(self, Standing::FallsAlone | Standing::FallsWithOthers)
    }
}

/// One body.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct AnalysedBody {
    pub standing: Standing,
    /// kg.
    pub mass: f64,
    /// What its contacts leave unbalanced, in its weight: force and moment (by its radius), by substitution.
    pub unbalanced: f64,
    /// Sum of what others press down on it, N.
    pub load: f64,
    /// The same, in its weight.
    pub load_in_weights: f64,
    /// Bodies that it carries directly, ascending.
    pub carries: Vec<usize>,
    /// Those, and all that rest on them, ascending.
    pub rests_on_it: Vec<usize>,
    /// With its neighbours held: the share of its contacts' friction with which it still stands; `None` if it falls.
    pub least_friction: Option<f64>,
    /// With its neighbours held: the least horizontal push at its center of mass that moves it, in its weight, of
    /// [`AZIMUTHS`] directions, and at most [`own::MOST_PUSH`].
    pub least_push: Option<f64>,
    /// The direction of that push, degrees from +Z toward +X.
    pub push_azimuth: Option<f64>,
    /// With its neighbours held: the least tilt of the ground that moves it, degrees.
    pub least_tilt: Option<f64>,
    /// What becomes of the others without it; `None` if it was not asked, or if the body falls as it is.
    pub removal: Option<Removal>,
}

/// Two that touch.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Touch {
    pub body: usize,
    /// The other body; `None`: the ground or scenery.
    pub other: Option<usize>,
    /// Number of contact points.
    pub points: usize,
    /// Middle of the points, m.
    pub point: [f64; 3],
    /// On `body`, N.
    pub force: [f64; 3],
}

/// The answers.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct PileAnalysis {
    /// In the order of the scene's bodies.
    pub bodies: Vec<AnalysedBody>,
    pub touches: Vec<Touch>,
    /// Every body stands.
    pub stands: bool,
    /// Sum of what forces leave unbalanced over all bodies that stand, in each one's weight: the certificate.
    pub imbalance: f64,
    /// An order in which they can be taken away, none of the others falling; without those of `stuck`.
    pub order: Vec<usize>,
    /// Bodies for which no such order was found: at some point of it, whichever goes, others fall or may fall.
    pub stuck: Vec<usize>,
    /// Of the bodies that stand; `None` where it was not asked, or where none does.
    pub whole: Option<WholePile>,
    /// Glue dots with which it stands, if some body falls.
    pub glue: Vec<NeededDot>,
    /// Bodies that no glue at their contacts holds.
    pub beyond_glue: Vec<usize>,
    /// Small moves with which fewer bodies fall, without glue; ascending by body.
    pub nudges: Vec<Nudge>,
    /// Bodies that fall even so; empty if all stand then, or as they are.
    pub beyond_nudges: Vec<usize>,
    /// Cone programs solved.
    pub programs: u64,
}

/// Progress of an analysis, which may be cancelled between two programs.
struct Going<'o> {
    observer: &'o mut dyn Observer,
    bodies: usize,
    /// Share of the whole.
    last: f64,
}

impl Going<'_> {
    fn on(&mut self, fraction: f64) -> Result<(), Error> {
        self.last = fraction;
        let bodies = self.bodies;
        let progress =
            Progress { stage: Stage::Measure, fraction, bodies, released: bodies, at_rest: 0, nails: 0, frames: 0 };
        observe(self.observer, &progress)
    }

    /// The progress stays.
    fn flow_on(&mut self) -> ControlFlow<()> {
        self.flow(self.last)
    }

    fn flow(&mut self, fraction: f64) -> ControlFlow<()> {
        if self.on(fraction).is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    }
}

/// Analyses a pile as it stands in a world. Afterwards, bodies that fall are where they would stand, if such places
/// were found.
pub fn run(world: &mut World, options: &AnalysisOptions, observer: &mut dyn Observer) -> Result<PileAnalysis, Error> {
    let pile = PileContacts::new(world, options.gap);
    let mut going = Going { observer, bodies: pile.bodies.len(), last: 0.0 };
    going.on(0.0)?;
    let own = own::of(&pile, &mut going)?;
    let found = standing::of(&pile, &own, options.friction_share, &mut going)?;
    let mut programs = found.programs;
    let loads = loads::of(&pile, &found.forces);
    let mut bodies: Vec<AnalysedBody> = (0..world.bodies().len())
        .map(|id| AnalysedBody {
            standing: Standing::Pinned,
            mass: world.bodies()[id].mass * world.units.mass,
            unbalanced: 0.0,
            load: 0.0,
            load_in_weights: 0.0,
            carries: Vec::new(),
            rests_on_it: Vec::new(),
            least_friction: None,
            least_push: None,
            push_azimuth: None,
            least_tilt: None,
            removal: None,
        })
        .collect();
    for (k, &id) in pile.ids.iter().enumerate() {
        let body = &mut bodies[id];
        body.standing = match found.falls[k] {
            false => Standing::Stands,
            true if own[k].falls => Standing::FallsAlone,
            true => Standing::FallsWithOthers,
        };
        let of_ids = |list: &[usize]| list.iter().map(|&k| pile.ids[k]).collect::<Vec<_>>();
        body.unbalanced = found.missing[k];
        body.load = pile.newton(loads.down[k]);
        body.load_in_weights = loads.down[k] / pile.bodies[k].mass;
        body.carries = of_ids(&loads.carries[k]);
        body.rests_on_it = of_ids(&loads.rests_on(k));
        let own = &own[k];
        (body.least_friction, body.least_push) = (own.friction, own.push.map(|(push, _)| push));
        body.push_azimuth = own.push.map(|(_, azimuth)| azimuth);
        body.least_tilt = body.least_push.map(|push| libm::atan(push).to_degrees());
    }
    let (mut order, mut stuck) = (Vec::new(), Vec::new());
    if options.removals {
        let apart = apart::of(&pile, &found, &mut going)?;
        programs += apart.programs;
        for (k, removal) in apart.removals.into_iter().enumerate() {
            bodies[pile.ids[k]].removal = removal.map(|removal| removal.named(&pile.ids));
        }
        order = apart.order.iter().map(|&k| pile.ids[k]).collect();
        stuck = apart.stuck.iter().map(|&k| pile.ids[k]).collect();
    }
    let stands = !found.falls.contains(&true);
    let whole = match options.whole && found.falls.contains(&false) {
        true => Some(whole::of(&pile, &found, &own, &loads, &bodies, &mut going)?),
        false => None,
    };
    programs += whole.as_ref().map_or(0, |whole| whole.programs);
    let (glue, beyond_glue) = match stands {
        true => (Vec::new(), Vec::new()),
        false => gluing::of(&pile, &mut going)?,
    };
    let touches = pile.touches(&found.forces);
    let nudged = match stands {
        true => Nudged::default(),
        false => {
            let falls = pile.named(&found.falls);
            nudging::of(world, pile, falls, options, &mut going)?
        }
    };
    Ok(PileAnalysis {
        bodies,
        touches,
        stands,
        imbalance: found.imbalance,
        order,
        stuck,
        whole,
        glue,
        beyond_glue,
        nudges: nudged.nudges,
        beyond_nudges: nudged.falls,
        programs,
    })
}
