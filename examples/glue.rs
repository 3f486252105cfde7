//! Where piles must be glued: dots and CPU seconds of the splitting method, beside Clarabel's.
//!
//!     cargo run --release --example glue -- examples/sticks.toml examples/column.toml --set fill.count=200

mod piles;

use cairn_core::equilibrium::glue::{self, GlueOptions, Placement, oracle};
use cairn_core::sim::glue::Sites;
use clap::Parser;
use cpu_time::ThreadTime;
use glam::DVec3;
use std::ops::ControlFlow;
use std::path::PathBuf;

/// Where piles must be glued, by the splitting method and by Clarabel.
#[derive(Parser)]
struct Args {
    /// Scene files
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    /// Set a field of each scene, as `cairn bake --set` does
    #[arg(long)]
    set: Vec<String>,
    /// Piles of more bodies than this are not given to Clarabel
    #[arg(long, default_value_t = 800)]
    oracle: usize,
    /// Friction counts by this factor
    #[arg(long, default_value_t = 0.5)]
    factor: f64,
    /// Bound on a dot's force, in weights of the median prop
    #[arg(long)]
    strength: Option<f64>,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    println!(
        "| scene | method | bodies | touches | contacts | dots | largest | imbalance | by cone program | fallen | iterations | CPU s |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for scene in &args.scenes {
        let full = piles::Full::of(scene, &args.set)?;
        let sim = full.turn_over()?;
        let sites = Sites::new(&sim.pile.world, None, true);
        let problem = sites.problem(DVec3::NEG_Y);
        let options = GlueOptions { friction_factor: args.factor, normal_price: 0.02, strength: args.strength };
        let name = scene.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let tell = |method: &str, placed: &Placement, seconds: f64| {
            let force = |dot: &glue::GlueDot| dot.force.length();
            println!(
                "| {name} | {method} | {} | {} | {} | {} | {:.1} | {:.1e} | {} | {} | {} | {seconds:.2} |",
                sites.ids.len(),
                sites.real(),
                problem.contacts.len(),
                placed.dots.len(),
                placed.dots.iter().map(force).fold(0.0, f64::max),
                placed.imbalance,
                placed.by_cone_program,
                placed.fallen.len(),
                placed.iterations,
            );
        };
        let mut going = || ControlFlow::Continue(());
        let begin = ThreadTime::now();
        let placed = glue::place(&problem, &options, &mut going)?;
        tell("splitting", &placed, begin.elapsed().as_secs_f64());
        if sites.ids.len() <= args.oracle {
            let begin = ThreadTime::now();
            let placed = oracle::place(&problem, &options, &mut going)?;
            tell("Clarabel", &placed, begin.elapsed().as_secs_f64());
        }
    }
    Ok(())
}
