//! How long a bake's stage will still take.

use cairn_core::input::observer::{Progress, Stage};
use std::time::Instant;

/// The pace of the running stage.
#[derive(Default)]
pub struct Pace {
    stage: Option<(Stage, Instant)>,
}

impl Pace {
    /// Returns whether a stage has begun.
    pub fn follow(&mut self, progress: &Progress) -> bool {
        let began = self.stage.is_none_or(|(stage, _)| stage != progress.stage);
        if began {
            self.stage = Some((progress.stage, Instant::now()));
        }
        began
    }

    /// Left in this stage, s, from its pace so far.
    pub fn remaining_seconds(&self, progress: &Progress) -> Option<f64> {
        /// Before this much is done, a stage's pace says little.
        const TELLING: f64 = 0.02;
        let (_, began) = self.stage?;
        (progress.fraction >= TELLING)
            .then(|| began.elapsed().as_secs_f64() / progress.fraction * (1.0 - progress.fraction))
    }
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
