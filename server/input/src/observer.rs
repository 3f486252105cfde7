//! The interface between a running bake and its caller: progress and frames out, cancel and the clock in.

use cairn_geometry::pose::Pose;
use std::ops::ControlFlow;

/// The stages of a bake, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Collision shapes and masses.
    Shape,
    /// The upside-down container is filled and settles.
    Fill,
    /// Glue joints are placed, and the pile is released on trial to prove that it stands.
    Glue,
    /// Layers are released from the bottom to the top.
    Release,
    /// The simulation continues until the pile is at rest, or until the last frame.
    Hold,
    /// The figures of the report are measured.
    Measure,
}

/// The progress of a bake. Counts only: the caller, which has a clock, estimates the time left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    pub stage: Stage,
    /// 0 to 1 within the stage, never decreasing.
    pub fraction: f64,
    pub bodies: usize,
    pub released: usize,
    pub at_rest: usize,
    pub nails: usize,
    /// Frames of the result, from [`Stage::Measure`] on; 0 before.
    pub frames: usize,
}

/// The bodies at a moment, reported while the bake runs.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// [`Stage::Fill`], [`Stage::Release`] or [`Stage::Hold`].
    pub stage: Stage,
    /// From the release on, the number of the result's frame. The fill counts its own frames from 0.
    pub number: usize,
    /// Time since the fill began or since turning over, s.
    pub time: f64,
    /// Shape `[body]`; `None` where a body has been removed. The fill's indices are not those of the result.
    pub bodies: &'a [Option<FrameBody>],
    /// Shape `[body]`, or empty where all are there from the beginning: the bodies that come in later.
    pub comers: &'a [FrameBody],
}

/// One body of a frame.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FrameBody {
    /// Index into the scene's props.
    pub prop: usize,
    /// Uniform scale of the prop: bodies grow during the fill.
    pub scale: f64,
    /// From the prop's own frame, scaled, to the world; metres.
    pub pose: Pose,
    pub state: State,
}

/// The state of a body under the control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum State {
    /// The control is off, or has ended, or has not begun.
    #[default]
    Free,
    /// Not released yet.
    Waiting,
    /// Free: too fast for a verdict, or not found stable enough by the latest.
    Unstable,
    /// Free, but a candidate in the latest verdict.
    Candidate,
    /// Held, or nailed.
    Held,
    /// Free, with its centre of mass outside the region.
    Outside,
    /// Placed by hand, to stay.
    Pinned,
    /// Free, and glued to others.
    Glued,
    /// Glued to the ground or to scenery.
    Anchored,
}

/// The caller of a bake.
pub trait Observer {
    /// Called at least once per step; `Break` cancels the bake.
    fn progress(&mut self, progress: &Progress) -> ControlFlow<()>;

    /// CPU seconds used so far by this thread or process: the core has no clock of its own. Only the report uses it;
    /// the result never depends on it.
    fn cpu_seconds(&mut self) -> f64;

    /// [`Observer::frame`] is to be called. Frames that are not wanted cost nothing.
    fn wants_frames(&self) -> bool {
        false
    }

    /// Receives a frame: in order, those of the fill at the result's frame rate, then those of the result, which are
    /// its final pose alone where no frames are kept.
    fn frame(&mut self, _: &Frame) {}

    /// Receives the numbers in the names of the result's bodies, before its frames. Shape `[body]`. Not called where
    /// they are the indices.
    fn numbers(&mut self, _: &[usize]) {}
}

/// Ignores progress and never cancels; its clock stands still.
pub struct Silent;

impl Observer for Silent {
    fn progress(&mut self, _: &Progress) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn cpu_seconds(&mut self) -> f64 {
        0.0
    }
}

/// Reports progress, and turns a cancel into an error.
pub fn observe(observer: &mut dyn Observer, progress: &Progress) -> Result<(), crate::error::Error> {
    match observer.progress(progress) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(crate::error::Error::Cancelled),
    }
}
