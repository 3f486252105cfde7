//! How long a bake's stage will still take.

use cairn_core::input::observer::{Progress, Stage};
use std::time::Instant;

/// The pace of the running stage.
#[derive(Default)]
pub struct Pace {
    stage: Option<(Stage, Instant)>,
    /// What was told last, s.
    told: Option<f64>,
}

impl Pace {
    /// Returns whether a stage has begun.
    pub fn follow(&mut self, progress: &Progress) -> bool {
        let began = self.stage.is_none_or(|(stage, _)| stage != progress.stage);
        if began {
            *self = Pace { stage: Some((progress.stage, Instant::now())), told: None };
        }
        began
    }

    /// Left in this stage, s, from its pace so far. It only falls; where it ought to rise by much, nobody knows.
    pub fn remaining_seconds(&mut self, progress: &Progress) -> Option<f64> {
        /// Before this much is done, a stage's pace says little.
        const TELLING: f64 = 0.02;
        let (_, began) = self.stage?;
        let left = began.elapsed().as_secs_f64() / progress.fraction * (1.0 - progress.fraction);
        if progress.fraction < TELLING { None } else { self.fall(left) }
    }

    /// What to tell where `left` seconds seem to be left.
    fn fall(&mut self, left: f64) -> Option<f64> {
        /// Beyond this many times what was told, it was wrong.
        const WRONG: f64 = 1.5;
        match self.told {
            Some(told) if left > WRONG * told => None,
            told => {
                self.told = Some(told.map_or(left, |told| told.min(left)));
                self.told
            }
        }
    }
}

/// How far a bake is as a whole, 0 to 1, from what each stage takes of most bakes. It only rises.
pub fn overall(progress: &Progress) -> f64 {
    // Before the stage, and of it.
    let (before, share) = match progress.stage {
        Stage::Shape => (0.0, 0.02),
        Stage::Fill => (0.02, 0.58),
        Stage::Glue => (0.6, 0.1),
        Stage::Release => (0.7, 0.15),
        Stage::Hold => (0.85, 0.1),
        Stage::Measure => (0.95, 0.05),
    };
    before + share * progress.fraction.clamp(0.0, 1.0)
}

pub fn name(stage: Stage) -> &'static str {
    match stage {
        Stage::Shape => "shape",
        Stage::Fill => "fill",
        Stage::Glue => "glue",
        Stage::Release => "release",
        Stage::Hold => "hold",
        Stage::Measure => "measure",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_left_only_falls_or_is_not_known() {
        let mut pace = Pace::default();
        let seem = [10.0, 8.0, 9.0, 30.0, 11.0, 5.0];
        let told = seem.map(|left| pace.fall(left));
        assert_eq!(told, [Some(10.0), Some(8.0), Some(8.0), None, Some(8.0), Some(5.0)]);
    }
}
