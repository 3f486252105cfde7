//! `cairn scene`: the scene file that equals the same flags.

use super::scene_args::SceneArgs;
use super::{Failure, output, print, remote};
use crate::scene_file::SceneTree;
use crate::wire::effective::effective;
use crate::wire::from_proto;
use prost::Message;
use std::path::Path;

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

    /// What a server is asked, for programs that call one: the message `cairn.v1.BakeSpec`, as bytes, with the names and
    /// hashes of all files
    #[arg(long, conflicts_with_all = ["json", "full"])]
    request: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let mut tree = args.scene.tree()?;
    if args.request {
        let scene = tree.to_message();
        let files = remote::Files::read(&scene, args.scene.folder())?;
        return output::write(Path::new("-"), &files.spec(scene).encode_to_vec());
    }
    if args.full {
        let scene = tree.to_message();
        let params = from_proto::params(&scene).map_err(Failure::Input)?;
        tree = SceneTree::from_message(&effective(&scene, &params));
    }
    print(&if args.json { tree.to_json() } else { tree.to_toml() })
}
