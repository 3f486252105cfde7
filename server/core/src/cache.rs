//! Collision shapes and fill of an earlier bake, reused where all that they depend on is the same.
//!
//! The core keeps nothing itself: it asks its caller for an earlier fill, and hands out a new one for keeping.

use crate::fill::Filled;
use cairn_engine::shape::Shape;
use cairn_input::earlier::EarlierPile;
use cairn_input::observer::{Frame, FrameBody, Observer, Progress, Stage};
use cairn_input::params::{Base, Fill, Params, Physics};
use cairn_input::scene::{Model, PileShape, PlacedBody, Prop, Scene, StaticModel};
use cairn_prepare::check::CheckedScene;
use std::ops::ControlFlow;

/// All that shapes and fill depend on: equal inputs give equal results.
#[derive(Debug, serde::Serialize)]
pub struct FillInputs<'a> {
    control: &'a Option<Model>,
    piles: &'a [PileShape],
    props: &'a [Prop],
    /// As it stands in the first frame: the fill leaves room for it.
    statics: &'a [StaticModel],
    /// Whether there is a ground: without one, nothing lies below a landscape.
    has_ground: bool,
    /// Those that are there from the beginning: the fill leaves room for them.
    bodies: Vec<&'a PlacedBody>,
    diameter: f64,
    shares: &'a [f64],
    ground: f64,
    seed: u64,
    gravity: f64,
    physics: &'a Physics,
    base: &'a Base,
    fill: &'a Fill,
    /// What the fill may keep, and all that decides which poses it keeps.
    earlier: Option<(&'a EarlierPile, &'a Params)>,
    /// The rate of the frames that the observer gets; `None` where it wants none.
    fps: Option<f64>,
}

impl<'a> FillInputs<'a> {
    pub fn new(scene: &'a Scene, params: &'a Params, checked: &'a CheckedScene, with_frames: bool) -> FillInputs<'a> {
        FillInputs {
            control: &scene.control,
            piles: &scene.piles,
            props: &scene.props,
            statics: &scene.statics,
            has_ground: params.ground,
            bodies: scene.bodies.iter().filter(|body| body.is_stacked()).collect(),
            diameter: checked.diameter,
            shares: &checked.shares,
            ground: checked.ground,
            seed: params.seed,
            gravity: params.gravity,
            physics: &params.physics,
            base: &params.base,
            fill: &params.fill,
            earlier: scene.earlier.as_ref().map(|earlier| (earlier, params)),
            fps: with_frames.then_some(params.output.fps),
        }
    }
}

/// Shapes, fill and the frames of the fill.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct CachedFill {
    pub shapes: Vec<Shape>,
    /// `None` where nothing is filled.
    pub filled: Option<Filled>,
    /// The frames that the observer got; `None` where it wanted none.
    pub shown: Option<Vec<CachedFrame>>,
}

/// A frame of a fill.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct CachedFrame {
    number: usize,
    time: f64,
    bodies: Vec<Option<FrameBody>>,
}

/// A store of fills of earlier bakes.
pub trait FillCache {
    /// The fill of an earlier bake with the same inputs.
    fn get(&mut self, inputs: &FillInputs) -> Option<CachedFill>;

    fn put(&mut self, inputs: &FillInputs, found: &CachedFill);

    /// Fills are kept.
    fn keeps(&self) -> bool;
}

/// Keeps nothing.
pub struct NoCache;

impl FillCache for NoCache {
    fn get(&mut self, _: &FillInputs) -> Option<CachedFill> {
        None
    }

    fn put(&mut self, _: &FillInputs, _: &CachedFill) {}

    fn keeps(&self) -> bool {
        false
    }
}

impl CachedFill {
    /// Shows the frames again, to an observer that wants some.
    pub fn show(&self, observer: &mut dyn Observer) {
        if !observer.wants_frames() {
            return;
        }
        for still in self.shown.iter().flatten() {
            let &CachedFrame { number, time, ref bodies } = still;
            observer.frame(&Frame { stage: Stage::Fill, number, time, bodies, comers: &[] });
        }
    }
}

/// Passes everything on, and keeps the frames.
pub struct FrameKeeper<'a> {
    to: &'a mut dyn Observer,
    /// `None`: frames are not wanted, or too many.
    shown: Option<Vec<CachedFrame>>,
    /// Bodies in them.
    bodies: usize,
}

/// Bodies over all frames of a fill that is kept: about 100 MB.
const MOST_SHOWN: usize = 1_000_000;

impl<'a> FrameKeeper<'a> {
    pub fn new(to: &'a mut dyn Observer, keeps: bool) -> FrameKeeper<'a> {
        let shown = (keeps && to.wants_frames()).then(Vec::new);
        FrameKeeper { to, shown, bodies: 0 }
    }

    /// The frames, where all were kept.
    pub fn into_shown(self) -> Option<Vec<CachedFrame>> {
        self.shown
    }
}

impl Observer for FrameKeeper<'_> {
    fn progress(&mut self, progress: &Progress) -> ControlFlow<()> {
        self.to.progress(progress)
    }

    fn cpu_seconds(&mut self) -> f64 {
        self.to.cpu_seconds()
    }

    fn wants_frames(&self) -> bool {
        self.to.wants_frames()
    }

    fn frame(&mut self, frame: &Frame) {
        self.bodies += frame.bodies.len();
        if self.bodies > MOST_SHOWN {
            self.shown = None;
        }
        if let Some(shown) = &mut self.shown {
            shown.push(CachedFrame { number: frame.number, time: frame.time, bodies: frame.bodies.to_vec() });
        }
        self.to.frame(frame);
    }
}
