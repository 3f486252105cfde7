//! Small problems with known answers, for Cairn and for other engines: writes them, runs them in Cairn, judges runs,
//! and makes the page. `tests/studies/problems/run` does all of that.
//!
//!     cargo study problems -- write target/problems
//!     cargo study problems -- bake target/problems sag 0 standard -o run.json
//!     cargo study problems -- judge target/problems sag 0 run.json

mod export;
#[path = "../peers/format.rs"]
mod format;
mod plot;
mod problem;
#[path = "../../hard/rows/mod.rs"]
mod rows;
#[path = "../peers/shapes.rs"]
mod shapes;

use anyhow::{Context, ensure};
use clap::{Parser, Subcommand};
use format::{PeerRun, PeerScene};
use problem::results::Study;
use problem::{Ask, PROBLEMS, Problem, ours, page};
use std::path::{Path, PathBuf};

/// Small problems with known answers.
#[derive(Parser)]
struct Args {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Write every case of every problem as PROBLEM-CASE.json, and what there is as index.json
    Write { folder: PathBuf },
    /// Run a case in Cairn
    Bake {
        folder: PathBuf,
        problem: String,
        case: usize,
        variant: String,
        #[arg(short)]
        out: PathBuf,
    },
    /// Print the error of a run, or whether it falls, as JSON; null where the engine was stopped
    Judge { folder: PathBuf, problem: String, case: usize, run: PathBuf },
    /// Print the error of a limit, given the first case that stands
    Limit { problem: String, found: Option<usize> },
    /// Write results.md and the plots from results.json in a folder; as PNG, too, into another one
    Page {
        folder: PathBuf,
        #[arg(long)]
        pictures: Option<PathBuf>,
    },
}

fn main() -> anyhow::Result<()> {
    match Args::parse().task {
        Task::Write { folder } => write(&folder),
        Task::Bake { folder, problem, case, variant, out } => {
            let problem = named(&problem)?;
            let variant = ours::variant(&variant).with_context(|| format!("no variant {variant}"))?;
            let scene = read(&place(&folder, problem, case))?;
            save(&out, &export::run(problem, &scene, &ours::run(problem, case, variant)?))
        }
        Task::Judge { folder, problem, case, run } => {
            let problem = named(&problem)?;
            let scene = read(&place(&folder, problem, case))?;
            println!("{}", serde_json::to_string(&judged(problem, &scene, &read(&run)?)?)?);
            Ok(())
        }
        Task::Limit { problem, found } => {
            println!("{}", named(&problem)?.limit_error(found));
            Ok(())
        }
        Task::Page { folder, pictures } => {
            let study = Study::read(&folder.join("results.json"))?;
            std::fs::write(folder.join("results.md"), page::markdown(&study))?;
            for problem in PROBLEMS {
                plot::draw(problem, study.of(problem), &folder, pictures.as_deref())?;
            }
            Ok(())
        }
    }
}

fn named(name: &str) -> anyhow::Result<&'static Problem> {
    problem::of(name).with_context(|| format!("no problem {name}"))
}

/// An error, or for a case of a limit whether it falls.
#[derive(serde::Serialize)]
#[serde(untagged)]
enum Judgement {
    Error(f64),
    Falls(bool),
    Stopped(()),
}

fn judged(problem: &Problem, scene: &PeerScene, run: &PeerRun) -> anyhow::Result<Judgement> {
    if run.motion.len() <= problem.frames() as usize {
        return Ok(Judgement::Stopped(()));
    }
    let motion = export::motion(scene, run)?;
    Ok(match &problem.ask {
        Ask::Error { of, .. } => {
            let error = of(&motion);
            ensure!(error.is_finite(), "{}: no error", problem.name);
            Judgement::Error(error)
        }
        Ask::Limit { falls, .. } => Judgement::Falls(falls(&motion)),
    })
}

fn write(folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)?;
    let mut index = Vec::new();
    for problem in PROBLEMS {
        let cases = problem.shares().len();
        for case in 0..cases {
            save(&place(folder, problem, case), &export::scene(problem, case)?)?;
        }
        index.push(serde_json::json!({
            "name": problem.name,
            "cases": cases,
            "timed": problem.timed(),
            "limit": problem.is_limit(),
            "stands": problem.stands,
        }));
    }
    let kind = |name: &str| match ours::PRESETS.contains(&name) {
        true => "preset",
        false if name == ours::CONTROLLED => "control",
        false => "parameter",
    };
    let variants: Vec<_> =
        ours::VARIANTS.iter().map(|v| serde_json::json!({ "name": v.name, "kind": kind(v.name) })).collect();
    save(&folder.join("index.json"), &serde_json::json!({ "problems": index, "variants": variants }))
}

/// Where a case is.
fn place(folder: &Path, problem: &Problem, case: usize) -> PathBuf {
    folder.join(format!("{}-{case}.json", problem.name))
}

fn read<T: serde::de::DeserializeOwned>(path: &Path) -> anyhow::Result<T> {
    let text = std::fs::read(path).with_context(|| path.display().to_string())?;
    serde_json::from_slice(&text).with_context(|| path.display().to_string())
}

fn save(path: &Path, value: &impl serde::Serialize) -> anyhow::Result<()> {
    std::fs::write(path, serde_json::to_vec(value)?).with_context(|| path.display().to_string())
}
