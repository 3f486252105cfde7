//! `cairn cost`: measures the cost of accuracy for a scene.

use super::bounds::{self, Bounds};
use super::progress::RunCounter;
use super::scene_args::SceneArgs;
use super::{Failure, interrupt, print};
use crate::cost::{self, Ledger, Record, Study, StudyVariant};
use cairn_files::problem::Problem;
use cairn_input::observer::{Observer, Progress};
use cairn_job::Job;
use cairn_job::machine;
use cairn_wire::scene_file::SceneTree;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Measures the CPU time and the errors of each accuracy for a scene
///
/// Bakes the scene with every preset and with single parameters changed, several seeds each, and writes a table
/// (cost.md, cost.json) and a plot (cost.svg, cost.png) of error over CPU time. Run again, it continues an unfinished
/// study.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn cost pile.toml -o cost --budget 200s
  cairn cost pile.toml -o cost --bodies 150 --seeds 5
  cairn cost pile.toml -o cost --knob physics.substeps=4 --knob physics.substeps=16
  cairn cost pile.toml -o cost --effects")]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,

    /// Folder for the table, the plot and the finished runs
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,

    #[command(flatten)]
    bounds: Bounds,

    /// Limit of this command's CPU time; the table lists the runs beyond it
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    budget: Option<Duration>,

    /// Number of threads; 0: one per core. CPU time and errors hardly depend on it
    #[arg(long, default_value_t = 0, env = "CAIRN_BAKE_THREADS")]
    threads: usize,

    /// Seeds of each variant, starting with the scene's seed
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=100))]
    seeds: u64,

    /// Scale the shape down to about this many bodies
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    bodies: Option<u64>,

    /// Change these fields instead of the built-in ones; separate fields that are changed together by commas
    #[arg(long = "knob", value_name = "FIELD=VALUE")]
    knobs: Vec<String>,

    /// Bake only the presets
    #[arg(long, conflicts_with = "knobs")]
    presets_only: bool,

    /// Instead of presets, switch one effect of the plan at a time, and write the cost and the influence of each
    /// (effects.md, effects.json)
    #[arg(long, conflicts_with_all = ["knobs", "presets_only"])]
    effects: bool,
}

/// A run of the study.
struct PlannedRun {
    variant: usize,
    seed: u64,
    key: String,
    tree: SceneTree,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    interrupt::listen();
    args.bounds.enforce(|| study(args))
}

fn study(args: &Args) -> Result<(), Failure> {
    bounds::use_threads(args.threads)?;
    let tree = args.scene.tree()?;
    let job = Job::read_tree(&tree, args.bounds.limits())?;
    let variants = match (&args.knobs[..], args.presets_only) {
        _ if args.effects => cost::effects::switched(&cairn_core::plan(&job.scene, &job.params)?),
        (_, true) => cost::variants(Some(&[])),
        ([], false) => cost::variants(None),
        (knobs, false) => cost::variants(Some(knobs)),
    };
    if args.bodies.is_some() && job.scene.control.is_none() {
        return Err(Failure::usage("--bodies", "the scene has no control mesh to scale down", "Omit --bodies."));
    }
    let files = job.content_hash();
    let first = job.params.seed;
    let mut wanted = Vec::new();
    for seed in first..first.saturating_add(args.seeds) {
        for (variant, of) in variants.iter().enumerate() {
            let tree = cost::scene_of(&tree, of, seed).map_err(Failure::Usage)?;
            let what = format!("{} {files} {:?} {}", cairn_files::version::VERSION, args.bodies, tree.to_json());
            wanted.push(PlannedRun { variant, seed, key: blake3::hash(what.as_bytes()).to_hex().to_string(), tree });
        }
    }
    let mut ledger = Ledger::open(&args.output).map_err(Failure::TryAgain)?;
    let left_out = bake_all(args, &variants, &wanted, &mut ledger)?;
    let runs: Vec<(StudyVariant, Vec<Record>)> = variants
        .into_iter()
        .enumerate()
        .map(|(i, variant)| {
            let keys = wanted.iter().filter(|w| w.variant == i);
            (variant, keys.filter_map(|w| ledger.find(&w.key).cloned()).collect())
        })
        .collect();
    if args.effects {
        return write_effects(&runs, &left_out, &args.output);
    }
    let scene = args.scene.scene.as_ref().map_or("scene".into(), |path| path.display().to_string());
    let study = Study::new(scene, machine::name(), &runs, left_out);
    write(&study, &args.output)?;
    print(&study.markdown())
}

/// Bakes the runs that the ledger lacks. Returns the names of those beyond the budget.
fn bake_all(
    args: &Args,
    variants: &[StudyVariant],
    wanted: &[PlannedRun],
    ledger: &mut Ledger,
) -> Result<Vec<String>, Failure> {
    let budget = args.budget.map_or(f64::INFINITY, |budget| budget.as_secs_f64());
    let began = machine::cpu_seconds();
    let mut watch = Watch { tally: RunCounter::new(wanted.len()), end: began + budget };
    let mut left_out = Vec::new();
    for want in wanted {
        let name = format!("{} (seed {})", variants[want.variant].name, want.seed);
        watch.tally.begin(&name);
        if ledger.find(&want.key).is_none() {
            // Expected cost of the run, from the finished ones.
            let rate = |r: &Record| {
                let of = wanted.iter().find(|w| w.key == r.key)?;
                Some(r.seconds.values().sum::<f64>() / cost::work(&of.tree))
            };
            let rates: Vec<f64> = ledger.records.iter().filter_map(rate).collect();
            let mean = rates.iter().sum::<f64>() / rates.len().max(1) as f64;
            if machine::cpu_seconds() + mean * cost::work(&want.tree) > watch.end {
                left_out.push(name);
                continue;
            }
            let job = Job::read_tree(&want.tree, args.bounds.limits())?;
            let bodies = args.bodies.map(|n| n as usize);
            match cost::run(&job, &variants[want.variant], want.key.clone(), bodies, &mut watch) {
                Ok(record) => ledger.add(record).map_err(Failure::TryAgain)?,
                Err(cairn_core::Error::Cancelled) if !interrupt::is_requested() => left_out.push(name),
                Err(error) => return Err(error.into()),
            }
        }
    }
    watch.tally.finish();
    Ok(left_out)
}

fn write_effects(runs: &[(StudyVariant, Vec<Record>)], left_out: &[String], folder: &Path) -> Result<(), Failure> {
    let rows = cost::effects::rows(runs);
    let mut text = cost::effects::markdown(&rows);
    if !left_out.is_empty() {
        text += &format!("\nNot baked within the budget: {}\n", left_out.join(", "));
    }
    let json = serde_json::to_string_pretty(&rows).expect("rows have a JSON form") + "\n";
    super::output::write(&folder.join("effects.json"), json.as_bytes())?;
    super::output::write(&folder.join("effects.md"), text.as_bytes())?;
    print(&text)
}

fn write(study: &Study, folder: &Path) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(study).expect("a study has a JSON form") + "\n";
    super::output::write(&folder.join("cost.json"), json.as_bytes())?;
    super::output::write(&folder.join("cost.md"), study.markdown().as_bytes())?;
    cost::draw(study, folder).map_err(|e| {
        Failure::TryAgain(Problem::at(folder, format!("the plot cannot be written: {e}"), "Make room on the disk."))
    })
}

/// Shows the progress of the study, and cancels runs beyond the budget.
struct Watch {
    tally: RunCounter,
    /// Limit of this process's CPU seconds.
    end: f64,
}

impl Observer for Watch {
    fn progress(&mut self, _: &Progress) -> ControlFlow<()> {
        self.tally.tick();
        if interrupt::is_requested() || machine::cpu_seconds() > self.end {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }

    fn cpu_seconds(&mut self) -> f64 {
        machine::cpu_seconds()
    }
}
