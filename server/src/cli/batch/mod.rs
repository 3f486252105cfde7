//! `cairn batch`: a matrix of bakes on this machine.

mod crew;
mod told;

use super::bounds::Bounds;
use super::cache_args::CacheArgs;
use super::progress::{self, Mode};
use super::scene_args::SceneArgs;
use super::{Failure, interrupt, output, print, tell};
use crate::batch::finished::{Asked, Assets, is_finished};
use crate::batch::{Matrix, Seeds, Span, Variant, Vary};
use crate::job::Job;
use crate::problem::Problem;
use crate::trouble;
use anstyle::AnsiColor;
use crew::{End, News, Task};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::PathBuf;
use told::{Outcome, Overall};

/// Bake variants of a scene: every seed with every combination of values
///
/// Each result gets its report beside it (3.glb, 3.report.json). Called again, it bakes only what is not there yet: a result is known by
/// the hash of scene, files, parameters, seed and version in its report, and held against that of its bytes. A bake that fails does not
/// end the others.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn batch pile.toml --seeds 0..49 -o out/{seed}.glb
  cairn batch pile.toml --seeds 0..9 --vary accuracy=draft,standard --vary props.0.weight=0.2,0.8 \\
        -o out/{seed}-{accuracy}-{weight}.glb
  cairn batch pile.toml --seeds 0..49 -o out/{seed}.glb --range 8-15     (a part of the same: for array jobs)

Variants that differ only in what comes after the fill share it, and it is simulated once: give control, glue or output
fields for that. Ends with the worst of its bakes' exit codes.")]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,

    /// Seeds, both ends included: 0..49, or 1,5,9 [default: the scene's own]
    #[arg(long)]
    seeds: Option<Seeds>,

    /// A field and the values that it takes; repeat it for several fields, which are combined
    #[arg(long, value_name = "FIELD=VALUE,VALUE")]
    vary: Vec<Vary>,

    /// Results: a path with {seed}, {index} or names of varied fields in it; its ending tells the format
    #[arg(short, long, value_name = "PATTERN")]
    output: String,

    /// Bake only these of the matrix, counted from 0, both ends included: 8-15, or 8
    #[arg(long, value_name = "FIRST-LAST")]
    range: Option<Span>,

    /// Bakes at the same time; 0: one per core
    #[arg(long, default_value_t = 0, env = "CAIRN_BATCH_JOBS")]
    jobs: usize,

    /// Only tell what would be baked
    #[arg(long)]
    dry_run: bool,

    /// How progress is told; on stderr, where nothing else is said
    #[arg(long, value_enum, default_value_t = Mode::Auto)]
    pub progress: Mode,

    #[command(flatten)]
    bounds: Bounds,

    #[command(flatten)]
    cache: CacheArgs,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    interrupt::listen();
    let scene = args.scene.tree()?;
    let matrix = Matrix { scene: &scene, seeds: args.seeds.as_ref(), vary: &args.vary, output: &args.output };
    let variants = part(matrix.variants().map_err(Failure::Usage)?, args.range)?;
    let asked = asked(&variants)?;
    let finished: Vec<bool> = (variants.par_iter().zip(&asked))
        .map(|(variant, asked)| is_finished(&variant.output, &variant.report(), &asked.hash))
        .collect();
    let missing: Vec<usize> = (0..variants.len()).filter(|&i| !finished[i]).collect();
    if args.dry_run {
        let lines = variants.iter().zip(&finished).map(|(variant, is_there)| {
            let state = if *is_there { "is there" } else { "to be baked" };
            format!("{}  {}  {state}\n", variant.index, variant.output.display())
        });
        return print(&lines.collect::<String>());
    }
    check(args, &variants, &missing)?;
    let ends = bake(args, &variants, &asked, &missing)?;
    tell_all(&variants, &finished, ends)
}

fn part(variants: Vec<Variant>, range: Option<Span>) -> Result<Vec<Variant>, Failure> {
    let Some(Span { first, last }) = range else { return Ok(variants) };
    let count = variants.len();
    if first >= count as u64 {
        let what = format!("there are {count} variants, counted from 0");
        return Err(Failure::Usage(vec![Problem::new(format!("--range {first}-{last}"), what, "Name some of them.")]));
    }
    Ok(variants.into_iter().filter(|variant| (first..=last).contains(&(variant.index as u64))).collect())
}

/// What each variant asks for; what is wrong is told once.
fn asked(variants: &[Variant]) -> Result<Vec<Asked>, Failure> {
    let (mut assets, mut asked, mut problems) = (Assets::default(), Vec::new(), Vec::<Problem>::new());
    for variant in variants {
        match assets.asked(variant) {
            Ok(one) => asked.push(one),
            Err(found) => problems.extend(found),
        }
    }
    let mut seen = BTreeSet::new();
    problems.retain(|problem| seen.insert(problem.to_string()));
    if problems.is_empty() { Ok(asked) } else { Err(Failure::Input(problems)) }
}

/// Before any work: the folders are there, and every value of what varies can be baked.
fn check(args: &Args, variants: &[Variant], missing: &[usize]) -> Result<(), Failure> {
    let inputs: Vec<PathBuf> = args.scene.scene.iter().cloned().collect();
    let mut problems: Vec<Problem> = Vec::new();
    let mut folders = BTreeSet::new();
    for variant in missing.iter().map(|&i| &variants[i]) {
        let folder = crate::files::folder_of(&variant.output);
        if folders.insert(folder) {
            trouble::at("batch-folder")
                .and_then(|()| std::fs::create_dir_all(folder))
                .map_err(|error| Failure::write(folder, error))?;
            output::check(&variant.output, &inputs)?;
        }
    }
    let mut samples: Vec<&Variant> =
        missing.iter().map(|&i| &variants[i]).filter(|variant| variant.is_sample).collect();
    if samples.is_empty() {
        samples.extend(missing.first().map(|&i| &variants[i]));
    }
    progress::while_reading(args.progress, || {
        for variant in samples {
            let job = Job::read_within(&variant.tree.to_message(), args.bounds.limits());
            let checked = job.and_then(|job| match cairn_core::plan(&job.scene, &job.params) {
                Err(cairn_core::Error::Invalid(found)) => Err(found.into_iter().map(Problem::from).collect()),
                _ => Ok(()),
            });
            problems.extend(checked.err().into_iter().flatten());
        }
    });
    let mut seen = BTreeSet::new();
    problems.retain(|problem| seen.insert(problem.to_string()));
    if problems.is_empty() { Ok(()) } else { Err(Failure::Input(problems)) }
}

/// How each of the missing ones ended; `None`: it was not begun.
type Ends = Vec<(usize, Option<End>)>;

fn bake(args: &Args, variants: &[Variant], asked: &[Asked], missing: &[usize]) -> Result<Ends, Failure> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = if args.jobs == 0 { cores } else { args.jobs };
    let threads = (cores / jobs.min(missing.len()).max(1)).max(1);
    let mut common = args.scene.again();
    common.extend(args.bounds.again());
    common.extend(args.cache.again());
    common.extend(["--threads".into(), threads.to_string().into()]);
    let task = |&number: &usize| {
        let variant = &variants[number];
        let set = variant.assignments.iter().flat_map(|assignment| ["--set".into(), OsString::from(assignment)]);
        let files = ["-o".into(), variant.output.clone().into(), "--report".into(), variant.report().into()];
        let fill = args.cache.keeps().then_some(asked[number].fill);
        Task { args: common.iter().cloned().chain(set).chain(files).collect(), fill }
    };
    let tasks: Vec<Task> = missing.iter().map(task).collect();
    let mut ends: Ends = missing.iter().map(|&number| (number, None)).collect();
    let mut overall = Overall::new(args.progress, tasks.len());
    crew::work(&tasks, jobs, |news| match news {
        News::Progress(task, fraction) => overall.progress(task, fraction),
        News::Ended(task, end) => {
            overall.end(task, &end, &variants[missing[task]].output.display().to_string());
            ends[task].1 = Some(end);
        }
    });
    overall.finish();
    Ok(ends)
}

fn tell_all(variants: &[Variant], finished: &[bool], mut ends: Ends) -> Result<(), Failure> {
    /// Exit codes of bakes, the worst first; other codes stand before them, and a bake that was killed is to be tried again.
    const WORST: [u8; 4] = [70, 65, 2, 75];
    let mut codes = Vec::new();
    let mut outcomes: Vec<(&Variant, Outcome)> = variants.iter().map(|variant| (variant, Outcome::Skipped)).collect();
    for (number, end) in ends.drain(..) {
        debug_assert!(!finished[number]);
        outcomes[number].1 = match end {
            Some(End::Done) => Outcome::Baked,
            Some(End::Cancelled) | None => Outcome::NotBaked,
            Some(End::Failed(code, why)) => {
                codes.push(code.unwrap_or(75));
                Outcome::Failed(why)
            }
        };
    }
    print(&told::table(&outcomes))?;
    for (variant, outcome) in &outcomes {
        if let Outcome::Failed(why) = outcome {
            tell("error", AnsiColor::Red, &format!("{}: {why}", variant.output.display()));
        }
    }
    if interrupt::asked() {
        tell("error", AnsiColor::Red, "cancelled; what is finished stays, and the same command bakes the rest");
        return Err(Failure::Told(interrupt::code()));
    }
    let rank = |code: &u8| WORST.iter().position(|other| other == code).map_or(0, |at| at + 1);
    codes.into_iter().min_by_key(rank).map_or(Ok(()), |code| Err(Failure::Told(code)))
}
