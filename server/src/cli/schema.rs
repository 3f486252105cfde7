//! `cairn schema`: the JSON Schema of scene files, for editors.

use super::{Failure, print};
use cairn_wire::scene_file::json_schema;

/// Prints the JSON Schema of scene files, for editors
///
/// With it, an editor completes the fields of a scene file, explains them and marks mistakes.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn schema > scene.schema.json

A TOML scene names it in its first line, `#:schema ./scene.schema.json`; for JSON, set it in the editor's settings.")]
pub struct Args {}

pub fn run(_: &Args) -> Result<(), Failure> {
    print(&format!("{:#}\n", json_schema::scene()))
}
