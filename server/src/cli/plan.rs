//! `cairn plan`: summarizes a bake, and estimates the cost of each accuracy.

use super::check::{PlanArgs, describe};
use super::remote::{self, ConnectionArgs};
use super::{Failure, interrupt, print};
use cairn_export::Format;
use cairn_prepare::estimate::Estimate;
use cairn_wire::scene_file;
use cairn_wire::to_proto;
use serde_json::json;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::Duration;

/// Summarizes the bake and estimates the cost of each accuracy
///
/// Reads the scene and all its files without simulating them; a short test measures the speed of this machine. JSON
/// output has notes, plan, estimates, the size of a result at most, by its format, and resources: cores, time and
/// memory of a bake by itself, as expected and as nine of ten bakes stay below.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn plan pile.toml
  cairn plan --control dome.glb --prop stick.glb --json")]
pub struct Args {
    #[command(flatten)]
    plan: PlanArgs,

    /// Plan on a server, with the cost there: HOST:PORT or unix:PATH of a `cairn serve`
    #[arg(long, value_name = "ADDRESS", help_heading = "Server")]
    server: Option<String>,

    #[command(flatten)]
    connection: ConnectionArgs,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    match &args.server {
        Some(server) => on_server(args, server),
        None => args.plan.bounds.enforce(|| plan(&args.plan)),
    }
}

/// The plan that a server makes.
fn on_server(args: &Args, server: &str) -> Result<(), Failure> {
    interrupt::listen();
    let tree = args.plan.tree_to_send()?;
    let files = remote::Files::read(&tree)?;
    let plan = remote::plan(&args.connection.at(server)?, tree.to_message(), &files)?;
    if args.plan.json {
        return print(&format!("{:#}\n", scene_file::json_of("cairn.v1.Plan", &plan)));
    }
    let mut text = String::from("The scene can be baked there.\n");
    let mut line = |name: &str, value: String| writeln!(text, "  {name:<22}{value}").expect("a string takes all");
    line("bodies", format!("about {}", plan.expected_body_count));
    line("steps", format!("about {}", plan.expected_step_count));
    line("prop diameter", format!("{:.3} m", plan.prop_diameter));
    line("result", format!("up to {:.1} MiB", plan.most_result_bytes as f64 / f64::from(1 << 20)));
    for estimate in &plan.estimates {
        let name = estimate.accuracy().as_str_name().trim_start_matches("ACCURACY_").to_lowercase();
        let (cpu, wall) = (estimate.cpu_seconds.ceil(), estimate.wall_seconds.ceil());
        let (bodies, overlap) = (estimate.body_count, millimetres(estimate.overlap));
        let (low, high) = (100.0 * estimate.kept_shape_low, 100.0 * estimate.kept_shape_high);
        let kept = if high > 0.0 { format!(", {low:.0} to {high:.0} % of the shape") } else { String::new() };
        let speed = 100.0 * estimate.speed_error;
        let what = format!("{bodies} bodies, overlaps of {overlap}{kept}, speeds off by {speed:.1} %");
        line(&name, format!("{cpu} CPU s, {wall} s from start to result: {what}"));
    }
    for warning in plan.warnings {
        line("note", warning);
    }
    print(&text)
}

fn plan(args: &PlanArgs) -> Result<(), Failure> {
    let (job, plan) = args.read()?;
    let estimates = job.estimates()?;
    if args.json {
        let sizes: BTreeMap<&str, u64> =
            Format::ALL.iter().map(|format| (format.extension(), job.most_bytes(&plan, *format))).collect();
        let memory = job.peak_memory(&plan);
        let own = estimates.iter().find(|estimate| estimate.accuracy == job.params.accuracy);
        // Of one bake, on one core.
        let resources = own.map(|own| {
            json!({
                "cores": 1,
                "seconds": own.cpu_seconds,
                "most_seconds": own.factor * own.cpu_seconds,
                "memory_bytes": memory.expected,
                "most_memory_bytes": memory.most,
            })
        });
        let object = json!({
            "notes": job.notes_of_plan(),
            "plan": plan,
            "estimates": estimates,
            "most_result_bytes": sizes,
            "resources": resources,
        });
        return print(&format!("{object:#}\n"));
    }
    let own = estimates.iter().find(|estimate| estimate.accuracy == job.params.accuracy);
    print(&(describe(&plan, &job.notes_of_plan(), own, args.verbose) + &price_list(&estimates, own)))
}

/// The expected cost and errors of each accuracy.
fn price_list(estimates: &[Estimate], own: Option<&Estimate>) -> String {
    let factor = estimates.first().map_or(1.0, |e| e.factor);
    let threads = rayon::current_num_threads();
    let mut text = format!(
        "\nExpected on this machine (9 of 10 bakes: within a factor of {factor:.1}), and errors that our studies \
         found:\n  {:<11}{:>9}{:>11}{:>8}  {:<18}{:<13}{:<7}{:<7}{}\n",
        "accuracy",
        "CPU time",
        format!("{threads} threads"),
        "bodies",
        "props overlap by",
        "keeps shape",
        "speed",
        "loose",
        "shape"
    );
    for e in estimates {
        let time = |seconds: f64| humantime::format_duration(Duration::from_secs(seconds.ceil() as u64)).to_string();
        let overlap = format!("{} ({:.2} %)", millimetres(e.overlap), 100.0 * e.overlap_rel);
        let kept = e.kept_shape.map(|[low, _, high]| format!("{:.0} to {:.0} %", 100.0 * low, 100.0 * high));
        let [speed, shape] = [e.speed_error, e.shape_error].map(|error| format!("{:.1} %", 100.0 * error));
        let loose = format!("{:.0} %", 100.0 * e.imbalance);
        let name = to_proto::accuracy_name(e.accuracy);
        let mark = if own.is_some_and(|own| own.accuracy == e.accuracy) { "  <- this scene" } else { "" };
        let (cpu, wall, kept) = (time(e.cpu_seconds), time(e.wall_seconds(threads)), kept.unwrap_or("held".into()));
        let line = format!(
            "  {name:<11}{cpu:>9}{wall:>11}{:>8}  {overlap:<18}{kept:<13}{speed:<7}{loose:<7}{shape}{mark}",
            e.bodies
        );
        writeln!(text, "{}", line.trim_end()).expect("writing to a string cannot fail");
    }
    if let Some(own) = own.or(estimates.first()) {
        let [low, high] = own.body_range;
        text += &format!("Nine of ten bakes have {low} to {high} bodies. ");
    }
    text += "Overlaps are also in percent of the thinner body's thickness; below 0.6 % they are invisible. Of ten \
             bakes, eight keep a share of the shape in the range. Speed: how far a sliding body is off. Loose: bodies \
             that move once all are released; shape: distance from the reference's, both without hold or glue.\n";
    text
}

/// Two digits.
fn millimetres(metres: f64) -> String {
    let value = metres * 1e3;
    let digits = if value > 0.0 { (1.0 - libm::log10(value).floor()).clamp(0.0, 3.0) as usize } else { 0 };
    format!("{value:.digits$} mm")
}
