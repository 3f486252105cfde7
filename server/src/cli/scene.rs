//! `cairn scene`: prints the scene of flags as a scene file.

use super::scene_args::SceneArgs;
use super::{Failure, print, remote};
use cairn_wire::effective::effective;
use cairn_wire::scene_file::SceneTree;
use cairn_wire::{from_proto, proto};
use std::path::PathBuf;

/// Prints the scene of the flags as a scene file
///
/// Paths in it are relative to the current folder, so save the file there.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn scene --control dome.glb --prop stick.glb > pile.toml
  cairn scene pile.toml --set fill.count=200 --full")]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,

    /// Print JSON instead of TOML
    #[arg(long)]
    json: bool,

    /// Print every field; unset fields have the values of the accuracy
    #[arg(long)]
    full: bool,

    /// Write the request to a server into a folder, for programs that call one: the message `cairn.v1.BakeSpec` as
    /// `spec`, and each file of the scene, named by its SHA-256
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["json", "full"])]
    request: Option<PathBuf>,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    if let Some(folder) = &args.request {
        let tree = args.scene.tree_to_send()?;
        let files = remote::Files::read(&tree)?;
        return files.write(tree.to_message(), folder);
    }
    let mut tree = args.scene.tree()?;
    if args.full {
        let scene = tree.to_message();
        let params = from_proto::params(&scene).map_err(Failure::Input)?;
        if scene.accuracy() == proto::Accuracy::Auto {
            let what = "the parameters of accuracy auto are those of a preset, which the files decide";
            return Err(Failure::usage("--full", what, "Name a preset by --accuracy; `cairn plan` says which one."));
        }
        tree = SceneTree::from_message(&effective(&scene, &params));
    }
    print(&if args.json { tree.to_json() } else { tree.to_toml() })
}
