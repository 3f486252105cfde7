//! The goal of a bake: a time or an overlap chooses its accuracy.

use super::summary::length;
use super::{Failure, print_note, print_warning};
use crate::scene_file::SceneTree;
use cairn_core::prepare::estimate::{Expected, Goal, TOLERANCE};
use std::time::Duration;

/// The arguments that choose an accuracy by a goal.
#[derive(clap::Args)]
pub struct GoalArgs {
    /// Choose the accuracy by a time from start to result, such as 20s or 5m: the most accurate preset that is expected
    /// to be finished by then
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration, help_heading = "Goal")]
    #[arg(conflicts_with = "accuracy")]
    budget: Option<Duration>,

    /// Choose the accuracy by how much meshes may be seen to overlap (95 of 100 pairs), such as 0.1mm: the cheapest
    /// preset that keeps to it. A pile that does not is baked again with the next one
    #[arg(long, value_name = "LENGTH", value_parser = metres, help_heading = "Goal")]
    #[arg(conflicts_with_all = ["accuracy", "budget"])]
    overlap: Option<f64>,
}

/// The figure that a goal of overlap is about.
pub const OVERLAP: &str = "visible_depth_p95";

/// What a bake came to.
pub struct Outcome {
    /// From start to result, s.
    pub seconds: f64,
    /// [`OVERLAP`], m, if it was measured.
    pub overlap: Option<f64>,
}

impl GoalArgs {
    pub fn goal(&self) -> Option<Goal> {
        let time = self.budget.map(|budget| Goal::Time(budget.as_secs_f64()));
        time.or(self.overlap.map(Goal::Overlap))
    }
}

/// Bakes with the accuracy that the goal calls for; where it is an overlap that is not kept, once more with the next.
/// `ladder`: what each accuracy is expected to come to, cheapest first.
pub fn keep(
    goal: Goal,
    ladder: &[(String, Expected)],
    tree: &SceneTree,
    mut bake: impl FnMut(&SceneTree) -> Result<Outcome, Failure>,
) -> Result<(), Failure> {
    let expected: Vec<Expected> = ladder.iter().map(|(_, expected)| *expected).collect();
    let Some(choice) = goal.choose(&expected) else {
        return Err(Failure::Internal("the server estimates no accuracy".into()));
    };
    if !choice.is_expected {
        let (name, expected) = &ladder[choice.index];
        print_warning(&match goal {
            Goal::Time(seconds) => format!(
                "no accuracy is expected to be finished in {seconds:.1} s: {name} may take {:.1} s",
                expected.most_seconds
            ),
            Goal::Overlap(most) => format!(
                "no accuracy is expected to keep overlaps below {}: {name} is expected to leave {}",
                length(most),
                length(expected.overlap)
            ),
        });
    }
    for (number, (name, expected)) in ladder.iter().enumerate().skip(choice.index) {
        print_note(&format!("accuracy {name}, expected to take up to {:.1} s", expected.most_seconds));
        let mut tree = tree.clone();
        tree.set(&format!("accuracy={name}")).map_err(Failure::Usage)?;
        let found = bake(&tree)?;
        let is_last = number + 1 == ladder.len();
        match goal {
            Goal::Time(seconds) if found.seconds > TOLERANCE * seconds => {
                print_warning(&format!("the bake took {:.1} s, its budget is {seconds:.1} s", found.seconds));
            }
            Goal::Time(_) => {}
            Goal::Overlap(most) => match found.overlap {
                None => print_warning("the overlap was not measured: remove report.visible=off from the scene"),
                Some(overlap) if overlap <= most => {}
                Some(overlap) if is_last => print_warning(&format!(
                    "meshes overlap by up to {}, more than {}, at the highest accuracy: use simpler props, or a \
                     smaller physics.shape_tolerance",
                    length(overlap),
                    length(most)
                )),
                Some(overlap) => {
                    print_note(&format!("meshes overlap by up to {}, more than {}", length(overlap), length(most)));
                    continue;
                }
            },
        }
        break;
    }
    Ok(())
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
