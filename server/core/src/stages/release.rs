//! Turning over and release: gravity points down again, and the bodies are let go from the bottom to the top while the
//! control strengthens the pile (paper, 4.1, example 2).

use crate::error::Error;
use crate::geometry::pose::Pose;
use crate::input::observer::{Frame, Observer, Progress, Shown, Stage, State, observe};
use crate::input::params::{Output, Params, ReleaseOrder};
use crate::input::scene::{Given, Scene};
use crate::prepare::extremes;
use crate::prepare::shape::Shape;
use crate::sim::control::Control;
use crate::sim::events::Events;
use crate::sim::guard::Guard;
use crate::sim::record::{Pace, Recorder};
use crate::stages::fill::Placed;
use crate::world::{BodyId, Insertion, Role, Units, World};

/// What effects of release and hold have done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    pub layers: u64,
    pub bouncing_bodies: u64,
    pub bodies_emitted: u64,
    /// Steps in which everything was damped because the control ended gently.
    pub stand_steps: u64,
    /// Steps of the further simulation that tells what stands by itself.
    pub free_standing_steps: u64,
    /// The masses stiffen the contacts.
    pub is_stiff: bool,
}

/// A pile being released: the world, its control and the frames so far.
pub struct Pile<'a> {
    pub world: World,
    pub work: Work,
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
    /// Frames recorded when the hold was first disturbed: by a body thrown in, or by the end of the control.
    pub disturbed_frame: Option<usize>,
    /// Step of the latest release, drop, move or end of the control.
    pub latest_event: u64,
    /// Sentences for a person: what could not be done.
    pub notes: Vec<String>,
    /// In the order of insertion.
    pub bodies: Vec<Placed>,
    /// Per body: the first frame that has it.
    pub first_frames: Vec<usize>,
    /// CPU seconds in the control, and in the engine's steps.
    pub control_seconds: f64,
    pub step_seconds: f64,
    /// ... in frames, and in telling what stands by itself.
    pub frame_seconds: f64,
    pub standing_seconds: f64,
    /// Bodies set aside.
    pub lost: Vec<BodyId>,
    pub guard: Guard,
    /// Where there is no ground: bodies whose centre of mass is below this, engine units, are set aside; and how many
    /// were.
    depth: Option<f64>,
    pub fallen: usize,
    damping: f64,
    /// The step in which a gentle end of the control began.
    standing: Option<u64>,
    events: Option<Events<'a>>,
    scene: &'a Scene,
    pub shapes: &'a [Shape],
    bounces: bool,
    output: &'a Output,
    /// Frames shown.
    shown: usize,
}

/// The pile right after turning over: every body waits in place on the ground or in the air.
pub fn turn_over<'a>(
    scene: &'a Scene,
    shapes: &'a [Shape],
    params: &'a Params,
    units: Units,
    bodies: &[Placed],
    ground: f64,
    control: Control<'a>,
) -> Result<Pile<'a>, Error> {
    let filled = bodies.iter().map(|b| (b.prop, b.scale));
    let given = scene.bodies.iter().map(|b| (b.prop, b.scale));
    let emitted = scene.emitters.iter().flat_map(|e| scene.emitted(e)).map(|i| (i, scene.props[i].scale[0]));
    let thickness = filled.chain(given).chain(emitted).map(|(prop, scale)| shapes[prop].thickness() * scale);
    let thickness = thickness.fold(f64::INFINITY, f64::min);
    let compounds = shapes.iter().any(|s| s.solid.parts() > 1);
    let mass_ratio = extremes::mass_ratio(scene, params, |prop| shapes[prop].mass);
    let physics = extremes::stiffened(&params.physics, mass_ratio, thickness / units.length, units.time);
    let mut world = World::new(units, &physics, thickness / units.length, compounds);
    if params.ground {
        world.add_ground(ground / units.length, params.ground_friction);
    }
    let depth = (!params.ground).then(|| scene.lowest().min(ground) / units.length - FALL_DEPTH);
    for model in scene.statics.iter().filter(|model| model.keys.is_empty()) {
        world.add_scenery(&model.model.mesh, model.friction).map_err(Error::Internal)?;
    }
    let frames = Pace::new(params, units);
    let recorder = Recorder::new(&world, frames);
    let mut pile = Pile {
        world,
        work: Work { is_stiff: physics != params.physics, ..Work::default() },
        control,
        recorder,
        disturbed_frame: None,
        latest_event: 0,
        notes: Vec::new(),
        bodies: Vec::new(),
        first_frames: Vec::new(),
        standing: None,
        events: None,
        scene,
        step: 0,
        top_speed: 0.0,
        active_body_steps: 0,
        hold_frame: 0,
        control_seconds: 0.0,
        step_seconds: 0.0,
        frame_seconds: 0.0,
        standing_seconds: 0.0,
        lost: Vec::new(),
        guard: Guard::new(
            scene,
            params,
            units,
            depth.map_or(ground / units.length, |depth| depth - FALL_DEPTH),
            mass_ratio,
        ),
        depth,
        fallen: 0,
        damping: params.release.damping,
        shapes,
        bounces: scene.bounces(params),
        output: &params.output,
        shown: 0,
    };
    for &body in bodies {
        let id = pile.insert(body)?;
        pile.world.set_role(id, Role::Waiting);
    }
    for given in scene.bodies.iter().filter(|given| given.is_stacked()) {
        let id = pile.place(given)?;
        pile.world.set_role(id, if given.kept { Role::Kept } else { Role::Waiting });
        pile.control.place(id);
    }
    pile.world.refresh();
    pile.events = Events::new(&mut pile, params)?;
    pile.recorder = Recorder::new(&pile.world, frames);
    pile.first_frames.fill(0);
    Ok(pile)
}

/// What has fallen this far below all of the scene, in d, meets nothing any more.
const FALL_DEPTH: f64 = 50.0;

/// Lets the layers go, one after the other.
pub fn run(pile: &mut Pile, params: &Params, observer: &mut dyn Observer) -> Result<(), Error> {
    let interval =
        (pile.world.units.duration(params.release.interval) / pile.world.step_length()).round().max(1.0) as u64;
    let layers = layers(&pile.world, params.release.layer, params.release.order);
    let total = layers.len() as u64 * interval;
    pile.show(observer, Stage::Release);
    for layer in layers {
        pile.work.layers += 1;
        layer.into_iter().for_each(|id| pile.let_go(id));
        for _ in 0..interval {
            pile.advance(observer, Stage::Release, |pile| pile.step as f64 / total as f64)?;
        }
    }
    pile.hold_frame = pile.recorder.mark();
    Ok(())
}

/// Waiting bodies by the height of their centre of mass, in slices of `thickness` from the lowest on; empty slices are left
/// out.
fn layers(world: &World, thickness: f64, order: ReleaseOrder) -> Vec<Vec<BodyId>> {
    let height = |id: BodyId| world.pose(id).translation.y;
    let waiting = || world.present().filter(|&id| world.bodies()[id].role == Role::Waiting);
    let lowest = waiting().map(height).fold(f64::INFINITY, f64::min);
    let mut slices = std::collections::BTreeMap::<u64, Vec<BodyId>>::new();
    for id in waiting() {
        slices.entry(((height(id) - lowest) / thickness) as u64).or_default().push(id);
    }
    let slices = slices.into_values();
    match order {
        ReleaseOrder::BottomUp => slices.collect(),
        ReleaseOrder::TopDown => slices.rev().collect(),
        ReleaseOrder::AtOnce => slices.reduce(|all, slice| [all, slice].concat()).into_iter().collect(),
    }
}

/// Damping while the control ends gently, per natural time: 50/s for a prop of 1 m, at which a pile creeps into its rest ...
const STAND_DAMPING: f64 = 16.0;
/// ... for this long, natural times, ...
const STAND_TIME: f64 = 9.5;
/// ... and then ever less, over this.
const STAND_RAMP: f64 = 3.2;

impl<'a> Pile<'a> {
    /// A recorded frame in SI, from the props' own frames. Shape `[body]`.
    pub fn prop_frame(&self, number: usize) -> impl Iterator<Item = Pose> {
        let units = self.world.units;
        let frame = self.recorder.frames[number].iter().zip(&self.bodies);
        frame.map(move |(pose, b)| self.shapes[b.prop].prop_pose(&units.pose_to_si(pose), b.scale))
    }

    /// Shows the frames that were recorded since, except those that the result will not have.
    pub fn show(&mut self, observer: &mut dyn Observer, stage: Stage) {
        if !observer.wants_frames() || !self.recorder.keeps() {
            return;
        }
        let last = self.output.frames.map_or(usize::MAX, |n| n as usize);
        let count = self.recorder.frames.len();
        if self.shown >= count {
            return;
        }
        let states = self.control.states(&self.world);
        while self.shown < count && self.shown <= last {
            let number = self.shown;
            let shown = |((pose, b), &state): ((Pose, &Placed), &State)| {
                Some(Shown { prop: b.prop, scale: b.scale, pose, state })
            };
            let poses = self.prop_frame(number).zip(&self.bodies);
            let bodies: Vec<Option<Shown>> = poses.zip(&states).map(shown).collect();
            let time = number as f64 / self.output.fps;
            observer.frame(&Frame { stage, number, time, bodies: &bodies });
            self.shown += 1;
        }
    }

    /// Adds a free body.
    pub fn insert(&mut self, body: Placed) -> Result<BodyId, Error> {
        let prop = &self.scene.props[body.prop];
        let (friction, restitution) = (prop.friction, if self.bounces { prop.restitution } else { 0.0 });
        self.work.bouncing_bodies += u64::from(restitution > 0.0);
        let insertion = Insertion { prop: body.prop, scale: body.scale, pose: body.pose, friction, restitution };
        let id = self.world.insert(&self.shapes[body.prop], &insertion).map_err(Error::Internal)?;
        self.world.set_damping(id, self.damping);
        self.bodies.push(body);
        self.first_frames.push(self.recorder.next());
        Ok(id)
    }

    /// Adds a body placed by hand, free and at rest.
    pub fn place(&mut self, given: &Given) -> Result<BodyId, Error> {
        let shape = &self.shapes[given.prop];
        let pose = self.world.units.pose_to_engine(&shape.body_pose(&given.pose, given.scale));
        let id = self.insert(Placed { prop: given.prop, scale: given.scale, pose })?;
        if let Some(kg) = given.mass {
            self.world.set_mass(id, shape, kg);
        }
        Ok(id)
    }

    pub fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// A kept body is let go.
    pub fn let_go(&mut self, id: BodyId) {
        self.control.release(id);
        self.world.set_role(id, Role::Free);
        self.world.set_damping(id, self.damping);
    }

    /// Something moves the pile from outside: rest is waited for anew.
    pub fn disturb(&mut self) {
        self.latest_event = self.step;
        if self.hold_frame > 0 {
            self.disturbed_frame.get_or_insert_with(|| self.recorder.mark());
        }
    }

    /// The control ends. Gently: everything is damped for a while.
    pub fn end_control(&mut self, gently: bool) {
        self.disturb();
        self.control.end(&mut self.world);
        self.standing = gently.then_some(self.step);
        self.unquieten();
    }

    /// Whether nothing is to happen any more by itself.
    pub fn is_left_alone(&self) -> bool {
        self.standing.is_none() && self.events.as_ref().is_none_or(Events::are_over)
    }

    /// Damps everything as long as the control's gentle end lasts.
    fn stand(&mut self) {
        let Some(begin) = self.standing else { return };
        self.work.stand_steps += 1;
        let time = (self.step - begin) as f64 * self.world.step_length();
        let share = ((STAND_TIME + STAND_RAMP - time) / STAND_RAMP).clamp(0.0, 1.0);
        self.set_all_damping((STAND_DAMPING * share).max(self.damping));
        self.latest_event = self.step;
        if share == 0.0 {
            self.standing = None;
        }
    }

    fn set_all_damping(&mut self, damping: f64) {
        for id in self.world.present().collect::<Vec<_>>() {
            if self.world.bodies()[id].role == Role::Free {
                self.world.set_damping(id, damping);
            }
        }
    }

    /// Ends [`Pile::quieten`].
    pub fn unquieten(&mut self) {
        self.control.unquieten();
        self.set_all_damping(self.damping);
    }

    /// Lets what still rolls or rattles come to rest, anywhere: every released body is damped by this much, and the
    /// control goes on to choose for those that it judges.
    pub fn quieten(&mut self, damping: f64) {
        self.control.quieten(damping);
        self.set_all_damping(damping.max(self.damping));
    }

    fn set_fallen_aside(&mut self) {
        let Some(depth) = self.depth else { return };
        for id in self.world.present().collect::<Vec<_>>() {
            if self.world.pose(id).translation.y < depth {
                self.world.remove(id);
                self.fallen += 1;
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
        if let Some(mut events) = self.events.take() {
            events.before_step(self)?;
            self.events = Some(events);
        }
        self.stand();
        let begin = observer.cpu_seconds();
        self.control.before_step(&mut self.world);
        if self.control.is_due(self.step) {
            self.control.cycle(&mut self.world);
        }
        let controlled = observer.cpu_seconds();
        self.lost.extend(self.guard.step(&mut self.world)?);
        self.set_fallen_aside();
        let stepped = observer.cpu_seconds();
        self.control.after_step(&mut self.world);
        let after = observer.cpu_seconds();
        self.control_seconds += controlled - begin + (after - stepped);
        self.step_seconds += stepped - controlled;
        self.step += 1;
        self.recorder.step(&self.world);
        self.show(observer, stage);
        self.frame_seconds += observer.cpu_seconds() - after;
        self.top_speed = self.world.present().map(|id| self.world.speed(id)).fold(0.0, f64::max);
        self.active_body_steps += self.world.present().filter(|&id| self.world.is_awake(id)).count() as u64;
        let bodies = self.world.present().count();
        let released = bodies - self.world.count(Role::Waiting);
        let at_rest = self.world.present().filter(|&id| self.world.speed(id) < crate::stages::hold::REST_SPEED).count();
        let nails = self.world.nail_count();
        let fraction = fraction(self).clamp(0.0, 1.0);
        observe(observer, &Progress { stage, fraction, bodies, released, at_rest, nails })
    }
}
