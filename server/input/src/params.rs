//! Every parameter of a bake. The structs, with meaning, unit, range and default of each field, are generated from the
//! comments of `proto/cairn/v1/params.proto` and `scene.proto` (`build.rs`); values that derive from them are
//! here.
//!
//! A length relative to `d` is in units of the median prop diameter (bounding sphere); a characteristic time is
//! `sqrt(d / g)`. A pile of 1 cm props and one of 1 m props therefore take the same steps (Hsu & Keyser 2012, Table 1,
//! holds for one size).

mod fill;
mod presets;

pub use fill::FillTraits;
pub use presets::AccuracyTraits;

use crate::error::SceneProblem;
use std::ops::{Bound, RangeBounds};

include!(concat!(env!("OUT_DIR"), "/params.rs"));

/// A number among the parameters: its name, its value if it is set, and its range.
type Ranged = (&'static str, Option<f64>, (Bound<f64>, Bound<f64>));

/// The first of these numbers that is out of range, or the first one.
fn outside(numbers: &[f64], range: (Bound<f64>, Bound<f64>)) -> Option<f64> {
    numbers.iter().copied().find(|number| !range.contains(number)).or(numbers.first().copied())
}

impl Switch {
    /// The effect is on. `called_for`: the scene calls for it.
    pub fn is_on(self, called_for: bool) -> bool {
        match self {
            Switch::Auto => called_for,
            Switch::On => true,
            Switch::Off => false,
        }
    }
}

/// A duration in one of the two clocks.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Time {
    /// Characteristic times `sqrt(d / g)`: follows the props' size.
    Natural(f64),
    /// Seconds, whatever the size.
    Seconds(f64),
}

impl Time {
    /// In seconds, given the characteristic time.
    pub fn seconds(self, characteristic_time: f64) -> f64 {
        match self {
            Time::Natural(t) => t * characteristic_time,
            Time::Seconds(s) => s,
        }
    }

    /// In its own unit.
    pub fn number(self) -> f64 {
        let (Time::Natural(number) | Time::Seconds(number)) = self;
        number
    }

    /// The name of the step's field in its unit.
    pub fn step_field(self) -> &'static str {
        match self {
            Time::Natural(_) => "physics.step_natural",
            Time::Seconds(_) => "physics.step_seconds",
        }
    }
}

/// Minimum spread of a candidate's contacts.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Spread {
    /// The area of the contacts' convex hull, as a share of the body's own smallest face area
    /// (the product of its two smallest extents).
    Relative(f64),
    /// Eq. 6 with alpha in m^2, in the order of the contacts.
    Area(f64),
}

impl Spread {
    /// In its own unit.
    pub fn number(self) -> f64 {
        let (Spread::Relative(number) | Spread::Area(number)) = self;
        number
    }
}

/// The thickness of the thinnest body, in d, that `contact_frequency` and the engine's margins are meant for.
pub const USUAL_THICKNESS: f64 = 0.1;
/// Largest factor on `contact_frequency` for thinner bodies.
const STIFFEST: f64 = 5.0;
/// A contact spring is stable up to this share of the substeps' rate.
const STABLE_PER_SUBSTEP: f64 = 0.25;
/// A stack of such springs is calm up to this share: beyond it, a tall one oscillates forever and walks, until it
/// falls.
const CALM_PER_SUBSTEP: f64 = 0.14;
/// Most substeps: as the range of `substeps`.
pub const MOST_SUBSTEPS: u32 = 64;

impl Physics {
    /// The frequency of the contact springs, per characteristic time, where the thinnest body has this thickness (in
    /// d). A body sinks in by g / omega^2: thin ones get stiffer springs, so that it is the same share of their
    /// thickness.
    pub fn stiffness(&self, thickness: f64) -> f64 {
        self.contact_frequency * (USUAL_THICKNESS / thickness).sqrt().clamp(1.0, STIFFEST)
    }

    /// The substeps that contacts of this frequency need in a step of this length, characteristic times, and at least
    /// `substeps`.
    pub fn substeps_for(&self, frequency: f64, step: f64) -> u32 {
        self.substeps.max(substeps(frequency * step / STABLE_PER_SUBSTEP))
    }

    /// The same for a pile that is to stand.
    pub fn calm_substeps_for(&self, frequency: f64, step: f64) -> u32 {
        self.substeps.max(substeps(frequency * step / CALM_PER_SUBSTEP))
    }
}

fn substeps(needed: f64) -> u32 {
    (needed.ceil() as u32).min(MOST_SUBSTEPS)
}

/// Strength of a glue joint where `tacky` is not given another, in weights of the median prop.
const TACKY: f64 = 5.0;
/// The paper's kappa is an impulse per kg over this time (s): its step.
const KAPPA_TIME: f64 = 1.0 / 240.0;

impl Params {
    /// Largest load of a glue joint, in weights of the median prop: 0 if nothing is glued. `fills`: a control mesh is
    /// filled.
    pub fn glue_bound(&self, fills: bool) -> f64 {
        let is_held = fills && self.control.mode == ControlMode::Hold;
        match self.glue.mode {
            GlueMode::Natural => 0.0,
            GlueMode::Auto if self.glue.strength.is_none() && !is_held => 0.0,
            GlueMode::Auto | GlueMode::AsModelled => self.glue.strength.unwrap_or(f64::INFINITY),
            GlueMode::Tacky => self.glue.strength.unwrap_or(TACKY),
        }
    }

    /// The parameters that are out of range, each with its range.
    pub fn problems(&self) -> Vec<SceneProblem> {
        let problem = |(name, value, range): (&'static str, Option<f64>, (Bound<f64>, Bound<f64>))| {
            let value = value.filter(|value| !range.contains(value))?;
            let remedy = match range {
                (Bound::Excluded(low), _) => format!("a number above {low}"),
                (Bound::Included(low), Bound::Included(high)) => format!("{low} to {high}"),
                _ => unreachable!("the schema has no other range"),
            };
            Some(SceneProblem::new(name, format!("{name}: {value} is out of range; give {remedy}")))
        };
        self.ranges().into_iter().filter_map(problem).collect()
    }
}

impl Control {
    /// Force per mass at which a support breaks, in weights.
    pub fn break_limit(&self, gravity: f64) -> f64 {
        self.kappa / KAPPA_TIME / gravity
    }
}
