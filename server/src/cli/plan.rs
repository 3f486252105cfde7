//! `cairn plan`: what a bake would do, and what each accuracy would cost.

use super::bounds::Bounds;
use super::check::{describe, read};
use super::scene_args::SceneArgs;
use super::{Failure, print};
use crate::wire::to_proto;
use cairn_core::prepare::estimate::Estimate;
use serde_json::json;
use std::fmt::Write;
use std::time::Duration;

/// Tell what a bake would do, and what each accuracy would cost
///
/// Reads the scene and all its files, and simulates nothing of it; a short run tells how fast this machine is.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn plan pile.toml
  cairn plan --control dome.glb --prop stick.glb --json")]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,

    #[command(flatten)]
    bounds: Bounds,

    /// JSON instead of text: an object of notes, plan and estimates
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    args.bounds.hold(|| plan(args))
}

fn plan(args: &Args) -> Result<(), Failure> {
    let (job, plan) = read(&args.scene, &args.bounds)?;
    let estimates = job.estimates()?;
    if args.json {
        return print(&format!("{:#}\n", json!({ "notes": job.notes, "plan": plan, "estimates": estimates })));
    }
    let own = estimates.iter().find(|estimate| estimate.accuracy == job.params.accuracy);
    print(&(describe(&plan, &job.notes, own) + &prices(&estimates, own)))
}

/// The price list.
fn prices(estimates: &[Estimate], own: Option<&Estimate>) -> String {
    let factor = estimates.first().map_or(1.0, |e| e.factor);
    let threads = rayon::current_num_threads();
    let mut text = format!(
        "\nExpected on this machine (nine of ten bakes: within a factor of {factor:.1}), and the errors usual in our study:\n  \
         {:<12}{:>10}{:>12}{:>8}  {:<26}{:<22}{}\n",
        "accuracy",
        "CPU time",
        format!("{threads} threads"),
        "bodies",
        "props overlap by",
        "move when let go",
        "shape off by"
    );
    for e in estimates {
        let time = |seconds: f64| humantime::format_duration(Duration::from_secs(seconds.ceil() as u64)).to_string();
        let overlap = format!("{} ({:.2} %)", length(e.overlap), 100.0 * e.penetration_mean_rel);
        let loose = format!("{:.0} of 100", 100.0 * e.imbalance);
        let shape = format!("{:.1} %", 100.0 * e.shape_error);
        let name = to_proto::accuracy_name(e.accuracy);
        let mark = if own.is_some_and(|own| own.accuracy == e.accuracy) { "  <- this scene's" } else { "" };
        let (cpu, wall) = (time(e.cpu_seconds), time(e.wall_seconds(threads)));
        let line = format!("  {name:<12}{cpu:>10}{wall:>12}{:>8}  {overlap:<26}{loose:<22}{shape}{mark}", e.bodies);
        writeln!(text, "{}", line.trim_end()).expect("a string takes all");
    }
    text += "Overlaps are in per cent of the thickness; below 0.6 % nobody sees them. What moves is held or glued until the end.\n";
    text
}

/// A length in the unit that suits it.
fn length(metres: f64) -> String {
    match metres {
        m if m < 1e-4 => format!("{:.0} um", m * 1e6),
        m if m < 1e-2 => format!("{:.1} mm", m * 1e3),
        m => format!("{:.1} cm", m * 1e2),
    }
}
