//! `cairn bake`: bakes a scene.

use super::bounds::{self, Bounds};
use super::cache_args::CacheArgs;
use super::goal::{self, GoalArgs, Outcome};
use super::progress::{self, Mode, ProgressArgs, Reporter};
use super::remote::{self, ConnectionArgs, Delivery, QueueArgs};
use super::scene_args::SceneArgs;
use super::{Failure, interrupt, output, print_error, print_note, print_warning, summary};
use cairn_export::{Encoded, Format};
use cairn_files::problem::Problem;
use cairn_job::goal::OVERLAP;
use cairn_job::{FinishedBake, Job, JobError};
use cairn_wire::scene_file::SceneTree;
use std::ops::ControlFlow;
use std::path::PathBuf;

/// Fills a shape with props and writes their motion
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn bake --control dome.glb --prop stick.glb -o pile.glb
  cairn bake pile.toml -o pile.glb --seed 7 --report report.json
  cairn bake pile.toml -o fallen.glb --set control=off
  cairn bake pile.toml -o pile.glb --budget 20s
  cairn bake pile.toml -o pile.glb --overlap 0.1mm
  cairn bake pile.toml -o pile.glb --server farm:50151 --token-file token --label shot=a010

The first frame is the pile right after turning over. The result appears complete or not at all, as soon as the pile is
finished; then the measures are taken and the report is written. USD holds the measures, so it appears after them.
Ctrl-C before the result appears leaves nothing behind.")]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,

    /// Result: .glb, .usdc, .usda or .usdz (animations), .json or .csv (tables of transforms), .xml or .physics.glb
    /// (the last frame for MuJoCo and for game engines, to be simulated further), .hulls.glb (the collision shapes),
    /// .pack.zip (what `cairn pack` makes); - is the standard output. The textures of a .usdc or .usda are written to
    /// the folder `textures` beside it
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,

    /// Format of the result [default: by the file extension; glb for -]
    #[arg(long, value_parser = Format::ALL.map(Format::extension))]
    format: Option<String>,

    /// Also write a report, as JSON: measures of the pile, and how it was made
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,

    #[command(flatten)]
    goal: GoalArgs,

    #[command(flatten)]
    pub progress: ProgressArgs,

    /// Number of threads; 0: one per core. The result does not depend on it
    #[arg(long, default_value_t = 0, env = "CAIRN_BAKE_THREADS")]
    threads: usize,

    /// Bake on a server: HOST:PORT or unix:PATH of a `cairn serve`
    #[arg(long, value_name = "ADDRESS", help_heading = "Server")]
    server: Option<String>,

    #[command(flatten)]
    connection: ConnectionArgs,

    #[command(flatten)]
    queue: QueueArgs,

    #[command(flatten)]
    bounds: Bounds,

    #[command(flatten)]
    cache: CacheArgs,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    interrupt::listen();
    let format = match args.format.as_deref() {
        Some(name) => Format::from_extension(name).expect("clap accepts only known formats"),
        None if output::is_stdout(&args.output) => Format::Glb,
        None => cairn_export::check_destination(&args.output)?,
    };
    if !format.is_single_file() {
        output::check_sidecars(&args.output)?;
    }
    if args.progress.mode == Mode::Openjd && output::is_stdout(&args.output) {
        let what = "progress is also written to the standard output";
        return Err(Failure::usage("--progress openjd", what, "Name a file for the result."));
    }
    let mut tree = if args.server.is_some() { args.scene.tree_to_send()? } else { args.scene.tree()? };
    args.goal.set(&mut tree);
    if let Some(server) = &args.server {
        return bake_there(args, &tree, format, server);
    }
    args.bounds.enforce(|| {
        bounds::use_threads(args.threads)?;
        goal::keep(&tree, |tree| bake(args, tree, format))
    })
}

/// The same on a server.
fn bake_there(args: &Args, tree: &SceneTree, format: Format, server: &str) -> Result<(), Failure> {
    let files = remote::Files::read(tree)?;
    check_outputs(args, files.paths())?;
    let target = args.connection.at(server)?;
    let (output, report) = (Some(&*args.output), args.report.as_deref());
    let delivery = Delivery { output, format: Some(format), report, progress: &args.progress };
    let bake = |tree: &SceneTree| remote::bake(&target, tree.to_message(), &files, format, &args.queue, &delivery);
    goal::keep(tree, bake)
}

fn bake(args: &Args, tree: &SceneTree, format: Format) -> Result<Outcome, Failure> {
    let mode = args.progress.shown();
    let job = progress::while_reading(mode, || Job::read_tree(tree, args.bounds.limits()))?;
    let job = job.relative_to(tree.folder()).written_into(cairn_files::folder_of(&args.output));
    if let Some(chosen) = job.chosen.filter(|_| !args.progress.quiet) {
        print_note(&chosen.to_string());
    }
    check_outputs(args, job.inputs())?;
    let planned = cairn_core::plan_checked(&job.scene, &job.params);
    let (plan, checked) = planned.map_err(|error| Failure::from(error).with_notes(&job.notes))?;
    output::check_room(&args.output, job.most_bytes(&plan, format))?;

    let mut reporter = Reporter::new(mode);
    // The result is written before the measures are taken.
    let mut written = None;
    let mut write = |result: &Encoded| {
        let result = output::write_before_report(&args.output, result, args.report.as_deref());
        let next = if result.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
        written = Some(result);
        next
    };
    let name = args.output.display().to_string();
    let done = job.run_and_deliver(Some(checked), format, &name, &mut args.cache.open(), &mut reporter, &mut write);
    reporter.finish(done.is_ok());
    let is_kept = || args.cache.open().bake(&job.scene, &job.params).is_some();
    let is_written = written.transpose().map_err(|failure: Failure| match failure {
        Failure::TryAgain(problem) if is_kept() => {
            Failure::TryAgain(problem.and("The cache keeps the pile until then."))
        }
        failure => failure,
    })?;
    let is_written = is_written.is_some();
    if is_written && matches!(done, Err(JobError::Bake(cairn_core::Error::Cancelled))) {
        print_error(&format!("cancelled; {name} is complete, but its measures were not taken"));
        return Err(Failure::Reported(interrupt::code()));
    }
    let done = done.map_err(|error| Failure::from(error).with_notes(&job.notes))?;
    let FinishedBake { bake, notes, report, seconds, .. } = done;
    if let Some(path) = &args.report {
        let _complete = interrupt::shield();
        output::write(path, report.as_bytes())?;
    }

    let measure = |name: &str| bake.report.measures.get(name).copied().flatten();
    if !args.progress.quiet {
        for warning in notes.iter().chain(&bake.report.warnings) {
            print_warning(warning);
        }
        let counted = |name: &str| bake.report.counts.get(name).copied().unwrap_or(0);
        if counted("steps_recalled") > 0 {
            print_note("this pile was baked before and comes from the cache (--no-cache bakes it again)");
        } else if counted("fill_steps_recalled") > 0 {
            print_note("the fill comes from the cache (--no-cache fills again)");
        }
        let (bodies, frames) = (bake.report.bodies, bake.pile.frames.len());
        summary::print(bodies, frames, measure, counted, seconds, &args.output);
    }
    Ok(Outcome { accuracy: job.params.accuracy, overlap: measure(OVERLAP) })
}

/// Checks that result and report can be written, before the bake.
fn check_outputs(args: &Args, mut inputs: Vec<PathBuf>) -> Result<(), Failure> {
    inputs.extend(args.scene.scene.clone());
    output::check(&args.output, &inputs)?;
    if let Some(report) = &args.report {
        output::check(report, &inputs)?;
        if *report == args.output {
            let what = "the report would replace the result";
            return Err(Failure::Usage(vec![Problem::at(report, what, "Name another file.")]));
        }
    }
    Ok(())
}
