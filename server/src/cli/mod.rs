//! The command line: one file per command, and shared parts.

mod allowed;
mod analyse;
mod analysis_summary;
mod bake;
mod bakes;
mod batch;
mod bounds;
mod cache_args;
mod cancel;
mod check;
mod clutter;
mod completions;
mod cost;
mod doctor;
mod failure;
mod goal;
mod interrupt;
mod man;
mod mcp;
mod output;
mod pack;
mod panic;
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

use anstream::eprintln;
use anstyle::{AnsiColor, Style};
use cairn_files::failpoints;
use cairn_files::problem::Problem;
use clap::error::ErrorKind;
use clap::{CommandFactory, Parser, Subcommand};
use comfy_table::{CellAlignment, Table, presets};
pub use failure::Failure;
use progress::Mode;
use serde_json::json;
use std::ffi::OsStr;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

/// Bakes piles of props in the shape of a mesh.
///
/// Model the rough shape of a pile as a closed mesh and choose its props. Cairn fills the shape with props by physics,
/// turns it over, releases it from the bottom to the top while it keeps the shape, and writes the motion of every prop.
#[derive(Parser)]
#[command(version = cairn_files::version::BUILD, after_help = EXAMPLES, disable_help_subcommand = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Analyse(analyse::Args),
    Bake(bake::Args),
    Bakes(bakes::Args),
    Batch(batch::Args),
    Cancel(cancel::Args),
    Check(check::Args),
    Clutter(clutter::Args),
    Completions(completions::Args),
    Cost(cost::Args),
    Doctor(doctor::Args),
    Man(man::Args),
    Mcp(mcp::Args),
    Pack(pack::Args),
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
    /// The command's form of progress, if it shows any.
    fn progress(&self) -> Option<Mode> {
        match self {
            Command::Bake(args) => Some(args.progress.mode),
            Command::Batch(args) => Some(args.progress),
            Command::Clutter(args) => Some(args.progress),
            Command::Verify(args) => Some(args.progress),
            Command::Watch(args) => Some(args.progress.mode),
            _ => None,
        }
    }
}

const EXAMPLES: &str = "\
Examples:
  cairn bake --control dome.glb --prop stick.glb -o pile.glb
        Fills dome.glb with sticks and writes an animation that any glTF viewer plays.
  cairn bake --control dome.glb --prop stick.glb --prop book.glb:0.3 -o pile.glb
        The same with three books to ten sticks.
  cairn scene --control dome.glb --prop stick.glb > pile.toml
        Writes the same scene to a file that you can edit.
  cairn check pile.toml
        Validates the scene and summarizes the bake without simulating it.
  cairn plan pile.toml
        Summarizes the bake and estimates the cost of each accuracy.
  cairn doctor
        Checks this machine, and tests a small bake on it.

Exit codes: 0 success, 2 wrong usage, 65 wrong input, 69 address or data in use, 70 fault in Cairn, 75 not written or
SIGTERM (try again), 78 wrong settings of a server, 130 cancelled.
Colors: if the terminal supports them; the environment variable NO_COLOR turns them off.";

/// Whether the lines on stderr are JSON objects.
static AS_JSON: AtomicBool = AtomicBool::new(false);

fn is_json() -> bool {
    AS_JSON.load(Ordering::Relaxed)
}

/// Whether a command line that cannot be read asks for JSON lines.
fn asks_for_json(args: impl Iterator<Item = String>) -> bool {
    let args: Vec<String> = args.collect();
    let is_pair = |pair: &[String]| pair[0] == "--progress" && pair[1] == "json";
    args.windows(2).any(is_pair) || args.iter().any(|arg| arg == "--progress=json")
}

/// The command line as text, whatever is in it.
fn args() -> impl Iterator<Item = String> {
    std::env::args_os().map(|arg| arg.to_string_lossy().into_owned())
}

/// The problem of an argument that names a model, as scenes hold it, and is no text.
fn no_text(arg: &OsStr) -> Problem {
    let what = "this name is not UTF-8 text, and a scene can only hold such names";
    Problem::new(arg.to_string_lossy(), what, "Rename the file, or the folder that has such a name.")
}

/// Runs the command of the command line.
pub fn main() -> ExitCode {
    failpoints::set_up();
    let cli = Cli::try_parse().unwrap_or_else(|error| {
        AS_JSON.store(error.use_stderr() && asks_for_json(args()), Ordering::Relaxed);
        let odd = std::env::args_os().find(|arg| arg.to_str().is_none());
        if let Some(odd) = odd.filter(|_| error.kind() == ErrorKind::InvalidUtf8) {
            print_error(&no_text(&odd).to_string());
            std::process::exit(error.exit_code());
        }
        if is_json() {
            print_error(error.to_string().trim_start_matches("error: ").trim());
            std::process::exit(error.exit_code());
        }
        error.exit()
    });
    let is_openjd = cli.command.progress() == Some(Mode::Openjd);
    AS_JSON.store(cli.command.progress() == Some(Mode::Json), Ordering::Relaxed);
    let result = panic::catch(|| match cli.command {
        Command::Analyse(args) => analyse::run(&args),
        Command::Bake(args) => bake::run(&args),
        Command::Bakes(args) => bakes::run(&args),
        Command::Batch(args) => batch::run(&args),
        Command::Cancel(args) => cancel::run(&args),
        Command::Check(args) => check::run(&args),
        Command::Clutter(args) => clutter::run(&args),
        Command::Completions(args) => completions::run(&args),
        Command::Cost(args) => cost::run(&args),
        Command::Doctor(args) => doctor::run(&args),
        Command::Man(args) => man::run(&args),
        Command::Mcp(args) => mcp::run(&args),
        Command::Pack(args) => pack::run(&args),
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
                print_error(message);
            }
            for note in failure.notes() {
                print_note(note);
            }
            if matches!(failure, Failure::Usage(_)) && !is_json() {
                eprintln!("\n{}", usage(args().skip(1)));
            }
            if is_openjd && !messages.is_empty() {
                progress::openjd("fail", &messages.join("; "));
            }
            failure.exit_code()
        }
    }
}

/// The usage line of the command that arguments begin with.
fn usage(args: impl Iterator<Item = String>) -> String {
    let mut command = Cli::command();
    command.build();
    let mut at = &mut command;
    for name in args {
        match at.find_subcommand(&name) {
            Some(_) => at = at.find_subcommand_mut(&name).expect("it was found"),
            None => break,
        }
    }
    at.render_usage().to_string()
}

fn print_error(message: &str) {
    print_message("error", AnsiColor::Red, message);
}

fn print_warning(message: &str) {
    print_message("warning", AnsiColor::Yellow, message);
}

fn print_note(message: &str) {
    print_message("note", AnsiColor::Cyan, message);
}

/// Prints what a command has done, as lines or as a JSON object, on stderr.
fn print_done(lines: impl IntoIterator<Item = String>, object: impl FnOnce() -> serde_json::Value) {
    match is_json() {
        true => std::eprintln!("{}", object()),
        false => lines.into_iter().for_each(|line| eprintln!("{line}")),
    }
}

/// Prints a line on stderr: `error: ...`.
fn print_message(kind: &str, color: AnsiColor, message: &str) {
    if is_json() {
        return std::eprintln!("{}", json!({ kind: message }));
    }
    let style = Style::new().bold().fg_color(Some(color.into()));
    eprintln!("{style}{kind}:{style:#} {message}");
}

/// A table as text. The columns after the second are aligned right.
fn table(header: Vec<String>, rows: impl Iterator<Item = Vec<String>>) -> String {
    let mut table = Table::new();
    table.load_style(presets::NOTHING);
    table.set_header(header);
    for column in table.column_iter_mut().skip(2) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    for row in rows {
        table.add_row(row);
    }
    table.lines().map(|line| line.trim().to_owned() + "\n").collect()
}

/// Prints a command's output on stdout. A closed pipe is no error.
fn print(text: &str) -> Result<(), Failure> {
    use std::io::{ErrorKind, Write};
    let mut stdout = std::io::stdout().lock();
    match failpoints::write("stdout-write", &mut stdout, text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::write("the standard output".as_ref(), &error))
        }
        _ => Ok(()),
    }
}
