//! How a running bake talks to its caller: progress out, cancel and the clock in.

use std::ops::ControlFlow;

/// The stages of a bake, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Collision shapes and masses.
    Shape,
    /// The upside-down container is filled and settles.
    Fill,
    /// Layers are let go from the bottom to the top.
    Release,
    /// Until at rest, or until the last frame.
    Hold,
    /// The figures of the report.
    Measure,
}

/// Where a bake stands. Counts only: whoever has a clock estimates the time left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    pub stage: Stage,
    /// 0 to 1 within the stage, never falling.
    pub fraction: f64,
    pub bodies: usize,
    pub released: usize,
    pub at_rest: usize,
    pub nails: usize,
}

/// What a bake asks of its caller.
pub trait Observer {
    /// Called at least once per step; `Break` cancels the bake.
    fn progress(&mut self, progress: &Progress) -> ControlFlow<()>;

    /// CPU seconds used so far by this thread or process: the core has no clock of its own. Used for the report
    /// only; the result never depends on it.
    fn cpu_seconds(&mut self) -> f64;
}

/// Watches nothing and never cancels; its clock stands still.
pub struct Silent;

impl Observer for Silent {
    fn progress(&mut self, _: &Progress) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn cpu_seconds(&mut self) -> f64 {
        0.0
    }
}

/// Tells progress, and turns a cancel into an error.
pub(crate) fn observe(observer: &mut dyn Observer, progress: &Progress) -> Result<(), crate::Error> {
    match observer.progress(progress) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(crate::Error::Cancelled),
    }
}
