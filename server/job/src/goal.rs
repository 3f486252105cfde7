//! The goal of a scene: it chooses the accuracy `auto`, and a finished bake is held against it.

use super::machine;
use cairn_files::problem::Problem;
use cairn_input::params::Params;
use cairn_input::scene::Scene;
use cairn_prepare::estimate::{Estimate, Goal, TOLERANCE};
use cairn_wire::to_proto;
use std::fmt;

/// The figure that a goal of overlap is about.
pub const OVERLAP: &str = "visible_depth_p95";

/// The preset that `auto` became.
#[derive(Clone, Copy, Debug)]
pub struct Chosen {
    /// Its index in the ladder.
    pub index: usize,
    goal: Goal,
    is_expected: bool,
    estimate: Estimate,
    /// Nine of ten bakes take no longer, s.
    most_seconds: f64,
}

/// The preset that the goal calls for. `scene`: as its files have it. `params`: those of collision shapes, for the
/// estimate. `ladder`: the parameters of each preset, cheapest first.
pub fn choose(scene: &Scene, params: &Params, ladder: &[Params], goal: Goal) -> Result<Chosen, Vec<Problem>> {
    let estimates = machine::slowness().and_then(|machine| cairn_core::estimates(scene, params, ladder, machine));
    let estimates = estimates.map_err(|error| match error {
        cairn_core::Error::Invalid(problems) => problems.into_iter().map(Problem::from).collect(),
        other => vec![Problem::new("accuracy", other.to_string(), "Name a preset instead of auto.")],
    })?;
    let threads = rayon::current_num_threads();
    let expected: Vec<_> = estimates.iter().map(|estimate| estimate.expected(threads)).collect();
    let choice = goal.choose(&expected).expect("there are presets");
    let (index, most_seconds) = (choice.index, expected[choice.index].most_seconds);
    Ok(Chosen { index, goal, is_expected: choice.is_expected, estimate: estimates[index], most_seconds })
}

impl fmt::Display for Chosen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = to_proto::accuracy_name(self.estimate.accuracy);
        let (most, overlap) = (self.most_seconds, length(self.estimate.most_overlap));
        match self.goal {
            Goal::Time(seconds) if !self.is_expected => {
                write!(f, "no accuracy is expected to be finished in {seconds:.1} s: {name} may take {most:.1} s")
            }
            Goal::Overlap(goal) if !self.is_expected => write!(
                f,
                "no accuracy is expected to keep overlaps below {}: {name} is expected to leave {overlap}",
                length(goal)
            ),
            _ => write!(
                f,
                "accuracy {name}, expected to take up to {most:.1} s and to leave overlaps of up to {overlap}"
            ),
        }
    }
}

/// What is said of a finished bake that did not keep to its goal. `seconds`: from start to result. `overlap`: what 95
/// of 100 pairs overlap by at most, if it was measured.
pub fn missed(goal: Goal, seconds: f64, overlap: Option<f64>) -> Option<String> {
    match (goal, overlap) {
        (Goal::Time(most), _) if seconds > TOLERANCE * most => {
            Some(format!("the bake took {seconds:.1} s, its goal is {most:.1} s"))
        }
        (Goal::Overlap(_), None) => {
            Some("the overlap was not measured, which is the goal: remove report.visible=off".into())
        }
        (Goal::Overlap(most), Some(overlap)) if overlap > most => Some(format!(
            "meshes overlap by up to {}, the goal is {}: use a higher accuracy, simpler props, or a smaller \
             physics.shape_tolerance",
            length(overlap),
            length(most)
        )),
        _ => None,
    }
}

/// A length in a suitable unit.
pub fn length(metres: f64) -> String {
    match metres {
        m if m < 1e-4 => format!("{:.0} um", m * 1e6),
        m if m < 1e-2 => format!("{:.1} mm", m * 1e3),
        m => format!("{:.1} cm", m * 1e2),
    }
}
