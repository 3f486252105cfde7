//! The bodies of any glTF file, for an analysis of how they stand, and files that show its answers.

mod bodies;
mod colors;
mod graph;

pub use bodies::{FoundBody, FoundPile, Selection, read};
pub use colors::{Figure, colored};
pub use graph::{dot, svg};

use cairn_analysis::{AnalysisOptions, PileAnalysis};
use serde_json::{Value, json};

/// The answers as JSON, with the names of the bodies.
pub fn to_json(pile: &FoundPile, analysis: &PileAnalysis, options: &AnalysisOptions) -> Value {
    let mut bodies = serde_json::to_value(&analysis.bodies).unwrap_or_default();
    for (body, found) in bodies.as_array_mut().into_iter().flatten().zip(&pile.bodies) {
        body["name"] = found.name.clone().into();
        body["node"] = found.node.into();
    }
    let mut all = serde_json::to_value(analysis).unwrap_or_default();
    all["bodies"] = bodies;
    all["gravity"] = pile.params.gravity.into();
    all["ground"] = if pile.params.ground { json!(pile.params.ground_height) } else { Value::Null };
    all["friction_share"] = options.friction_share.into();
    all["notes"] = json!(pile.notes);
    all
}
