//! File names in a bake's folder. The server makes the folder, and the worker fills it.

use crate::model::export::Format;
use crate::wire::proto::OutputFormat;

pub const SPEC: &str = "spec.binpb";
/// Files named by their SHA-256.
pub const ASSETS: &str = "assets";
pub const EVENTS: &str = "events.log";
pub const REPORT: &str = "report.json";
/// The scene with every parameter set.
pub const SCENE: &str = "scene.json";

/// The name of the result file.
pub fn result_name(format: OutputFormat) -> String {
    format!("result.{}", Format::from_wire(format).extension())
}

/// The result file's name in each format that the service offers.
pub fn result_names() -> impl Iterator<Item = String> {
    Format::ALL.into_iter().filter(|format| format.is_single_file()).map(|format| result_name(format.wire()))
}
