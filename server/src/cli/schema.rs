//! `cairn schema`: what an editor needs to complete and check a scene file.

use super::{Failure, print};
use crate::scene_file::json_schema;

/// Print the JSON Schema of scene files, for editors
///
/// With it an editor completes the fields of a scene file, tells what they mean, and marks what is wrong.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn schema > scene.schema.json

A TOML scene names it in its first line, `#:schema ./scene.schema.json`; for JSON it is set in the editor's settings.")]
pub struct Args {}

pub fn run(_: &Args) -> Result<(), Failure> {
    print(&format!("{:#}\n", json_schema::scene()))
}
