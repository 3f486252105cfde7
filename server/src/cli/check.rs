//! `cairn check`: validates a scene and summarizes the bake.

use super::bounds::Bounds;
use super::progress::{self, Mode};
use super::scene_args::SceneArgs;
use super::{Failure, print};
use cairn_files::problem::Problem;
use cairn_job::Job;
use cairn_prepare::effects::{Effect, EffectName};
use cairn_prepare::estimate::Estimate;
use cairn_prepare::plan::Plan;
use cairn_wire::scene_file::SceneTree;
use serde_json::json;
use std::fmt::Write;

/// Validates the scene and summarizes the bake without simulating it
///
/// Reads the scene and all its files, and reports all problems at once. JSON output has ok, problems, notes and plan.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn check pile.toml
  cairn check --control dome.glb --prop stick.glb --json")]
pub struct Args {
    #[command(flatten)]
    plan: PlanArgs,
}

/// The arguments of `cairn check` and `cairn plan`.
#[derive(clap::Args)]
pub struct PlanArgs {
    #[command(flatten)]
    scene: SceneArgs,

    #[command(flatten)]
    pub bounds: Bounds,

    /// Print JSON instead of text
    #[arg(long)]
    pub json: bool,

    /// Print every effect, not only those that matter most
    #[arg(short, long, conflicts_with = "json")]
    pub verbose: bool,
}

impl PlanArgs {
    /// The scene, to send it.
    pub fn tree_to_send(&self) -> Result<SceneTree, Failure> {
        self.scene.tree_to_send()
    }

    /// Reads the scene with all its files, and plans its bake.
    pub fn read(&self) -> Result<(Job, Plan), Failure> {
        let tree = self.scene.tree()?;
        progress::while_reading(Mode::Auto, || {
            let job = Job::read_tree(&tree, self.bounds.limits())?;
            let plan = cairn_core::plan(&job.scene, &job.params);
            let plan = plan.map_err(|error| Failure::from(error).with_notes(&job.notes))?;
            Ok((job, plan))
        })
    }
}

pub fn run(args: &Args) -> Result<(), Failure> {
    args.plan.bounds.enforce(|| check(&args.plan))
}

fn check(args: &PlanArgs) -> Result<(), Failure> {
    let result = args.read().map(|(job, plan)| (plan, job.notes_of_plan()));
    if args.json {
        let answer = match &result {
            Ok((plan, notes)) => json!({ "ok": true, "problems": [], "notes": notes, "plan": plan }),
            Err(failure) => {
                let problems = match failure {
                    Failure::Usage(problems) | Failure::Input(problems) => problems.clone(),
                    Failure::Refused(refused) => refused.problems.clone(),
                    other => other.messages().into_iter().map(Problem::from).collect(),
                };
                json!({ "ok": false, "problems": problems, "notes": failure.notes(), "plan": null })
            }
        };
        print(&format!("{answer:#}\n"))?;
    } else if let Ok((plan, notes)) = &result {
        print(&describe(plan, notes, None, args.verbose))?;
    }
    result.map(|_| ())
}

/// The effects that say what kind of pile it will be.
const MAIN_EFFECTS: [EffectName; 6] = [
    EffectName::Fill,
    EffectName::Glue,
    EffectName::Control,
    EffectName::StagedRelease,
    EffectName::Scenery,
    EffectName::Emitters,
];

/// The plan as text. `expected`: the estimate for the scene's own accuracy. `has_all`: with all effects.
pub fn describe(plan: &Plan, notes: &[String], expected: Option<&Estimate>, has_all: bool) -> String {
    let mut text = String::from("The scene can be baked.\n");
    let mut line = |name: &str, value: String| writeln!(text, "  {name:<22}{value}").expect("a string takes all");
    let [low, high] = plan.body_range;
    let range = if low < high { format!(" ({low} to {high} in 9 of 10 bakes)") } else { String::new() };
    line("bodies", format!("about {}{range}", plan.expected_bodies));
    line("steps", format!("about {}", plan.expected_steps));
    if let Some(dots) = expected.map(|expected| expected.glue_dots).filter(|dots| *dots >= 1.0) {
        line(
            "dots of glue",
            format!("{:.0} to {:.0}, depending on the shape", (dots / 4.0).ceil(), (2.0 * dots).ceil()),
        );
    }
    if let Some(expected) = plan.expected_match {
        line("match with the shape", format!("about {:.0} % when it is filled", 100.0 * expected));
    }
    if let Some([low, _, high]) = expected.and_then(|expected| expected.kept_shape) {
        line("kept shape", format!("{:.0} to {:.0} % in 8 of 10 bakes", 100.0 * low, 100.0 * high));
    }
    line("prop diameter", format!("{:.3} m", plan.prop_diameter));
    line("characteristic time", format!("{:.3} s", plan.characteristic_time));
    let is_shown = |effect: &&Effect| has_all || MAIN_EFFECTS.contains(&effect.name);
    for effect in plan.effects.iter().filter(is_shown).filter(|effect| effect.on) {
        let share = expected.and_then(|expected| expected.share(effect.name));
        let share = share.map_or(String::new(), |share| format!(" (about {:.0} % of the time)", 100.0 * share));
        line(effect.name.name(), format!("on: {}{share}", effect.reason));
    }
    for effect in plan.effects.iter().filter(is_shown).filter(|effect| !effect.on) {
        line(effect.name.name(), format!("off: {}", effect.reason));
    }
    if !has_all {
        line("effects", format!("{} more: -v prints them", plan.effects.len() - MAIN_EFFECTS.len()));
    }
    for note in notes.iter().chain(&plan.warnings) {
        line("note", note.clone());
    }
    text
}
