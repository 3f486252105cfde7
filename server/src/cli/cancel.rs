//! `cairn cancel`: ends a bake on a server.

use super::Failure;
use super::remote::{self, Access};

/// End a bake on a server
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn cancel 6e0f4c... --server farm:50151")]
pub struct Args {
    /// The bake's id, as `cairn bake --server` tells it
    id: String,

    /// HOST:PORT or unix:PATH of a `cairn serve`
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:50151", help_heading = "Server")]
    server: String,

    #[command(flatten)]
    access: Access,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    remote::cancel(&args.access.at(&args.server)?, &args.id)
}
