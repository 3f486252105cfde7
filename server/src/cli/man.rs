//! `cairn man`: the manual pages.

use super::{Cli, Failure, output, print};
use cairn_files::problem::nearest;
use clap::{Command, CommandFactory};
use clap_mangen::Man;
use std::path::PathBuf;

/// Prints a manual page, or writes all of them
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn man bake | man -l -
  cairn man --output /usr/local/share/man/man1")]
pub struct Args {
    /// Command to print the page of [default: cairn itself]
    command: Option<String>,

    /// Write all pages into this folder instead
    #[arg(short, long, value_name = "FOLDER", conflicts_with = "command")]
    output: Option<PathBuf>,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    // This makes pages use full names: `cairn bake`.
    let mut cairn = Cli::command();
    cairn.build();
    let commands: Vec<&Command> = cairn.get_subcommands().filter(|command| !command.is_hide_set()).collect();
    if let Some(folder) = &args.output {
        let pages = std::iter::once(&cairn).chain(commands);
        for command in pages {
            let path = folder.join(format!("{}.1", page_name(command)));
            output::check(&path, &[])?;
            output::write(&path, &page(command)?)?;
        }
        return Ok(());
    }
    let Some(wanted) = &args.command else { return print(&String::from_utf8_lossy(&page(&cairn)?)) };
    match commands.iter().find(|command| command.get_name() == wanted) {
        Some(command) => print(&String::from_utf8_lossy(&page(command)?)),
        None => {
            let names: Vec<&str> = commands.iter().map(|command| command.get_name()).collect();
            let remedy = match nearest(wanted, names.iter().copied()) {
                Some(name) => format!("Did you mean `{name}`?"),
                None => format!("Available: {}.", names.join(", ")),
            };
            Err(Failure::usage(wanted, "no such command", remedy))
        }
    }
}

/// `cairn-bake`.
fn page_name(command: &Command) -> String {
    command.get_display_name().unwrap_or(command.get_name()).to_owned()
}

fn page(command: &Command) -> Result<Vec<u8>, Failure> {
    let mut page = Vec::new();
    let man =
        Man::new(command.clone()).title(page_name(command)).source(format!("cairn {}", cairn_files::version::VERSION));
    man.render(&mut page).map_err(|error| Failure::Internal(error.to_string()))?;
    Ok(page)
}
