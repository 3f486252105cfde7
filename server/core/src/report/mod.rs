//! The result of a bake: bodies, frames and figures. Everything but seconds is the same for the same scene, seed and
//! version.

pub mod bake;
pub mod clock;
mod contacts;
mod counts;
mod entrance;
mod glue;
pub mod inputs;
mod limits;
pub mod make;
mod motion;
mod shape;
mod tidiness;
mod visible;
mod warnings;

pub use bake::{BakedGlue, BakedGlueDot};
pub use glue::baked as baked_glue;

use cairn_engine::shape::ShapeFit;
use cairn_geometry::thickness::Part;
use cairn_input::observer::Stage;
use cairn_input::params::Params;
use cairn_prepare::effects::{Charge, Count};
use cairn_prepare::plan::Plan;
use cairn_show::collapse::Collapse;
use cairn_show::taking_apart::RemovedBody;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// The name of a figure.
pub type Name = Cow<'static, str>;

/// Figures made of times: they differ from run to run.
pub const TIMED_FIGURES: [&str; 2] = ["control_overhead", "analysis_us_per_body"];

/// The report of a bake.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Report {
    pub seed: u64,
    pub bodies: usize,
    pub plan: Plan,
    /// Effective parameters.
    pub params: Params,
    /// Figures by name; `null` where a figure has no meaning for this scene.
    pub measures: BTreeMap<Name, Option<f64>>,
    /// Lengths by which the result may differ from the true one, in d, by the parameter that lessens each.
    pub error_sources: BTreeMap<Name, f64>,
    /// The largest of them: the parameter that limits the accuracy.
    pub limited_by: Option<Name>,
    /// Counts by name: steps, solves, verdicts, nails, removed bodies.
    pub counts: BTreeMap<Count, u64>,
    /// Per prop: its collision shape, and the distance of that from the mesh.
    pub shapes: Vec<ShapeFit>,
    /// CPU seconds by stage.
    pub seconds: BTreeMap<Stage, f64>,
    /// The bodies behind `unsupported_fraction`, ascending.
    #[serde(default)]
    pub unsupported: Vec<usize>,
    /// Parts of the control mesh that are empty in the end, where much of it is.
    #[serde(default)]
    pub empty_parts: Vec<Part>,
    /// Bodies that were taken away, in their order.
    #[serde(default)]
    pub removals: Vec<RemovedBody>,
    /// How the pile came down, where the scene asks for that.
    #[serde(default)]
    pub collapse: Option<Collapse>,
    /// The counts and the CPU time of each effect.
    pub bill: Vec<Charge>,
    /// One sentence each: repaired meshes, removed bodies, empty places, bodies not at rest.
    pub warnings: Vec<String>,
}

impl Report {
    /// For a fill from the cache: its steps move to a count of their own, since none was simulated.
    pub fn recall_fill(&mut self) {
        if let Some(steps) = self.counts.insert(Count::FillSteps, 0).filter(|&steps| steps > 0) {
            self.counts.insert(Count::FillStepsRecalled, steps);
        }
        let of_fill = [
            Count::FillSteps,
            Count::FillBodySteps,
            Count::FillPairSteps,
            Count::FillContactLooks,
            Count::FillContactSkips,
        ];
        for count in of_fill {
            let all = self.bill.iter_mut().map(|charge| &mut charge.counts).chain([&mut self.counts]);
            all.for_each(|counts| {
                counts.entry(count).and_modify(|steps| *steps = 0);
            });
        }
    }

    /// For a whole bake from the cache. Counts other than those of the steps stay: they show how the result came about.
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
