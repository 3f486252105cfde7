//! `cairn scene`: the scene file that equals the same flags.

use super::scene_args::SceneArgs;
use super::{Failure, print};
use crate::scene_file::SceneTree;
use crate::wire::effective::effective;
use crate::wire::from_proto;

/// Print the scene file that equals the same flags
///
/// Paths in it are relative to the current folder: keep the file there.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn scene --control dome.glb --prop stick.glb > pile.toml
  cairn scene pile.toml --set fill.count=200 --full")]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,

    /// JSON instead of TOML
    #[arg(long)]
    json: bool,

    /// Every field, with the values that the accuracy gives to those that are not set
    #[arg(long)]
    full: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let mut tree = args.scene.tree()?;
    if args.full {
        let scene = tree.to_message();
        let params = from_proto::params(&scene).map_err(Failure::Input)?;
        tree = SceneTree::from_message(&effective(&scene, &params));
    }
    print(&if args.json { tree.to_json() } else { tree.to_toml() })
}
