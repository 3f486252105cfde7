//! CPU time of a bake.

use cairn_core::report::Report;
use cairn_input::observer::{Observer, Progress, Stage};
use cpu_time::ProcessTime;
use std::ops::ControlFlow;

/// CPU seconds from turning over to the last frame.
pub fn simulation(report: &Report) -> f64 {
    [Stage::Glue, Stage::Release, Stage::Hold].iter().filter_map(|stage| report.seconds.get(stage)).sum()
}

/// Counts CPU time and cancels nothing.
pub struct Cpu;

impl Observer for Cpu {
    fn progress(&mut self, _: &Progress) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn cpu_seconds(&mut self) -> f64 {
        ProcessTime::now().as_duration().as_secs_f64()
    }
}
