//! `cairn plan`: summarizes a bake, and estimates the cost of each accuracy.

use super::check::{PlanArgs, describe};
use super::summary::length;
use super::{Failure, print};
use crate::wire::to_proto;
use cairn_core::prepare::estimate::Estimate;
use serde_json::json;
use std::fmt::Write;
use std::time::Duration;

/// Summarizes the bake and estimates the cost of each accuracy
///
/// Reads the scene and all its files without simulating them; a short test measures the speed of this machine. JSON
/// output has notes, plan and estimates.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn plan pile.toml
  cairn plan --control dome.glb --prop stick.glb --json")]
pub struct Args {
    #[command(flatten)]
    plan: PlanArgs,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    args.plan.bounds.enforce(|| plan(&args.plan))
}

fn plan(args: &PlanArgs) -> Result<(), Failure> {
    let (job, plan) = args.read()?;
    let estimates = job.estimates()?;
    if args.json {
        return print(&format!("{:#}\n", json!({ "notes": job.notes, "plan": plan, "estimates": estimates })));
    }
    let own = estimates.iter().find(|estimate| estimate.accuracy == job.params.accuracy);
    print(&(describe(&plan, &job.notes, own) + &price_list(&estimates, own)))
}

/// The expected cost and errors of each accuracy.
fn price_list(estimates: &[Estimate], own: Option<&Estimate>) -> String {
    let factor = estimates.first().map_or(1.0, |e| e.factor);
    let threads = rayon::current_num_threads();
    let mut text = format!(
        "\nExpected on this machine (9 of 10 bakes: within a factor of {factor:.1}), and typical errors in our \
         study:\n  {:<12}{:>10}{:>12}{:>8}  {:<26}{:<22}{}\n",
        "accuracy",
        "CPU time",
        format!("{threads} threads"),
        "bodies",
        "props overlap by",
        "move once released",
        "shape error"
    );
    for e in estimates {
        let time = |seconds: f64| humantime::format_duration(Duration::from_secs(seconds.ceil() as u64)).to_string();
        let overlap = format!("{} ({:.2} %)", length(e.overlap), 100.0 * e.penetration_mean_rel);
        let loose = format!("{:.0} of 100", 100.0 * e.imbalance);
        let shape = format!("{:.1} %", 100.0 * e.shape_error);
        let name = to_proto::accuracy_name(e.accuracy);
        let mark = if own.is_some_and(|own| own.accuracy == e.accuracy) { "  <- this scene" } else { "" };
        let (cpu, wall) = (time(e.cpu_seconds), time(e.wall_seconds(threads)));
        let line = format!("  {name:<12}{cpu:>10}{wall:>12}{:>8}  {overlap:<26}{loose:<22}{shape}{mark}", e.bodies);
        writeln!(text, "{}", line.trim_end()).expect("writing to a string cannot fail");
    }
    text += "Overlaps are in percent of the thinner body's thickness; below 0.6 % they are invisible. ";
    text += "The last columns are for a pile without hold or glue.\n";
    text
}
