//! `cairn batch`: bakes a matrix of variants on this machine.

mod overview;
mod process_pool;

use super::bounds::Bounds;
use super::cache_args::CacheArgs;
use super::progress::{self, Mode};
use super::remote::{ConnectionArgs, QueueArgs};
use super::scene_args::SceneArgs;
use super::{Failure, interrupt, output, print, print_error};
use crate::batch::finished::{Assets, RequestHashes, is_finished};
use crate::batch::{Matrix, Seeds, Span, Variant, Vary};
use cairn_export::Format;
use cairn_files::failpoints;
use cairn_files::problem::Problem;
use cairn_job::{Job, Refused};
use overview::{BatchProgress, VariantOutcome};
use process_pool::{BakeEnd, PoolEvent, PoolTask};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::PathBuf;

/// Bakes variants of a scene: every seed with every combination of values
///
/// With `--server`, they are baked there, as many at once as `--jobs` says.
///
/// Each result has its report beside it (3.glb, 3.report.json). Run again, it bakes only missing results. It recognizes
/// results by the hash of scene, files, parameters, seed and version in their reports, and checks the hash of their
/// bytes. A failed bake does not stop the others.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn batch pile.toml --seeds 0..49 -o out/{seed}.glb
  cairn batch pile.toml --seeds 0..9 --vary accuracy=draft,standard --vary props.0.weight=0.2,0.8 \\
        -o out/{seed}-{accuracy}-{weight}.glb
  cairn batch pile.toml --seeds 0..49 -o out/{seed}.glb --range 8-15     (a part of it, for array jobs)
  cairn batch pile.toml --seeds 0..99 -o data/{seed}.glb --remove-sequences 5

Variants that differ only after the fill, in fields of control, glue or output, share one fill. The exit code is the
worst one of the bakes.")]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,

    /// Seeds, both ends included: 0..49, or 1,5,9 [default: the scene's own]
    #[arg(long)]
    seeds: Option<Seeds>,

    /// A field and its values; repeat it to combine several fields
    #[arg(long, value_name = "FIELD=VALUE,VALUE")]
    vary: Vec<Vary>,

    /// Paths of the results, with {seed}, {index} or names of varied fields, or {seed:04} for numbers with zeros before
    /// them; the extension sets the format
    #[arg(short, long, value_name = "PATTERN")]
    output: String,

    /// Take each pile apart once it rests, by this many bodies in an order drawn by its seed; the reports have each
    /// state: poses, contacts with forces, the forecast, and what happened
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    remove_sequences: Option<u32>,

    /// Bake only these variants, counted from 0, both ends included: 8-15, or 8
    #[arg(long, value_name = "FIRST-LAST")]
    range: Option<Span>,

    /// Number of simultaneous bakes; 0: one per core
    #[arg(long, default_value_t = 0, env = "CAIRN_BATCH_JOBS")]
    jobs: usize,

    /// Only list the variants
    #[arg(long)]
    dry_run: bool,

    /// Print the variants as JSON: index, result, state, and the figures of the table
    #[arg(long)]
    json: bool,

    /// Form of the progress on stderr, unless stated otherwise
    #[arg(long, value_enum, default_value_t = Mode::Auto)]
    pub progress: Mode,

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
    let scene_args = match args.remove_sequences {
        Some(count) => args.scene.with(format!("remove=[{{choice=\"any\",count={count}}}]")),
        None => args.scene.clone(),
    };
    let scene = scene_args.tree()?;
    let matrix = Matrix { scene: &scene, seeds: args.seeds.as_ref(), vary: &args.vary, output: &args.output };
    let variants = part(matrix.variants().map_err(Failure::Usage)?, args.range)?;
    let hashes = request_hashes(&variants)?;
    let finished: Vec<bool> = (variants.par_iter().zip(&hashes))
        .map(|(variant, hashes)| is_finished(&variant.output, &variant.report(), &hashes.requests))
        .collect();
    let missing: Vec<usize> = (0..variants.len()).filter(|&i| !finished[i]).collect();
    if args.dry_run && args.json {
        let list = variants.iter().zip(&finished).map(|(variant, is_there)| {
            let state = if *is_there { "finished" } else { "missing" };
            json!({ "index": variant.index, "result": variant.output, "state": state })
        });
        return print(&format!("{:#}\n", list.collect::<Value>()));
    }
    if args.dry_run {
        let lines = variants.iter().zip(&finished).map(|(variant, is_there)| {
            let state = if *is_there { "finished" } else { "missing" };
            format!("{}  {}  {state}\n", variant.index, variant.output.display())
        });
        return print(&lines.collect::<String>());
    }
    check(args, &variants, &missing)?;
    let ends = bake(args, &scene_args, &variants, &hashes, &missing)?;
    report_outcomes(&variants, &finished, ends, args.json)
}

fn part(variants: Vec<Variant>, range: Option<Span>) -> Result<Vec<Variant>, Failure> {
    let Some(Span { first, last }) = range else { return Ok(variants) };
    let count = variants.len();
    if first >= count as u64 {
        let what = format!("there are {count} variants, counted from 0");
        return Err(Failure::usage(format!("--range {first}-{last}"), what, "Choose some of them."));
    }
    Ok(variants.into_iter().filter(|variant| (first..=last).contains(&(variant.index as u64))).collect())
}

/// The request of each variant.
fn request_hashes(variants: &[Variant]) -> Result<Vec<RequestHashes>, Failure> {
    let (mut assets, mut hashes, mut problems) = (Assets::default(), Vec::new(), Vec::new());
    for variant in variants {
        match assets.hashes(variant) {
            Ok(one) => hashes.push(one),
            Err(found) => problems.extend(found),
        }
    }
    fail_for(problems).map(|()| hashes)
}

/// Fails if there are problems, with each of them once.
fn fail_for(mut problems: Vec<Problem>) -> Result<(), Failure> {
    let mut seen = BTreeSet::new();
    problems.retain(|problem| seen.insert(problem.to_string()));
    if problems.is_empty() { Ok(()) } else { Err(Failure::Input(problems)) }
}

/// Before any work, creates the folders and checks that every varied value can be baked.
fn check(args: &Args, variants: &[Variant], missing: &[usize]) -> Result<(), Failure> {
    let inputs: Vec<PathBuf> = args.scene.scene.iter().cloned().collect();
    let (mut problems, mut notes) = (Vec::<Problem>::new(), Vec::new());
    let mut folders = BTreeSet::new();
    for variant in missing.iter().map(|&i| &variants[i]) {
        let folder = cairn_files::folder_of(&variant.output);
        if folders.insert(folder) {
            failpoints::at("batch-folder")
                .and_then(|()| std::fs::create_dir_all(folder))
                .map_err(|error| Failure::write(folder, &error))?;
            output::check(&variant.output, &inputs)?;
        }
    }
    let mut samples: Vec<&Variant> =
        missing.iter().map(|&i| &variants[i]).filter(|variant| variant.is_sample).collect();
    if samples.is_empty() {
        samples.extend(missing.first().map(|&i| &variants[i]));
    }
    // The largest of the samples' results counts for all.
    let mut most_bytes = 0;
    progress::while_reading(args.progress, || {
        for variant in samples {
            let job = Job::read_tree(&variant.tree, args.bounds.limits());
            let checked = job.and_then(|job| match cairn_core::plan(&job.scene, &job.params) {
                Err(cairn_core::Error::Invalid(found)) => {
                    Err(Refused { problems: found.into_iter().map(Problem::from).collect(), notes: job.notes })
                }
                Ok(plan) => Ok(Format::of(&variant.output).map_or(0, |format| job.most_bytes(&plan, format))),
                Err(_) => Ok(0),
            });
            match checked {
                Ok(bytes) => most_bytes = bytes.max(most_bytes),
                Err(refused) => {
                    problems.extend(refused.problems);
                    notes.extend(refused.notes);
                }
            }
        }
    });
    notes.dedup();
    fail_for(problems).map_err(|failure| failure.with_notes(&notes))?;
    match missing.first() {
        Some(&first) => output::check_room(&variants[first].output, most_bytes * missing.len() as u64),
        None => Ok(()),
    }
}

/// The end of each missing variant; `None`: it was not started.
type Ends = Vec<(usize, Option<BakeEnd>)>;

fn bake(
    args: &Args,
    scene_args: &SceneArgs,
    variants: &[Variant],
    hashes: &[RequestHashes],
    missing: &[usize],
) -> Result<Ends, Failure> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = if args.jobs == 0 { cores } else { args.jobs };
    let threads = (cores / jobs.min(missing.len()).max(1)).max(1);
    let mut common = scene_args.to_args();
    common.extend(args.bounds.to_args());
    common.extend(args.cache.to_args());
    common.extend(["--threads".into(), threads.to_string().into()]);
    if let Some(server) = &args.server {
        common.extend(["--server".into(), server.into()]);
        common.extend(args.connection.to_args());
        common.extend(args.queue.to_args());
    }
    let task = |&number: &usize| {
        let variant = &variants[number];
        let set = variant.assignments.iter().flat_map(|assignment| ["--set".into(), OsString::from(assignment)]);
        let files = ["-o".into(), variant.output.clone().into(), "--report".into(), variant.report().into()];
        let fill = args.cache.is_used().then_some(hashes[number].fill);
        PoolTask { args: common.iter().cloned().chain(set).chain(files).collect(), fill }
    };
    let tasks: Vec<PoolTask> = missing.iter().map(task).collect();
    let mut ends: Ends = missing.iter().map(|&number| (number, None)).collect();
    let mut progress = BatchProgress::new(args.progress, tasks.len());
    process_pool::work(&tasks, jobs, |event| match event {
        PoolEvent::Progress(task, fraction) => progress.update(task, fraction),
        PoolEvent::Ended(task, end) => {
            progress.end(task, &end, &variants[missing[task]].output.display().to_string());
            ends[task].1 = Some(end);
        }
    });
    progress.finish();
    Ok(ends)
}

fn report_outcomes(variants: &[Variant], finished: &[bool], mut ends: Ends, as_json: bool) -> Result<(), Failure> {
    /// Exit codes of bakes, worst first; other codes are worse still. A killed bake counts as one to try again.
    const WORST: [u8; 4] = [70, 65, 2, 75];
    let mut codes = Vec::new();
    let mut outcomes: Vec<(&Variant, VariantOutcome)> =
        variants.iter().map(|variant| (variant, VariantOutcome::Skipped)).collect();
    for (number, end) in ends.drain(..) {
        debug_assert!(!finished[number]);
        outcomes[number].1 = match end {
            Some(BakeEnd::Done) => VariantOutcome::Baked,
            Some(BakeEnd::Cancelled) | None => VariantOutcome::NotBaked,
            Some(BakeEnd::Failed(code, why)) => {
                codes.push(code.unwrap_or(75));
                VariantOutcome::Failed(why)
            }
        };
    }
    match as_json {
        true => print(&format!("{:#}\n", overview::json(&outcomes)))?,
        false => print(&overview::table(&outcomes))?,
    }
    for (variant, outcome) in &outcomes {
        if let VariantOutcome::Failed(why) = outcome {
            print_error(&format!("{}: {why}", variant.output.display()));
        }
    }
    if interrupt::is_requested() {
        print_error("cancelled; finished results stay, and the same command bakes the others");
        return Err(Failure::Reported(interrupt::code()));
    }
    let rank = |code: &u8| WORST.iter().position(|other| other == code).map_or(0, |at| at + 1);
    codes.into_iter().min_by_key(rank).map_or(Ok(()), |code| Err(Failure::Reported(code)))
}
