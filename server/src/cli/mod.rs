//! The command line: one file per command, and what they share.

mod bake;
mod batch;
mod bounds;
mod cache_args;
mod cancel;
mod check;
mod completions;
mod cost;
mod doctor;
mod failure;
mod fault;
mod interrupt;
mod man;
mod output;
mod plan;
mod progress;
mod rank;
mod remote;
mod render;
mod scene;
mod scene_args;
mod schema;
mod serve;
mod summary;
mod verify;
mod watch;
mod worker;

use crate::trouble;
use anstream::eprintln;
use anstyle::{AnsiColor, Style};
use clap::{Parser, Subcommand};
pub use failure::Failure;
use progress::Mode;
use std::process::ExitCode;

/// Bakes piles of props in the shape of a mesh.
///
/// You model the rough shape of a pile as a closed mesh and pick the props that it is made of. Cairn fills the shape
/// with props by physics, stands it up, lets go from the bottom to the top while it keeps the shape, and writes the
/// motion of every prop.
#[derive(Parser)]
#[command(version = crate::version::BUILD, after_help = EXAMPLES, disable_help_subcommand = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Bake(bake::Args),
    Batch(batch::Args),
    Cancel(cancel::Args),
    Check(check::Args),
    Completions(completions::Args),
    Cost(cost::Args),
    Doctor(doctor::Args),
    Man(man::Args),
    Plan(plan::Args),
    Rank(rank::Args),
    Render(render::Args),
    Scene(scene::Args),
    Schema(schema::Args),
    Serve(serve::Args),
    Verify(verify::Args),
    Watch(watch::Args),
    #[command(hide = true)]
    Worker(worker::Args),
}

impl Command {
    /// How the command's progress is told, if it has any.
    fn progress(&self) -> Option<Mode> {
        match self {
            Command::Bake(args) => Some(args.progress),
            Command::Batch(args) => Some(args.progress),
            Command::Watch(args) => Some(args.progress),
            _ => None,
        }
    }
}

const EXAMPLES: &str = "\
Examples:
  cairn bake --control dome.glb --prop stick.glb -o pile.glb
        Fills dome.glb with sticks and writes an animation that any glTF viewer plays.
  cairn bake --control dome.glb --prop stick.glb --prop book.glb:0.3 -o pile.glb
        The same, with three books to ten sticks.
  cairn scene --control dome.glb --prop stick.glb > pile.toml
        Writes the same as a scene file, to keep and to edit.
  cairn check pile.toml
        Tells everything that is wrong with a scene, and what a bake would do.
  cairn plan pile.toml
        Tells what a bake would do, and what each accuracy would cost.
  cairn doctor
        Tells whether this machine is fit, and tries a small bake on it.

Exit codes: 0 done, 2 wrong usage, 65 wrong input, 70 a fault in Cairn, 75 not written (try again; SIGTERM), 130 cancelled.
Colours: as the terminal allows; the environment variable NO_COLOR switches them off.";

/// Runs the command that the process was started with.
pub fn main() -> ExitCode {
    trouble::set_up();
    let cli = Cli::parse();
    let is_openjd = cli.command.progress() == Some(Mode::Openjd);
    let result = fault::contain(|| match cli.command {
        Command::Bake(args) => bake::run(&args),
        Command::Batch(args) => batch::run(&args),
        Command::Cancel(args) => cancel::run(&args),
        Command::Check(args) => check::run(&args),
        Command::Completions(args) => completions::run(&args),
        Command::Cost(args) => cost::run(&args),
        Command::Doctor(args) => doctor::run(&args),
        Command::Man(args) => man::run(&args),
        Command::Plan(args) => plan::run(&args),
        Command::Rank(args) => rank::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Scene(args) => scene::run(&args),
        Command::Schema(args) => schema::run(&args),
        Command::Serve(args) => serve::run(&args),
        Command::Verify(args) => verify::run(&args),
        Command::Watch(args) => watch::run(&args),
        Command::Worker(args) => worker::run(&args),
    });
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            let messages = failure.messages();
            for message in &messages {
                tell("error", AnsiColor::Red, message);
            }
            if is_openjd && !messages.is_empty() {
                progress::openjd("fail", &messages.join("; "));
            }
            failure.exit_code()
        }
    }
}

/// A line on stderr: `error: ...`.
fn tell(kind: &str, color: AnsiColor, message: &str) {
    let style = Style::new().bold().fg_color(Some(color.into()));
    eprintln!("{style}{kind}:{style:#} {message}");
}

/// Prints what was asked for on stdout. A reader that has gone away is no error.
fn print(text: &str) -> Result<(), Failure> {
    use std::io::{ErrorKind, Write};
    let mut stdout = std::io::stdout().lock();
    match trouble::write("stdout-write", &mut stdout, text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::write("the standard output".as_ref(), error))
        }
        _ => Ok(()),
    }
}
