//! `cairn watch`: follows a bake on a server.

use super::remote::{self, Delivery, RemoteBake};
use super::{Failure, interrupt, output, progress::ProgressArgs};
use std::path::PathBuf;

/// Watches a bake on a server, and downloads its result
///
/// Ctrl-C stops the watching; the bake continues.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn watch 6e0f4c... --server farm:50151
  cairn watch 6e0f4c... -o pile.usdz")]
pub struct Args {
    #[command(flatten)]
    bake: RemoteBake,

    /// File for the result, in the format of its extension
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,

    /// Also download the report, as JSON: measures of the pile, and how it was made
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,

    #[command(flatten)]
    pub progress: ProgressArgs,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    interrupt::listen();
    for path in args.output.iter().chain(&args.report) {
        output::check(path, &[])?;
    }
    let (output, report) = (args.output.as_deref(), args.report.as_deref());
    let format = output.filter(|output| !output::is_stdout(output)).map(cairn_export::check_destination).transpose()?;
    if let Some(output) = output.filter(|_| format.is_some_and(|format| !format.is_single_file())) {
        output::check_sidecars(output)?;
    }
    remote::watch(&args.bake, &Delivery { output, format, report, progress: &args.progress })
}
