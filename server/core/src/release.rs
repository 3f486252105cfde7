//! Turning over and release: gravity points down again, and the bodies are let go from the bottom to the top while the
//! control strengthens the pile (paper, 4.1, example 2).

use crate::Error;
use crate::control::Control;
use crate::fill::Placed;
use crate::observer::{Frame, Observer, Progress, Shown, Stage, observe};
use crate::params::{Output, Params};
use crate::pose::Pose;
use crate::record::Recorder;
use crate::scene::Scene;
use crate::shape::Shape;
use crate::world::{BodyId, Insertion, Role, Units, World};

/// A pile being released: the world, its control and the frames so far.
pub struct Pile<'a> {
    pub world: World,
    pub control: Control<'a>,
    pub recorder: Recorder,
    /// Steps since turning over.
    pub step: u64,
    /// Largest speed of any body in the latest step, d per natural time.
    pub top_speed: f64,
    /// Awake bodies, summed over the steps.
    pub active_body_steps: u64,
    /// Frames recorded when the hold began.
    pub hold_frame: usize,
    /// CPU seconds in the control, and in the engine's steps.
    pub control_seconds: f64,
    pub step_seconds: f64,
    /// Bodies set aside because their state became non-finite.
    pub lost: Vec<BodyId>,
    damping: f64,
    shapes: &'a [Shape],
    bodies: &'a [Placed],
    output: &'a Output,
    /// Frames shown.
    shown: usize,
}

/// The pile right after turning over: every body waits in place on the ground or in the air.
pub fn turn_over<'a>(
    scene: &Scene,
    shapes: &'a [Shape],
    params: &'a Params,
    units: Units,
    bodies: &'a [Placed],
    ground: f64,
    control: Control<'a>,
) -> Result<Pile<'a>, Error> {
    let thickness = bodies.iter().map(|b| shapes[b.prop].thickness() * b.scale).fold(f64::INFINITY, f64::min);
    let compounds = shapes.iter().any(|s| s.solid.parts() > 1);
    let mut world = World::new(units, &params.physics, thickness / units.length, compounds);
    world.add_ground(ground / units.length, params.ground_friction);
    for model in &scene.statics {
        world.add_scenery(&model.model.mesh, model.friction).map_err(Error::Internal)?;
    }
    for body in bodies {
        let prop = &scene.props[body.prop];
        let (friction, restitution) = (prop.friction, prop.restitution);
        let insertion = Insertion { prop: body.prop, scale: body.scale, pose: body.pose, friction, restitution };
        let id = world.insert(&shapes[body.prop], &insertion).map_err(Error::Internal)?;
        world.set_role(id, Role::Waiting);
    }
    world.refresh();
    let recorder = Recorder::new(&world, 1.0 / params.output.fps / units.time);
    Ok(Pile {
        world,
        control,
        recorder,
        step: 0,
        top_speed: 0.0,
        active_body_steps: 0,
        hold_frame: 0,
        control_seconds: 0.0,
        step_seconds: 0.0,
        lost: Vec::new(),
        damping: params.release.damping,
        shapes,
        bodies,
        output: &params.output,
        shown: 0,
    })
}

/// Lets the layers go, the lowest first.
pub fn run(pile: &mut Pile, params: &Params, observer: &mut dyn Observer) -> Result<(), Error> {
    let interval =
        (pile.world.units.duration(params.release.interval) / pile.world.step_length()).round().max(1.0) as u64;
    let layers = layers(&pile.world, params.release.layer);
    let total = layers.len() as u64 * interval;
    pile.show(observer, Stage::Release);
    for layer in layers {
        for id in layer {
            pile.control.release(id);
            pile.world.set_role(id, Role::Free);
            pile.world.set_damping(id, pile.damping);
        }
        for _ in 0..interval {
            pile.advance(observer, Stage::Release, |pile| pile.step as f64 / total as f64)?;
        }
    }
    pile.hold_frame = pile.recorder.count();
    Ok(())
}

/// Bodies by the height of their centre of mass, in slices of `thickness` from the lowest on; empty slices are left out.
fn layers(world: &World, thickness: f64) -> Vec<Vec<BodyId>> {
    let height = |id: BodyId| world.pose(id).translation.y;
    let lowest = world.present().map(height).fold(f64::INFINITY, f64::min);
    let mut slices = std::collections::BTreeMap::<u64, Vec<BodyId>>::new();
    for id in world.present() {
        slices.entry(((height(id) - lowest) / thickness) as u64).or_default().push(id);
    }
    slices.into_values().collect()
}

impl Pile<'_> {
    /// A recorded frame in SI, from the props' own frames. Shape `[body]`.
    pub fn prop_frame(&self, number: usize) -> impl Iterator<Item = Pose> {
        let units = self.world.units;
        let frame = self.recorder.frames[number].iter().zip(self.bodies);
        frame.map(move |(pose, b)| self.shapes[b.prop].prop_pose(&units.pose_to_si(pose), b.scale))
    }

    /// Shows the frames that were recorded since, except those that the result will not have.
    pub fn show(&mut self, observer: &mut dyn Observer, stage: Stage) {
        if !observer.wants_frames() {
            return;
        }
        let last = self.output.frames.map_or(usize::MAX, |n| n as usize);
        while self.shown < self.recorder.frames.len() && self.shown <= last {
            let number = self.shown;
            let shown = |(pose, b): (Pose, &Placed)| Some(Shown { prop: b.prop, scale: b.scale, pose });
            let bodies: Vec<Option<Shown>> = self.prop_frame(number).zip(self.bodies).map(shown).collect();
            let time = number as f64 / self.output.fps;
            observer.frame(&Frame { stage, number, time, bodies: &bodies });
            self.shown += 1;
        }
    }

    /// Lets what still rolls or rattles come to rest, anywhere: every released body is damped by this much, and the
    /// control goes on to choose for those that it judges.
    pub fn quieten(&mut self, damping: f64) {
        self.control.quieten(damping);
        for id in self.world.present().collect::<Vec<_>>() {
            if self.world.bodies()[id].role == Role::Free {
                self.world.set_damping(id, damping.max(self.damping));
            }
        }
    }

    /// One step of world and control.
    pub fn advance(
        &mut self,
        observer: &mut dyn Observer,
        stage: Stage,
        fraction: impl Fn(&Pile) -> f64,
    ) -> Result<(), Error> {
        let begin = observer.cpu_seconds();
        if self.control.is_due(self.step) {
            self.control.cycle(&mut self.world);
        }
        let controlled = observer.cpu_seconds();
        self.lost.extend(self.world.step());
        let stepped = observer.cpu_seconds();
        self.control.after_step(&mut self.world);
        self.control_seconds += controlled - begin + (observer.cpu_seconds() - stepped);
        self.step_seconds += stepped - controlled;
        self.step += 1;
        self.recorder.step(&self.world);
        self.show(observer, stage);
        self.top_speed = self.world.present().map(|id| self.world.speed(id)).fold(0.0, f64::max);
        self.active_body_steps += self.world.present().filter(|&id| self.world.is_awake(id)).count() as u64;
        let bodies = self.world.present().count();
        let released = bodies - self.world.count(Role::Waiting);
        let at_rest = self.world.present().filter(|&id| self.world.speed(id) < crate::hold::REST_SPEED).count();
        let nails = self.world.nail_count();
        let fraction = fraction(self).clamp(0.0, 1.0);
        observe(observer, &Progress { stage, fraction, bodies, released, at_rest, nails })
    }
}
