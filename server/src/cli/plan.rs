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
    let mut text = format!(
        "\nExpected CPU time on this machine (nine of ten bakes: within a factor of {factor:.1}), and the errors usual in our study:\n  {:<16}{:>12}{:>26}{:>22}\n",
        "accuracy", "CPU time", "contacts sink in by", "friction beyond mu"
    );
    for e in estimates {
        let time = humantime::format_duration(Duration::from_secs(e.cpu_seconds.ceil() as u64)).to_string();
        let sink = format!("{:.2} % of a thickness", 100.0 * e.penetration_mean_rel);
        let force = format!("{:.2} %", 100.0 * e.friction_violation_mean);
        let name = to_proto::accuracy_name(e.accuracy);
        let mark = if own.is_some_and(|own| own.accuracy == e.accuracy) { "  <- this scene's" } else { "" };
        writeln!(text, "  {name:<16}{time:>12}{sink:>26}{force:>22}{mark}").expect("a string takes all");
    }
    text
}
