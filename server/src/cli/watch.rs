//! `cairn watch`: a bake on a server, from wherever it stands.

use super::remote::{self, RemoteBake, Wanted};
use super::{Failure, interrupt, output, progress::Mode};
use std::path::PathBuf;

/// Watch a bake on a server, and fetch its result
///
/// Ctrl-C ends the watching; the bake goes on.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn watch 6e0f4c... --server farm:50151
  cairn watch 6e0f4c... -o pile.glb")]
pub struct Args {
    #[command(flatten)]
    bake: RemoteBake,

    /// Where the result goes, in the format that the bake was asked for
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,

    /// Also fetch how good the pile is and how it was made, as JSON
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,

    /// How progress is told; on stderr, where nothing else is said
    #[arg(long, value_enum, default_value_t = Mode::Auto)]
    pub progress: Mode,

    /// Tell nothing but errors
    #[arg(short, long)]
    quiet: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    interrupt::listen();
    for path in args.output.iter().chain(&args.report) {
        output::check(path, &[])?;
    }
    let (output, report) = (args.output.as_deref(), args.report.as_deref());
    let wanted = Wanted { output, report, progress: args.progress, quiet: args.quiet };
    remote::watch(&args.bake, &wanted)
}
