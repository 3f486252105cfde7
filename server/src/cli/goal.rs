//! The arguments that set the goal of a bake. An overlap that is not kept is baked again.

use super::{Failure, print_note};
use cairn_input::params::Accuracy;
use cairn_prepare::estimate::Goal;
use cairn_wire::from_proto;
use cairn_wire::proto;
use cairn_wire::scene_file::SceneTree;
use cairn_wire::to_proto::accuracy_name;
use serde_json::json;
use std::time::Duration;

/// The arguments that choose an accuracy by a goal.
#[derive(clap::Args)]
pub struct GoalArgs {
    /// Choose the accuracy by a time from start to result, such as 20s or 5m: accuracy=auto and goal.seconds
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration, help_heading = "Goal")]
    #[arg(conflicts_with = "accuracy")]
    budget: Option<Duration>,

    /// Choose the accuracy by how much meshes may be seen to overlap (95 of 100 pairs), such as 0.1mm: accuracy=auto
    /// and goal.overlap. A pile that overlaps by more is baked again with the next preset
    #[arg(long, value_name = "LENGTH", value_parser = metres, help_heading = "Goal")]
    #[arg(conflicts_with_all = ["accuracy", "budget"])]
    overlap: Option<f64>,
}

/// What a bake came to.
pub struct Outcome {
    pub accuracy: Accuracy,
    /// [`cairn_job::goal::OVERLAP`], m, if it was measured.
    pub overlap: Option<f64>,
}

impl GoalArgs {
    /// Sets the goal in a scene.
    pub fn set(&self, tree: &mut SceneTree) {
        let seconds = self.budget.map(|budget| json!({ "seconds": budget.as_secs_f64() }));
        if let Some(goal) = seconds.or(self.overlap.map(|overlap| json!({ "overlap": overlap }))) {
            tree.put("goal", goal);
            tree.put("accuracy", proto::Accuracy::Auto.as_str_name().into());
        }
    }
}

/// Bakes; where an overlap is the goal of `auto` and not kept, once more with the next preset.
pub fn keep(tree: &SceneTree, mut bake: impl FnMut(&SceneTree) -> Result<Outcome, Failure>) -> Result<(), Failure> {
    let scene = tree.to_message();
    let most = match from_proto::goal(&scene).0 {
        Some(Goal::Overlap(most)) if scene.accuracy() == proto::Accuracy::Auto => most,
        _ => f64::INFINITY,
    };
    let mut tree = tree.clone();
    loop {
        let found = bake(&tree)?;
        let place = Accuracy::LADDER.iter().position(|&accuracy| accuracy == found.accuracy);
        let next = place.and_then(|place| Accuracy::LADDER.get(place + 1));
        match (found.overlap, next) {
            (Some(overlap), Some(&next)) if overlap > most => {
                let name = accuracy_name(next);
                print_note(&format!("baking again with accuracy {name}"));
                tree.set(&format!("accuracy={name}")).map_err(Failure::Usage)?;
            }
            _ => return Ok(()),
        }
    }
}

/// `0.1mm`, `20um`, `1cm`; a bare number is metres.
fn metres(text: &str) -> Result<f64, String> {
    let units = [("um", 1e-6), ("mm", 1e-3), ("cm", 1e-2), ("m", 1.0), ("", 1.0)];
    let (number, unit) = units.iter().find_map(|(unit, scale)| Some((text.strip_suffix(unit)?, scale))).unwrap();
    match number.trim().parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value * unit),
        _ => Err("give a length such as 0.1mm, 20um or 1cm".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_units() {
        for (text, value) in [("0.1mm", 1e-4), ("20um", 2e-5), ("1cm", 0.01), ("2 m", 2.0), ("0.5", 0.5), ("0", 0.0)] {
            assert!((metres(text).unwrap() - value).abs() < 1e-12, "{text}");
        }
        for text in ["", "mm", "-1mm", "infm", "nan", "1km"] {
            assert!(metres(text).is_err(), "{text}");
        }
    }
}
