//! File names in a bake's folder. The server makes the folder, and the worker fills it.

use crate::wire::proto::OutputFormat;

pub const SPEC: &str = "spec.binpb";
/// Files named by their SHA-256.
pub const ASSETS: &str = "assets";
pub const EVENTS: &str = "events.log";
pub const REPORT: &str = "report.json";
/// The scene with every parameter set.
pub const SCENE: &str = "scene.json";

/// The name of the result file.
pub fn result_name(format: OutputFormat) -> &'static str {
    match format {
        OutputFormat::Unspecified | OutputFormat::Glb => "result.glb",
        OutputFormat::Json => "result.json",
        OutputFormat::Csv => "result.csv",
        OutputFormat::Usda => "result.usda",
        OutputFormat::Usdc => "result.usdc",
        OutputFormat::Usdz => "result.usdz",
    }
}

/// The formats that the service offers: those whose result is a single file.
pub const FORMATS: [OutputFormat; 4] = [OutputFormat::Glb, OutputFormat::Json, OutputFormat::Csv, OutputFormat::Usdz];
