//! `cairn completions`: completion scripts for shells.

use super::{Cli, Failure, print};
use clap::CommandFactory;
use clap_complete::Shell;

/// Prints a script with which a shell completes cairn's command lines
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn completions bash > /etc/bash_completion.d/cairn
  cairn completions zsh > ~/.zfunc/_cairn
  cairn completions fish > ~/.config/fish/completions/cairn.fish
  cairn completions powershell >> $PROFILE")]
pub struct Args {
    /// Shell to print the script for
    shell: Shell,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "cairn", &mut script);
    print(&String::from_utf8_lossy(&script))
}
