//! Remaining time of a bake's stage, and overall progress.

use cairn_input::observer::{Progress, Stage};
use std::time::Instant;

/// The pace of the running stage.
#[derive(Default)]
pub struct StagePace {
    stage: Option<(Stage, Instant)>,
    /// The last estimate, s.
    shown: Option<f64>,
}

impl StagePace {
    /// Follows the progress. Returns whether a stage has begun.
    pub fn follow(&mut self, progress: &Progress) -> bool {
        let began = self.stage.is_none_or(|(stage, _)| stage != progress.stage);
        if began {
            *self = StagePace { stage: Some((progress.stage, Instant::now())), shown: None };
        }
        began
    }

    /// Remaining time of this stage, s, from its pace so far. The estimate never grows; `None` where it would have to
    /// grow by much, and for glue: how many attempts it takes shows in their trials alone.
    pub fn remaining_seconds(&mut self, progress: &Progress) -> Option<f64> {
        /// Before this fraction is done, a stage's pace says little.
        const MEANINGFUL: f64 = 0.02;
        let (_, began) = self.stage.filter(|(stage, _)| *stage != Stage::Glue)?;
        let left = began.elapsed().as_secs_f64() / progress.fraction * (1.0 - progress.fraction);
        if progress.fraction < MEANINGFUL { None } else { self.fall(left) }
    }

    /// The estimate to show when `left` seconds seem to remain.
    fn fall(&mut self, left: f64) -> Option<f64> {
        /// Growth beyond which the shown estimate was wrong.
        const WRONG: f64 = 1.5;
        match self.shown {
            Some(shown) if left > WRONG * shown => None,
            shown => {
                self.shown = Some(shown.map_or(left, |shown| shown.min(left)));
                self.shown
            }
        }
    }
}

/// Overall progress of a bake, 0 to 1, by the stages' usual shares of the time. It never falls.
pub fn overall(progress: &Progress) -> f64 {
    overall_at(progress.stage, progress.fraction)
}

/// The same at a fraction of a stage.
pub fn overall_at(stage: Stage, fraction: f64) -> f64 {
    // The share before the stage, and the stage's own.
    let (before, share) = match stage {
        Stage::Shape => (0.0, 0.02),
        Stage::Fill => (0.02, 0.58),
        Stage::Glue => (0.6, 0.1),
        Stage::Release => (0.7, 0.15),
        Stage::Hold => (0.85, 0.1),
        Stage::Measure => (0.95, 0.05),
    };
    before + share * fraction.clamp(0.0, 1.0)
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
    fn remaining_time_falls_or_is_unknown() {
        let mut pace = StagePace::default();
        let seem = [10.0, 8.0, 9.0, 30.0, 11.0, 5.0];
        let shown = seem.map(|left| pace.fall(left));
        assert_eq!(shown, [Some(10.0), Some(8.0), Some(8.0), None, Some(8.0), Some(5.0)]);
    }

    #[test]
    fn nobody_knows_how_long_glue_takes() {
        for (stage, is_known) in [(Stage::Fill, true), (Stage::Glue, false)] {
            let counts = Progress { stage, fraction: 0.5, bodies: 0, released: 0, at_rest: 0, nails: 0, frames: 0 };
            let mut pace = StagePace::default();
            assert!(pace.follow(&counts));
            assert_eq!(pace.remaining_seconds(&counts).is_some(), is_known, "{stage:?}");
        }
    }
}
