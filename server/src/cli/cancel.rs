//! `cairn cancel`: cancels a bake on a server.

use super::Failure;
use super::remote::{self, RemoteBake};

/// Cancels a bake on a server
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn cancel 6e0f4c... --server farm:50151")]
pub struct Args {
    #[command(flatten)]
    bake: RemoteBake,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    remote::cancel(&args.bake)
}
