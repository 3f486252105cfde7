//! The same pile for Cairn and for other engines: writes it as it is right after turning over, lets Cairn and its
//! simpler variants take it from there, and measures where an engine left it. `tests/studies/peers/run` does all of
//! that.
//!
//!     cargo study peers -- scene examples/sticks.toml --set fill.count=60 -o pile.json
//!     cargo study peers -- bake pile.json --variant held -o held.json
//!     cargo study peers -- measure pile.json held.json

mod cpu;
mod export;
mod format;
mod measure;
mod ours;
mod pile;
mod shapes;

use anyhow::Context;
use clap::{Parser, Subcommand};
use format::{PeerRun, PeerScene};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

/// The same pile for Cairn and for other engines.
#[derive(Parser)]
struct Args {
    /// Where fills are kept
    #[arg(long, global = true, default_value = "target/peers/cache")]
    cache: PathBuf,
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Fill a scene's control mesh, and write the pile right after turning over
    Scene {
        file: PathBuf,
        /// Set a field of the scene, as `cairn bake --set` does
        #[arg(long)]
        set: Vec<String>,
        /// Frames to simulate, at the scene's frame rate
        #[arg(long, default_value_t = 249)]
        frames: u32,
        #[arg(short)]
        out: PathBuf,
    },
    /// Let Cairn take it from there
    Bake {
        scene: PathBuf,
        #[arg(long)]
        variant: ours::Variant,
        #[arg(short)]
        out: PathBuf,
    },
    /// Print the figures of where an engine left it
    Measure { scene: PathBuf, run: PathBuf },
}

fn main() -> anyhow::Result<()> {
    let Args { cache, task } = Args::parse();
    match task {
        Task::Scene { file, set, frames, out } => {
            write(&out, &export::scene(&pile::Full::of(&file, &set, &cache)?, frames)?)
        }
        Task::Bake { scene, variant, out } => {
            let scene: PeerScene = read(&scene)?;
            let full = pile::Full::of(&scene.file, &scene.set, &cache)?;
            write(&out, &ours::bake(&full, &scene, variant)?)
        }
        Task::Measure { scene, run } => {
            let (scene, run): (PeerScene, PeerRun) = (read(&scene)?, read(&run)?);
            println!("{}", serde_json::to_string(&measure::figures(&scene, &run.bodies)?)?);
            Ok(())
        }
    }
}

fn read<T: DeserializeOwned>(path: &Path) -> anyhow::Result<T> {
    let text = std::fs::read(path).with_context(|| path.display().to_string())?;
    serde_json::from_slice(&text).with_context(|| path.display().to_string())
}

fn write(path: &Path, value: &impl Serialize) -> anyhow::Result<()> {
    std::fs::write(path, serde_json::to_vec(value)?).with_context(|| path.display().to_string())
}
