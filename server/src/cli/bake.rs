//! `cairn bake`: the main job.

use super::bounds::Bounds;
use super::cache_args::CacheArgs;
use super::progress::{self, Mode, Reporter};
use super::remote::{self, Access, Asked, Wanted};
use super::scene_args::SceneArgs;
use super::{Failure, interrupt, output, summary, tell};
use crate::job::{self, Job, Outcome, machine};
use crate::model::export::{self, Encoded, Format};
use crate::problem::Problem;
use crate::scene_file::SceneTree;
use anstyle::AnsiColor;
use std::ops::ControlFlow;
use std::path::PathBuf;

/// Fill a shape with props and write their motion
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn bake --control dome.glb --prop stick.glb -o pile.glb
  cairn bake pile.toml -o pile.glb --seed 7 --report report.json
  cairn bake pile.toml -o fallen.glb --set control=off
  cairn bake pile.toml -o pile.glb --server farm:50151 --token-file token --label shot=a010

The first frame is the pile right after turning over. A result appears complete or not at all, as soon as the pile is
done; then its figures are found, and the report is written. USD holds the figures, too, and waits for them. Ctrl-C before a result
is there leaves nothing behind.")]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,

    /// Result: .glb, .usdc, .usda or .usdz (animations), .json or .csv (tables of transforms); - is the standard output. The pictures of
    /// a .usdc or .usda are in the folder `textures` beside it
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,

    /// What the result is, where its name does not tell [default: the name's ending; glb for -]
    #[arg(long, value_parser = Format::NAMES)]
    format: Option<String>,

    /// Also write how good the pile is and how it was made, as JSON
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,

    /// How progress is told; on stderr, where nothing else is said
    #[arg(long, value_enum, default_value_t = Mode::Auto)]
    pub progress: Mode,

    /// Tell nothing but errors
    #[arg(short, long)]
    quiet: bool,

    /// Threads to bake with; 0: one per core. The result is the same with any number
    #[arg(long, default_value_t = 0, env = "CAIRN_BAKE_THREADS")]
    threads: usize,

    /// Bake on a server: HOST:PORT or unix:PATH of a `cairn serve`
    #[arg(long, value_name = "ADDRESS", help_heading = "Server")]
    server: Option<String>,

    #[command(flatten)]
    access: Access,

    #[command(flatten)]
    asked: Asked,

    #[command(flatten)]
    bounds: Bounds,

    #[command(flatten)]
    cache: CacheArgs,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    interrupt::listen();
    let format = match args.format.as_deref() {
        Some(name) => Format::named(name).expect("one of those that the command line takes"),
        None if output::is_stdout(&args.output) => Format::Glb,
        None => export::check_destination(&args.output)?,
    };
    if format.has_files_beside() {
        output::check_beside(&args.output, args.server.is_some())?;
    }
    if args.progress == Mode::Openjd && output::is_stdout(&args.output) {
        let what = "the progress goes to the standard output, too";
        return Err(Failure::Usage(vec![Problem::new("--progress openjd", what, "Name a file for the result.")]));
    }
    let tree = args.scene.tree()?;
    let scene = tree.to_message();
    if let Some(server) = &args.server {
        let files = remote::Files::read(&scene, tree.folder())?;
        check_outputs(args, files.paths())?;
        let (output, report) = (Some(&*args.output), args.report.as_deref());
        let wanted = Wanted { output, report, progress: args.progress, quiet: args.quiet };
        return remote::bake(&args.access.at(server)?, scene, files, format, &args.asked, &wanted);
    }
    args.bounds.hold(|| bake(args, &tree, format))
}

fn bake(args: &Args, tree: &SceneTree, format: Format) -> Result<(), Failure> {
    machine::use_threads(args.threads).map_err(|error| Failure::Internal(error.to_string()))?;
    let mode = if args.quiet { Mode::None } else { args.progress };
    let job = progress::while_reading(mode, || Job::read_within(&tree.to_message(), args.bounds.limits()))
        .map_err(Failure::Input)?
        .relative_to(tree.folder());
    check_outputs(args, job.inputs())?;

    let mut reporter = Reporter::new(mode);
    // The result does not wait for its figures.
    let mut written = None;
    let mut write = |result: &Encoded| {
        let outcome = output::write_before_report(&args.output, result, args.report.as_deref());
        let next = if outcome.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
        written = Some(outcome);
        next
    };
    let name = args.output.display().to_string();
    let done = job.run_and_deliver(format, &name, &mut args.cache.open(), &mut reporter, &mut write);
    reporter.finish(done.is_ok());
    let is_written = written.transpose()?.is_some();
    if is_written && matches!(done, Err(job::Error::Bake(cairn_core::Error::Cancelled))) {
        tell("error", AnsiColor::Red, &format!("cancelled; {name} is complete, but its figures were not found"));
        return Err(Failure::Told(interrupt::code()));
    }
    let Outcome { bake, report, seconds, .. } = done?;
    if let Some(path) = &args.report {
        let _complete = interrupt::shield();
        output::write(path, report.as_bytes())?;
    }

    if !args.quiet {
        for warning in job.notes.iter().chain(&bake.report.warnings) {
            tell("warning", AnsiColor::Yellow, warning);
        }
        let counted = |name: &str| bake.report.counts.get(name).copied().unwrap_or(0);
        let recalled = |name: &str| counted(name) > 0;
        if recalled("steps_recalled") {
            tell(
                "note",
                AnsiColor::Cyan,
                "nothing was simulated: this very pile was baked before (--no-cache bakes anew)",
            );
        } else if recalled("fill_steps_recalled") {
            tell("note", AnsiColor::Cyan, "the fill is that of an earlier bake (--no-cache fills anew)");
        }
        let measure = |name: &str| bake.report.measures.get(name).copied().flatten();
        let (bodies, frames) = (bake.report.bodies, bake.pile.frames.len());
        for line in summary::lines(bodies, frames, measure, counted, seconds, &args.output) {
            anstream::eprintln!("{line}");
        }
    }
    Ok(())
}

/// Both files can be written: asked before the long part.
fn check_outputs(args: &Args, mut inputs: Vec<PathBuf>) -> Result<(), Failure> {
    inputs.extend(args.scene.scene.clone());
    output::check(&args.output, &inputs)?;
    if let Some(report) = &args.report {
        output::check(report, &inputs)?;
        if *report == args.output {
            let problem =
                Problem::new(report.display().to_string(), "the report would replace the result", "Name another file.");
            return Err(Failure::Usage(vec![problem]));
        }
    }
    Ok(())
}
