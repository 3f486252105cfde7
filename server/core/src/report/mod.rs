//! What a bake leaves behind: bodies, frames and the figures. Everything but seconds is the same for the same scene, seed and
//! version.

pub mod bake;
pub mod clock;
mod contacts;
mod counts;
mod glue;
pub mod inputs;
pub mod make;
mod motion;
mod order;
mod shape;
mod warnings;

pub use bake::{BakedGlue, BakedGlueDot};
pub use glue::baked as baked_glue;

use crate::input::observer::Stage;
use crate::input::params::Params;
use crate::prepare::effects::{Charge, Count};
use crate::prepare::plan::Plan;
use crate::prepare::shape::ShapeFit;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// The name of a figure.
pub type Name = Cow<'static, str>;

/// Figures that are made of times, so that they differ from run to run.
pub const TIMED_FIGURES: [&str; 2] = ["control_overhead", "analysis_us_per_body"];

/// What a bake tells of itself.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Report {
    pub seed: u64,
    pub bodies: usize,
    pub plan: Plan,
    /// Effective parameters.
    pub params: Params,
    /// Figures by name; `null` where a figure has no meaning for this scene.
    pub measures: BTreeMap<Name, Option<f64>>,
    /// What keeps the result from the truth, in d, by the parameter that lessens it.
    pub error_sources: BTreeMap<Name, f64>,
    /// The largest of them: the parameter that limits the accuracy.
    pub limited_by: Option<Name>,
    /// Counts by name: steps, solves, verdicts, nails, removed bodies.
    pub counts: BTreeMap<Count, u64>,
    /// Per prop: what its collision shape is and how far it is from the mesh.
    pub shapes: Vec<ShapeFit>,
    /// CPU seconds by stage.
    pub seconds: BTreeMap<Stage, f64>,
    /// The bodies behind `unsupported_fraction`, rising.
    #[serde(default)]
    pub unsupported: Vec<usize>,
    /// What each effect did and cost.
    pub bill: Vec<Charge>,
    /// Sentences for a person: what was repaired, removed, left empty, not at rest.
    pub warnings: Vec<String>,
}

impl Report {
    /// The fill was known, and nothing of it was simulated: what it once took is told apart.
    pub fn recall_fill(&mut self) {
        if let Some(steps) = self.counts.insert(Count::FillSteps, 0).filter(|&steps| steps > 0) {
            self.counts.insert(Count::FillStepsRecalled, steps);
        }
        for count in [Count::FillSteps, Count::FillBodySteps, Count::FillPairSteps] {
            let all = self.bill.iter_mut().map(|charge| &mut charge.counts).chain([&mut self.counts]);
            all.for_each(|counts| {
                counts.entry(count).and_modify(|steps| *steps = 0);
            });
        }
    }

    /// The whole bake was known. Counts other than those of the steps stay: they tell how the result came about, then.
    pub fn recall(&mut self) {
        self.recall_fill();
        if let Some(steps) = self.counts.insert(Count::Steps, 0).filter(|&steps| steps > 0) {
            self.counts.insert(Count::StepsRecalled, steps);
        }
        self.seconds.values_mut().for_each(|seconds| *seconds = 0.0);
        for charge in &mut self.bill {
            (charge.seconds, charge.share) = (None, None);
            charge.counts.values_mut().for_each(|count| *count = 0);
        }
    }
}
