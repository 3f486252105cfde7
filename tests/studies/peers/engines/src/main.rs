//! Other engines on the same pile, each as its own documentation sets it up.
//!
//!     cairn-peers rapier pile.json run.json --hz 60 --iterations 4

#[cfg(feature = "box3d")]
mod box3d;
#[path = "../../format.rs"]
mod format;
#[cfg(feature = "jolt")]
mod jolt;
mod rapier;

use anyhow::{Context, ensure};
use clap::Parser;
use cpu_time::ProcessTime;
use format::{PeerBody, PeerRun, PeerScene};
use std::path::PathBuf;

/// Lets an engine take a pile from the moment of turning over.
#[derive(Parser)]
struct Args {
    engine: Name,
    scene: PathBuf,
    out: PathBuf,
    /// Steps per second
    #[arg(long)]
    hz: f64,
    /// Solver iterations of a step; for Box3D, substeps
    #[arg(long)]
    iterations: u32,
    /// How the table names the settings
    #[arg(long)]
    settings: String,
    /// CPU seconds after which the engine is stopped
    #[arg(long, default_value_t = f64::INFINITY)]
    limit: f64,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Name {
    Rapier,
    #[cfg(feature = "box3d")]
    Box3d,
    #[cfg(feature = "jolt")]
    Jolt,
}

/// An engine with a pile in it.
trait Engine {
    fn step(&mut self);
    /// Position of the centre of mass, and rotation x y z w.
    fn pose(&self, body: usize) -> ([f64; 3], [f64; 4]);
}

/// How finely an engine simulates.
struct Pace {
    /// s.
    step: f64,
    iterations: u32,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let text = std::fs::read(&args.scene).with_context(|| args.scene.display().to_string())?;
    let scene: PeerScene = serde_json::from_slice(&text)?;
    let pace = Pace { step: 1.0 / args.hz, iterations: args.iterations };
    let (name, mut engine): (&str, Box<dyn Engine>) = match args.engine {
        Name::Rapier => ("rapier 0.36.1", Box::new(rapier::Rapier::new(&scene, &pace)?)),
        #[cfg(feature = "box3d")]
        Name::Box3d => ("Box3D, by box3d-sys 0.1.16", Box::new(box3d::Box3d::new(&scene, &pace)?)),
        #[cfg(feature = "jolt")]
        Name::Jolt => ("Jolt 5.0.0", Box::new(jolt::Jolt::new(&scene, &pace)?)),
    };
    let steps = (f64::from(scene.frames) / scene.fps * args.hz).round() as u32;
    let per_frame = (args.hz / scene.fps).round() as u32;
    ensure!(!scene.exact || f64::from(per_frame) * scene.fps == args.hz, "frames need whole steps");
    let poses = |engine: &dyn Engine| {
        let pose = |id: usize| {
            let ([x, y, z], [i, j, k, w]) = engine.pose(id);
            [x, y, z, i, j, k, w]
        };
        (0..scene.bodies.len()).map(pose).collect::<Vec<_>>()
    };
    let mut motion = if scene.exact { vec![poses(&*engine)] } else { Vec::new() };
    let (mut cpu, mut done) = (0.0, 0);
    while done < steps && cpu < args.limit {
        // Reading poses does not count.
        let begin = ProcessTime::now();
        let pause = if scene.exact { done + per_frame } else { steps };
        while done < pause && cpu + begin.elapsed().as_secs_f64() < args.limit {
            engine.step();
            done += 1;
        }
        cpu += begin.elapsed().as_secs_f64();
        if scene.exact {
            motion.push(poses(&*engine));
        }
    }
    let at_end = |(body, &[x, y, z, i, j, k, w]): (&PeerBody, &[f64; 7])| PeerBody {
        shape: body.shape,
        position: [x, y, z],
        rotation: [i, j, k, w],
    };
    let run = PeerRun {
        engine: name.into(),
        settings: args.settings,
        cpu,
        keyframes_cpu: None,
        resisted_steps: None,
        seconds: f64::from(done) / args.hz,
        bodies: scene.bodies.iter().zip(&poses(&*engine)).map(at_end).collect(),
        motion,
    };
    std::fs::write(&args.out, serde_json::to_vec(&run)?).with_context(|| args.out.display().to_string())
}
