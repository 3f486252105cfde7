//! The figures of a bake, under the names of measures.md. Everything but `seconds` and `memory` is the same for the
//! same scene, seed and version.

use crate::effects::Charge;
use crate::observer::Stage;
use crate::params::Params;
use crate::plan::Plan;
use std::collections::BTreeMap;

/// What a bake tells of itself.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Report {
    pub seed: u64,
    pub bodies: usize,
    pub plan: Plan,
    /// Effective parameters.
    pub params: Params,
    /// Figures by name, those of measures.md; `null` where a figure has no meaning for this scene.
    pub measures: BTreeMap<&'static str, Option<f64>>,
    /// What keeps the result from the truth, in d, by the parameter that lessens it.
    pub error_sources: BTreeMap<&'static str, f64>,
    /// The largest of them: the parameter that limits the accuracy.
    pub limited_by: Option<&'static str>,
    /// Counts by name: steps, solves, verdicts, nails, removed bodies.
    pub counts: BTreeMap<&'static str, u64>,
    /// Per prop: what its collision shape is and how far it is from the mesh.
    pub shapes: Vec<ShapeReport>,
    /// CPU seconds by stage.
    pub seconds: BTreeMap<Stage, f64>,
    /// What each effect did and cost.
    pub bill: Vec<Charge>,
    /// Sentences for a person: what was repaired, removed, left empty, not at rest.
    pub warnings: Vec<String>,
}

/// How a prop is simulated.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ShapeReport {
    pub prop: String,
    /// `box`, `ball`, `hull` or `parts`.
    pub kind: &'static str,
    pub parts: usize,
    /// Largest distance between the mesh and its collision shape, relative to the prop's diameter.
    pub deviation_rel: f64,
    /// kg at scale 1.
    pub mass: f64,
    /// Where the mass properties come from when the mesh is open or flat.
    pub mass_fallback: Option<String>,
}
