//! Messages -> the core's types. A field that is not set has the accuracy preset's value.
//!
//! Ranges are checked by the core; only values that the core's types cannot hold are refused here.

pub mod extra_bodies;

use super::parameters::{self, Counts};
use crate::proto;
use cairn_files::problem::Problem;
use cairn_input::observer::{Progress, Stage};
use cairn_input::params::{Accuracy, FillMethod, Params};
use cairn_prepare::estimate::Goal;

/// The parameters of a scene.
pub fn params(scene: &proto::Scene) -> Result<Params, Vec<Problem>> {
    let (params, problems) = params_and_problems(scene);
    if problems.is_empty() { Ok(params) } else { Err(problems) }
}

/// The parameters of a scene, as far as they can be read, and the problems of the others.
pub fn params_and_problems(scene: &proto::Scene) -> (Params, Vec<Problem>) {
    let mut counts = Counts::default();
    let mut params = Params::new(Option::from(scene.accuracy()).unwrap_or(Accuracy::Standard));
    parameters::set_all(&mut params, scene, &mut counts);
    // A stack is tidy, and a tidy fill is a stack: either field implies the other.
    let fill = scene.fill.clone().unwrap_or_default();
    match (fill.method(), fill.order) {
        (proto::FillMethod::Stack, None) => params.fill.order = 1.0,
        (proto::FillMethod::Unspecified, Some(order)) if order > 0.0 => params.fill.method = FillMethod::Stack,
        _ => {}
    }
    until(&mut params, scene, &mut counts);
    (params, counts.problems)
}

/// The goal of a scene, and what is wrong with it.
pub fn goal(scene: &proto::Scene) -> (Option<Goal>, Vec<Problem>) {
    use proto::goal::Kind;
    /// s, m.
    const MOST: [f64; 2] = [1e9, 1e6];
    let given = scene.goal.and_then(|goal| goal.kind);
    let problem = |field: &str, what: String, remedy: String| vec![Problem::new(field, what, remedy).of_field(field)];
    let (field, number, most, goal) = match given {
        Some(Kind::Seconds(seconds)) => ("goal.seconds", seconds, MOST[0], Goal::Time(seconds)),
        Some(Kind::Overlap(overlap)) => ("goal.overlap", overlap, MOST[1], Goal::Overlap(overlap)),
        None if scene.accuracy() == proto::Accuracy::Auto => {
            let remedy = "Give goal.seconds or goal.overlap, or name a preset.".into();
            return (None, problem("goal", "it is not set, and decides what accuracy auto is".into(), remedy));
        }
        None => return (None, Vec::new()),
    };
    match (0.0..=most).contains(&number) {
        true => (Some(goal), Vec::new()),
        false => (None, problem(field, format!("{number} is out of range"), format!("Give a value from 0 to {most}."))),
    }
}

/// The progress of a bake that runs elsewhere.
pub fn progress(progress: &proto::Progress) -> Progress {
    let count = |count: i32| usize::try_from(count).unwrap_or(0);
    Progress {
        stage: Option::from(progress.stage()).unwrap_or(Stage::Shape),
        fraction: progress.fraction,
        bodies: count(progress.body_count),
        released: count(progress.released_count),
        at_rest: count(progress.at_rest_count),
        nails: count(progress.nail_count),
        frames: count(progress.frame_count),
    }
}

/// Sets the end of the control. A frame is converted by the output's frame rate, which is set or the preset's.
fn until(params: &mut Params, scene: &proto::Scene, counts: &mut Counts) {
    use proto::control::Until;
    match scene.control.and_then(|control| control.until) {
        None => {}
        Some(Until::UntilSeconds(seconds)) => params.control.until = Some(seconds),
        Some(Until::UntilFrame(frame)) => {
            let frame: u32 = counts.natural("control.until_frame", frame);
            if f64::from(frame) > extra_bodies::LAST_FRAME {
                let problem = Problem::new(
                    "control.until_frame",
                    format!("{frame} is out of range"),
                    format!("Give 0 to {}.", extra_bodies::LAST_FRAME),
                );
                counts.problems.push(problem.of_field("control.until_frame"));
            }
            params.control.until = Some(f64::from(frame) / params.output.fps);
        }
    }
}
