//! File names in a bake's folder. The server makes the folder, and the worker fills it.

use crate::model::export::Format;

pub const SPEC: &str = "spec.binpb";
/// Files named by their SHA-256.
pub const ASSETS: &str = "assets";
pub const EVENTS: &str = "events.log";
pub const REPORT: &str = "report.json";
/// The scene with every parameter set.
pub const SCENE: &str = "scene.json";

/// The pile itself, of which results in further formats are made.
pub const PILE: &str = "pile.postcard";

/// The name of the result file.
pub fn result_name(format: Format) -> String {
    format!("result.{}", format.extension())
}

/// The name of the report of a result that was not made with the bake.
pub fn report_name(format: Format) -> String {
    format!("report.{}.json", format.extension())
}

/// The name of the file that describes a result and its report. It is written last.
pub fn head_name(format: Format) -> String {
    format!("result.{}.head", format.extension())
}
