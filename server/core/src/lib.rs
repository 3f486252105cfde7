//! Piles of props in the shape of a mesh: the method of Hsu & Keyser (2012), and its measures. Long: all meet here.
//!
//! [`bake`] takes meshes and parameters and returns poses and figures. It goes through these stages, each a function of
//! the one before:
//!
//! 1. **Prepare** ([`cairn_prepare`]): the scene is checked, each prop gets a collision shape and a mass, and the
//!    closed control mesh becomes a container.
//! 2. **Fill** ([`fill`]): props fill the container under upward gravity, as if it stood on its head, and
//!    settle in it.
//! 3. **Turn over** ([`turn_over`]): the container is gone, gravity points down, and every body waits in place.
//! 4. **Glue** ([`glue`]): where the parameters ask for it, contacts are glued until the pile stands by itself.
//! 5. **Release** ([`release`]): the bodies begin to move, layer by layer from the bottom to the top. Meanwhile the
//!    control ([`cairn_motion::control`]) finds bodies that are in equilibrium ([`cairn_statics::local`]) and holds
//!    them still, which keeps the shape. A glued pile is released at once, without control.
//! 6. **Hold** ([`cairn_motion::hold`]): until the pile rests. Bodies may then be taken away
//!    ([`cairn_show::taking_apart`]), and visible meshes separated ([`separate`]).
//! 7. **Report** ([`report`]): the pile is measured.
//!
//! Synchronous and pure: no files, no clock, no wire, no global randomness. A caller builds a [`Scene`] (the meshes),
//! [`Params`] (from a preset) and an [`Observer`] (progress, cancel, frames, clock):
//!
//! ```no_run
//! use cairn_input::observer::Silent;
//! use cairn_input::params::{Accuracy, Params};
//! use cairn_input::scene::{Model, Prop, Scene};
//! # fn read(_: &str) -> Model { Model::default() }
//!
//! let (control, props) = (Some(read("cone.glb")), vec![Prop::new(read("stick.glb"))]);
//! let scene = Scene { control, props, ..Scene::default() };
//! let bake = cairn_core::bake(&scene, &Params::new(Accuracy::Standard), &mut Silent)?;
//! println!("{} bodies, {} frames", bake.pile.bodies.len(), bake.pile.frames[0].len());
//! # Ok::<(), cairn_input::Error>(())
//! ```
//!
//! Meshes are read from glTF files by [`cairn_input::asset::read`].
//!
//! It must never know a file, a message, a clock or who asks. It names no engine: the world is [`cairn_engine::world`].

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod cache;
pub mod calibrate;
mod containers;
pub mod fill;
pub mod free_pour;
pub mod free_standing;
pub mod glue;
pub mod keep;
pub mod release;
pub mod report;
pub mod separate;
mod sight;
#[cfg(test)]
#[path = "../../testing/messages.rs"]
mod testing;
pub mod turn_over;

pub use cairn_input::Error;

use cache::{CachedFill, FillCache, FillInputs, FrameKeeper, NoCache};
use cairn_analysis::{AnalysisOptions, PileAnalysis};
use cairn_engine::shape::{self, Shape, ShapeSummary};
use cairn_engine::units::Units;
use cairn_geometry::interior::DistanceGrid;
use cairn_geometry::pose::Pose;
use cairn_input::error::SceneProblem;
use cairn_input::observer::{Observer, Silent, Stage};
use cairn_input::params::{Params, ReleaseOrder, Switch};
use cairn_input::scene::{Prop, Scene, StaticModel};
use cairn_motion::glue::sites::KnownGlue;
use cairn_motion::hold::{self, HoldOutcome};
use cairn_motion::step::Simulation;
use cairn_prepare::check::{self, CheckedScene};
use cairn_prepare::container::{Container, grid};
use cairn_prepare::effects::{EffectName, Resolved};
use cairn_prepare::estimate::{self, Estimate, Workload};
use cairn_prepare::plan::{self, Plan};
use cairn_show::collapse;
use cairn_show::entrance::{self, Entrance};
use cairn_show::taking_apart::{self, RemovedBody};
use containers::CommonFill;
use fill::{FillTask, Filled};
use glue::Glued;
use keep::{Kept, Outcome};
use rayon::prelude::*;
use report::bake::{Bake, BakedBody, BakedPile, BakedSolid, BakedWorld, prop_frames};
use report::clock::Clock;
use report::inputs::{PhysicsAlone, ReportInputs};
use report::make;
use separate::Separation;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use turn_over::TurnOverInputs;

/// Checks the scene and summarizes the bake without simulating it.
pub fn plan(scene: &Scene, params: &Params) -> Result<Plan, Error> {
    plan_checked(scene, params).map(|(plan, _)| plan)
}

/// As [`plan()`], with the checked scene: a bake goes on from it by [`fill_checked`].
pub fn plan_checked(scene: &Scene, params: &Params) -> Result<(Plan, CheckedScene), Error> {
    let checked = check::run(scene, params).map_err(Error::Invalid)?;
    let summaries = shape::summaries(scene, params, &checked.sizes)?;
    let resolved = Resolved::new(scene, params, &checked, &summaries);
    Ok((plan::of(scene, params, &checked, &resolved), checked))
}

/// The numbers that decide the cost of a bake. Makes the collision shapes, and simulates nothing.
pub fn workload(scene: &Scene, params: &Params) -> Result<Workload, Error> {
    let checked = check::run(scene, params).map_err(Error::Invalid)?;
    let shapes = shape::run(scene, params, &checked.sizes, &mut Silent)?;
    Ok(Workload::of(scene, params, &checked, &shapes))
}

/// Estimates the cost of the scene with each of `ladder`, by collision shapes as these ask for; simulates nothing.
/// `machine`: from [`calibrate`].
pub fn estimates(scene: &Scene, params: &Params, ladder: &[Params], machine: f64) -> Result<Vec<Estimate>, Error> {
    // The result of the check does not depend on the accuracy.
    let checked = check::run(scene, params).map_err(Error::Invalid)?;
    let maker = |(i, params): (usize, &Params)| {
        let like = params.accuracy.traits().shapes_like;
        ladder.iter().position(|other| other.accuracy == like).unwrap_or(i)
    };
    let makers: Vec<usize> = ladder.iter().enumerate().map(maker).collect();
    let made = makers.iter().copied().collect::<BTreeSet<usize>>().into_par_iter();
    let made = made.map(|i| Ok((i, shape::run(scene, &ladder[i], &checked.sizes, &mut Silent)?)));
    let shapes: BTreeMap<usize, Vec<Shape>> = made.collect::<Result<_, Error>>()?;
    let pairs = ladder.iter().zip(&makers);
    Ok(pairs.map(|(params, i)| estimate::of(scene, params, &checked, &shapes[i], machine)).collect())
}

/// The method: fill, turn over, glue, release, hold, report. A scene may bring its bodies along instead of a fill.
pub fn bake(scene: &Scene, params: &Params, observer: &mut dyn Observer) -> Result<Bake, Error> {
    bake_with(scene, params, &mut NoCache, observer)
}

/// As [`bake`], with the fills of earlier bakes.
pub fn bake_with(
    scene: &Scene,
    params: &Params,
    cache: &mut dyn FillCache,
    observer: &mut dyn Observer,
) -> Result<Bake, Error> {
    let full = fill_container(scene, params, cache, observer)?;
    let released = release_pile(scene, params, &full, observer)?;
    released.measured(observer)
}

/// Analyses bodies that are placed by hand, as they stand; nothing is simulated. The scene has no control mesh.
pub fn analyse(
    scene: &Scene,
    params: &Params,
    options: &AnalysisOptions,
    observer: &mut dyn Observer,
) -> Result<PileAnalysis, Error> {
    let mut full = fill_container(scene, params, &mut NoCache, observer)?;
    full.shapes = full.shapes.iter().zip(&scene.props).map(|(shape, prop)| shape.bared(&prop.model.mesh)).collect();
    let mut sim = full.turn_over(scene, params)?;
    sim.pile.world.judge_meshes(&full.shapes);
    cairn_analysis::run(&mut sim.pile.world, options, observer)
}

/// A full container, ready to be turned over; any number of releases may start from it.
pub struct FullContainer {
    checked: CheckedScene,
    shapes: Vec<Shape>,
    units: Units,
    filled: Option<(Container, Filled)>,
    /// What stays of an earlier pile: the first bodies of the fill.
    kept: Option<Kept>,
    /// The region of control and glue, if it is not the inside of the container; engine units.
    region: Option<DistanceGrid>,
    /// The fill comes from the cache.
    is_cached: bool,
    clock: Clock,
}

impl FullContainer {
    /// The pile right after turning over, for tools that examine a release.
    pub fn turn_over<'a>(&'a self, scene: &'a Scene, params: &'a Params) -> Result<Simulation<'a>, Error> {
        self.turn_over_as(scene, params, &self.resolved(scene, params))
    }

    fn resolved(&self, scene: &Scene, params: &Params) -> Resolved {
        Resolved::new(scene, params, &self.checked, &summaries(&self.shapes))
    }

    fn turn_over_as<'a>(
        &'a self,
        scene: &'a Scene,
        params: &'a Params,
        resolved: &Resolved,
    ) -> Result<Simulation<'a>, Error> {
        turn_over::run(&TurnOverInputs {
            scene,
            params,
            resolved,
            shapes: &self.shapes,
            units: self.units,
            bodies: self.filled.as_ref().map_or(&[][..], |(_, filled)| &filled.bodies),
            kept: self.kept.as_ref().map_or(0, |kept| kept.instances.len()),
            ground: self.checked.ground,
            container: self.filled.as_ref().map(|(container, _)| container),
            core: self.checked.core.as_ref(),
            region: self.region(),
            settles_first: self.settles_first(params),
        })
    }

    /// Whether the pile comes to rest before frame 0, while all that happens in the scene waits.
    fn settles_first(&self, params: &Params) -> bool {
        params.output.settled.is_on(self.checked.rides)
    }

    /// The region of the control, engine units; `None`: everywhere.
    fn region(&self) -> Option<&DistanceGrid> {
        self.region.as_ref().or(self.filled.as_ref().map(|(container, _)| &container.distance))
    }
}

/// The first half of [`bake`]: collision shapes, and the fill.
pub fn fill_container(
    scene: &Scene,
    params: &Params,
    cache: &mut dyn FillCache,
    observer: &mut dyn Observer,
) -> Result<FullContainer, Error> {
    let checked = check::run(scene, params).map_err(Error::Invalid)?;
    fill_checked(scene, params, checked, cache, observer)
}

/// As [`fill_container`], of a scene that was checked with these parameters.
pub fn fill_checked(
    scene: &Scene,
    params: &Params,
    mut checked: CheckedScene,
    cache: &mut dyn FillCache,
    observer: &mut dyn Observer,
) -> Result<FullContainer, Error> {
    // The container has them from here on.
    let surroundings = checked.surroundings.take();
    let of_piles: Vec<_> = checked.piles.iter_mut().map(|pile| pile.surroundings.take()).collect();
    let mut clock = Clock::new(observer);

    let inputs = FillInputs::new(scene, params, &checked, observer.wants_frames());
    let cached = if cache.keeps() { cache.get(&inputs) } else { None };
    let is_cached = cached.is_some();
    let shapes = match &cached {
        Some(cached) => cached.shapes.clone(),
        None => shape::run(scene, params, &checked.sizes, observer)?,
    };
    let resolved = Resolved::new(scene, params, &checked, &summaries(&shapes));
    let units = Units::new(checked.diameter, median_mass(scene, &shapes, &checked.shares), params.gravity);
    let units = units.about(scene.middle());
    let container = containers::of(scene, params, &checked, surroundings, &resolved, &units);
    let kept = Kept::new(scene, params, &checked, &resolved, &shapes, units, container.as_ref());
    let target = checked.target().filter(|_| container.is_none());
    let region = checked.region.as_ref().or(target).map(|closed| grid(&closed.mesh, &units).1);
    clock.lap(Stage::Shape, observer);

    let found = match cached {
        Some(cached) => {
            cached.show(observer);
            cached
        }
        None => {
            let mut keeper = FrameKeeper::new(observer, cache.keeps());
            let mut filled = None;
            if let Some(container) = &container {
                filled = Some(match checked.piles.is_empty() {
                    true => {
                        let task = FillTask::new(scene, &shapes, params, units, container, kept.as_ref());
                        fill::run(task, &[], &mut keeper)?
                    }
                    false => {
                        let piles = checked.piles.iter().zip(of_piles);
                        let kept = kept.as_ref();
                        let (shapes, resolved) = (&shapes, &resolved);
                        let common = CommonFill { scene, shapes, params, resolved, units, kept };
                        containers::fill_all(&common, piles, &mut keeper)?
                    }
                });
                let first = kept.iter().flat_map(|kept| &kept.instances).copied();
                filled.iter_mut().for_each(|filled: &mut Filled| drop(filled.bodies.splice(0..0, first.clone())));
                clock.lap(Stage::Fill, &mut keeper);
            }
            let found = CachedFill { shapes, filled, shown: keeper.into_shown() };
            let is_whole = found.shown.is_some() || !observer.wants_frames();
            if cache.keeps() && is_whole {
                cache.put(&inputs, &found);
            }
            found
        }
    };
    clock.skip(observer);
    let filled = container.zip(found.filled);
    Ok(FullContainer { checked, shapes: found.shapes, units, filled, kept, region, is_cached, clock })
}

/// A pile at rest, or at its last frame: all of a bake but its figures.
pub struct Released<'a> {
    scene: &'a Scene,
    params: &'a Params,
    full: &'a FullContainer,
    resolved: Resolved,
    plan: Plan,
    sim: Simulation<'a>,
    glued: Option<Glued>,
    held: HoldOutcome,
    removed: Vec<RemovedBody>,
    /// What became of an earlier pile.
    outcome: Option<Outcome>,
    collapsed: Option<collapse::Collapse>,
    separation: Option<Separation>,
    /// With every frame that was kept.
    pile: BakedPile,
    /// How its bodies come in, and the pile with the frames that show it.
    entrance: Option<(Entrance, BakedPile)>,
    clock: Clock,
}

/// The second half of [`bake`]: turn over, glue, release, hold. `params` may differ from the fill's in later stages.
pub fn release_pile<'a>(
    scene: &'a Scene,
    params: &'a Params,
    full: &'a FullContainer,
    observer: &mut dyn Observer,
) -> Result<Released<'a>, Error> {
    let resolved = full.resolved(scene, params);
    let plan = plan::of(scene, params, &full.checked, &resolved);
    let mut clock = full.clock.clone();
    clock.skip(observer);

    let mut sim = full.turn_over_as(scene, params, &resolved)?;
    sim.hides_frames = resolved.is_on(EffectName::Entrance);
    if full.kept.is_some() {
        // Which bodies stay where they were is known in the end.
        sim.show_late();
    }
    let glued = match resolved.is_on(EffectName::Glue) {
        true => {
            // The fill is inside the container: only a region of its own matters.
            let region = full.region.as_ref().filter(|_| resolved.is_on(EffectName::Region));
            let mut own = params.clone();
            if full.checked.rides {
                // What is glued to scenery that moves would stay behind.
                own.glue.anchor = Switch::Off;
            }
            let known = full.kept.as_ref().zip(scene.earlier.as_ref());
            let known = known.map_or_else(KnownGlue::default, |(kept, earlier)| keep::glue(kept, earlier, &sim.pile));
            Some(glue::run(&mut sim, region, &known, &own, &resolved, full.checked.ground, observer)?)
        }
        false => None,
    };
    clock.lap(Stage::Glue, observer);

    let order = if resolved.is_on(EffectName::StagedRelease) { params.release.order } else { ReleaseOrder::AtOnce };
    let stands = resolved.is_on(EffectName::Stand);
    let container = full.filled.as_ref().map(|(container, _)| container);
    let support = |place| container.map_or(0.0, |container| container.support(place));
    release::run(&mut sim, params, order, stands, &support, observer)?;
    clock.lap(Stage::Release, observer);
    if full.settles_first(params) {
        hold::settle(&mut sim, params, stands, observer)?;
        sim.begin(observer)?;
    }

    let held = hold::run(&mut sim, params, stands, observer)?;
    let ground = params.ground.then_some(full.checked.ground);
    let (held, removed) = taking_apart::run(&mut sim, &scene.removals, params, ground, held, observer)?;
    let (held, collapsed) = collapse::run(&mut sim, scene.collapse.as_ref(), params, held, observer)?;
    let outcome = full.kept.as_ref().zip(scene.earlier.as_ref());
    let outcome = outcome.map(|(kept, earlier)| keep::deliver(kept, earlier, &mut sim.pile));
    let stays: BTreeSet<usize> = outcome.iter().filter(|outcome| !outcome.from_first).flat_map(Outcome::ids).collect();
    let separation = resolved.is_on(EffectName::Separation);
    let separation = separation.then(|| separate::run(&mut sim.pile, &stays, held.at_rest, params, ground, observer));
    hold::finish(&mut sim, params, observer);
    clock.lap(Stage::Hold, observer);

    let pile = baked_pile(scene, params, full, &sim, outcome.as_ref(), glued.is_some())?;
    outcome.iter().for_each(|outcome| observer.numbers(&outcome.numbers));
    sim.publish(&pile.frames, observer);
    let entrance = match sim.hides_frames {
        true => Some(entered(&sim, params, &pile, observer)?),
        false => None,
    };
    clock.lap(Stage::Hold, observer);
    Ok(Released {
        scene,
        params,
        full,
        resolved,
        plan,
        sim,
        glued,
        held,
        removed,
        outcome,
        collapsed,
        separation,
        pile,
        entrance,
        clock,
    })
}

/// How the bodies of a finished pile come in, and the pile with the frames that show it.
fn entered(
    sim: &Simulation,
    params: &Params,
    pile: &BakedPile,
    observer: &mut dyn Observer,
) -> Result<(Entrance, BakedPile), Error> {
    let entrance = entrance::run(&sim.pile, params, observer)?;
    let end = pile.last_frame();
    let frames = entrance.frames(&sim.pile, &end.frames[0]);
    let appear = entrance.first_frames(end.bodies.len());
    entrance::show(&sim.pile, &frames, &appear, params.output.fps, observer);
    let bodies = end.bodies.iter().zip(appear).map(|(body, first_frame)| BakedBody { first_frame, ..*body }).collect();
    Ok((entrance, BakedPile { bodies, frames, ..end }))
}

/// The frames of a pile, and its glue where `is_glued`.
fn baked_pile(
    scene: &Scene,
    params: &Params,
    full: &FullContainer,
    sim: &Simulation,
    outcome: Option<&Outcome>,
    is_glued: bool,
) -> Result<BakedPile, Error> {
    let (mut bodies, mut frames) = prop_frames(&sim.pile);
    outcome.iter().for_each(|outcome| outcome.apply(&mut bodies, &mut frames));
    if bodies.is_empty() {
        let text = "no body of `bodies` or `emitters` appears before the last frame; bake more frames";
        return Err(Error::Invalid(vec![SceneProblem::new("output.frames", text)]));
    }
    let (fps, recorder) = (params.output.fps, &sim.pile.recorder);
    let count = if recorder.keeps() { frames.len() } else { recorder.count() + 1 };
    let scenery = scenery_frames(scene, fps, count);
    let glue = is_glued.then(|| report::baked_glue(sim));
    let bounces = params.physics.switches.restitution.is_on(true);
    let solid = |(shape, prop): (&Shape, &Prop)| {
        BakedSolid::new(shape, prop.friction, if bounces { prop.restitution } else { 0.0 })
    };
    let solids = full.shapes.iter().zip(&scene.props).map(solid).collect();
    let world = BakedWorld {
        gravity: params.gravity,
        ground: params.ground.then_some(full.checked.ground),
        ground_friction: params.ground_friction,
        diameter: full.checked.diameter,
    };
    let filled = sim.pile.places.len().min(bodies.len());
    Ok(BakedPile { fps, bodies, filled, frames, scenery, glue, solids, world })
}

impl Released<'_> {
    /// Every frame, or the last one alone, as the parameters ask for.
    pub fn pile(&self) -> Cow<'_, BakedPile> {
        match self.sim.pile.recorder.keeps() {
            true => Cow::Borrowed(self.entrance.as_ref().map_or(&self.pile, |(_, pile)| pile)),
            false => Cow::Owned(self.pile.last_frame()),
        }
    }

    /// The bake, with its figures.
    pub fn measured(mut self, observer: &mut dyn Observer) -> Result<Bake, Error> {
        let full = self.full;
        let mut clock = self.clock;
        clock.skip(observer);
        let inputs = ReportInputs {
            scene: self.scene,
            params: self.params,
            plan: &self.plan,
            resolved: &self.resolved,
            shapes: &full.shapes,
            target: full.checked.target().map(|target| &target.mesh),
            filled: full.filled.as_ref(),
            core: full.checked.core.as_ref(),
            held: self.held,
            separation: self.separation,
            outcome: self.outcome.as_ref(),
            glued: self.glued.as_ref(),
            pile: &self.pile,
            entrance: self.entrance.as_ref().map(|(entrance, _)| entrance),
            ground: full.checked.ground,
        };
        let sim = &mut self.sim;
        let measured = make::measure(&inputs, sim, observer)?;
        let alone = physics_alone(&inputs, sim, observer)?;
        let mut report = make::report(&inputs, sim, measured, alone, clock, observer);
        (report.removals, report.collapse) = (self.removed, self.collapsed);
        if full.is_cached {
            report.recall_fill();
        }
        let pile = match self.entrance {
            Some((_, entered)) => entered,
            None if self.sim.pile.recorder.keeps() => self.pile,
            None => self.pile.last_frame(),
        };
        Ok(Bake { pile, report })
    }
}

/// Lets physics alone move the finished pile, and pours its props, where the report has figures of that.
fn physics_alone(
    inputs: &ReportInputs,
    sim: &mut Simulation,
    observer: &mut dyn Observer,
) -> Result<PhysicsAlone, Error> {
    let mut alone = PhysicsAlone::default();
    if inputs.resolved.is_on(EffectName::FreeStanding) {
        let begin = observer.cpu_seconds();
        let freed = free_standing::run(&mut sim.pile, observer)?;
        alone = PhysicsAlone { figures: freed.figures, steps: freed.steps, seconds: observer.cpu_seconds() - begin };
    }
    if inputs.resolved.is_on(EffectName::FreePour) {
        let fraction = free_pour::of_props(&inputs.scene.props, inputs.shapes, inputs.params, observer)?;
        alone.figures.insert("free_pour_fraction", fraction);
    }
    Ok(alone)
}

fn summaries(shapes: &[Shape]) -> Vec<ShapeSummary> {
    shapes.iter().map(Shape::summary).collect()
}

/// Poses of the moving scenery. Shape `[static][frame]`, empty for a static one that stands still.
fn scenery_frames(scene: &Scene, fps: f64, frames: usize) -> Vec<Vec<Pose>> {
    let poses = |model: &StaticModel| {
        let count = if model.keys.is_empty() { 0 } else { frames };
        (0..count).map(|frame| model.pose_at(frame as f64 / fps)).collect()
    };
    scene.statics.iter().map(poses).collect()
}

/// The mass of the prop in the middle, among those that the pile is made of, kg: the engine's unit.
fn median_mass(scene: &Scene, shapes: &[Shape], shares: &[f64]) -> f64 {
    let middle = |[lo, hi]: [f64; 2]| ((lo + hi) / 2.0).powi(3);
    let used = scene.props.iter().zip(shapes).zip(shares).filter(|(_, share)| **share > 0.0);
    let mut masses: Vec<f64> = used.map(|((p, s), _)| s.mass * middle(p.scale)).collect();
    masses.sort_by(f64::total_cmp);
    masses[masses.len() / 2]
}
