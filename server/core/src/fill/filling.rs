//! The task of a fill, its state, and the operations that all methods share.

mod clean_up;
mod progress;

use super::Removed;
use super::world::FillWorld;
use crate::keep::Kept;
use cairn_engine::shape::{Shape, Size};
use cairn_engine::world::{BodyId, Units, World};
use cairn_input::error::Error;
use cairn_input::observer::Observer;
use cairn_input::params::{FillMethod, Params};
use cairn_input::scene::Scene;
use cairn_motion::instance::{self, Instance};
use cairn_prepare::container::{Container, FAR};
use cairn_prepare::packing::{Room, expected_bodies};
use glam::{DQuat, DVec3};
use progress::FillProgress;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

/// The task of a fill: it does not change while the fill runs.
#[derive(Clone, Copy)]
pub struct FillTask<'a> {
    pub scene: &'a Scene,
    /// Shape `[prop]`.
    pub shapes: &'a [Shape],
    pub params: &'a Params,
    pub units: Units,
    pub container: &'a Container,
    /// Bodies that the fill is expected to add.
    pub expected: usize,
    /// What stays of an earlier pile.
    pub kept: Option<&'a Kept>,
    /// Number of these bodies in the container.
    pub kept_inside: usize,
}

impl<'a> FillTask<'a> {
    pub fn new(
        scene: &'a Scene,
        shapes: &'a [Shape],
        params: &'a Params,
        units: Units,
        container: &'a Container,
        kept: Option<&'a Kept>,
    ) -> FillTask<'a> {
        let sizes: Vec<Size> = shapes.iter().map(|s| s.size).collect();
        let room =
            Room { volume: container.volume * units.length.powi(3), area: container.area * units.length.powi(2) };
        let expected = expected_bodies(scene, &sizes, &room, &params.fill, 1.0);
        let kept_inside = kept.map_or(0, |kept| kept.inside(container));
        let expected = kept.map_or(expected, |kept| kept.expected(container, expected));
        FillTask { scene, shapes, params, units, container, expected, kept, kept_inside }
    }

    /// How props get in. What is poured gets nowhere past the bodies of an earlier pile.
    pub fn method(&self) -> FillMethod {
        match self.params.fill.method {
            FillMethod::Pour if self.kept_inside > 0 => FillMethod::Insert,
            method => method,
        }
    }

    /// Loose bodies that the pile may have.
    pub fn wanted(&self) -> usize {
        let fill = &self.params.fill;
        (fill.count.unwrap_or(u32::MAX).min(fill.max_bodies) as usize).saturating_sub(self.kept_inside)
    }

    /// The props that are drawn at all.
    pub fn drawn_props(&self) -> impl Iterator<Item = usize> + Clone + 'a {
        let props = &self.scene.props;
        (0..props.len()).filter(|&i| props[i].weight > 0.0)
    }

    /// Smallest extent of any prop that is drawn, at its smallest scale; engine units.
    pub fn least_thickness(&self) -> f64 {
        let thickness = self.drawn_props().map(|i| self.shapes[i].thickness() * self.scene.props[i].scale[0]);
        thickness.fold(f64::INFINITY, f64::min) / self.units.length
    }

    /// Height of the container, engine units.
    pub fn height(&self) -> f64 {
        self.container.high.y - self.container.base
    }

    /// Nodes of the container's distance grid that are inside, where the fill may add bodies.
    pub fn inside(&self) -> Vec<DVec3> {
        let grid = &self.container.distance;
        let (origin, size, values) = grid.nodes();
        let place =
            |i: usize| DVec3::new((i % size[0]) as f64, (i / size[0] % size[1]) as f64, (i / size[0] / size[1]) as f64);
        let inside = values.iter().enumerate().filter(|(_, distance)| **distance <= 0.0);
        let inside = inside.map(|(i, _)| origin + grid.spacing() * place(i));
        inside.filter(|&p| self.kept.is_none_or(|kept| kept.is_open(p))).collect()
    }
}

/// A fill under way.
pub struct Filling<'a> {
    pub task: FillTask<'a>,
    pub world: FillWorld,
    pub rng: Pcg64Mcg,
    removed: Removed,
    progress: FillProgress,
    /// Bodies that grew beyond their size, each with its own scale.
    pub overgrown: Vec<(BodyId, f64)>,
    /// Strength of gravity, as a share of the scene's.
    gravity: f64,
}

/// The pile as a whole falls if its mean speed downward is more than this, d per characteristic time under full gravity
/// (closing gaps is slower), and at least this share of its largest speed so far.
const FALLING: f64 = 0.1;
const STILL_FALLING: f64 = 0.1;
/// Longest fall, in times of a fall through all of the container.
const LONGEST_FALL: f64 = 1.5;

impl<'a> Filling<'a> {
    /// An empty world, under upward gravity of this strength, as a share of the scene's. `with_frames`: for observers.
    pub fn new(task: FillTask<'a>, gravity: f64, with_frames: bool) -> Filling<'a> {
        let compounds = task.shapes.iter().any(|s| s.solid.parts() > 1);
        let physics = task.params.fill_physics(task.units.time);
        let nests = task.params.fill.method.traits().has_order;
        let world = FillWorld::new(World::new(task.units, &physics, task.least_thickness(), compounds), nests);
        let rng = Pcg64Mcg::seed_from_u64(task.params.seed);
        let (removed, progress) = (Removed::default(), FillProgress::new(with_frames));
        let mut filling = Filling { task, world, rng, removed, progress, overgrown: Vec::new(), gravity };
        // An upright container is filled as if it stood on its head.
        filling.point_gravity(DVec3::Y);
        filling
    }

    /// Bodies taken out so far, by reason.
    pub fn removed(&self) -> Removed {
        self.removed
    }

    /// Lets gravity act along `direction`, times its length.
    pub fn point_gravity(&mut self, direction: DVec3) {
        self.world.set_gravity(direction * self.gravity);
    }

    /// Pins the bodies that the scene placed, and those of other piles and of an earlier one near the container: the
    /// others are filled in around them.
    pub fn place_given(&mut self, others: &[Instance]) -> Result<(), Error> {
        for given in self.task.scene.bodies.iter().filter(|body| body.is_stacked()) {
            let pose = self.task.shapes[given.prop].body_pose(&given.pose, given.scale);
            let pose = self.task.units.pose_to_engine(&pose);
            let id = self.insert(Instance { prop: given.prop, scale: given.scale, pose })?;
            self.world.pin(id);
        }
        let (low, high) = (self.task.container.low, self.task.container.high);
        let kept = self.task.kept.map_or(&[][..], |kept| &kept.instances);
        for other in kept.iter().chain(others) {
            let reach = FAR + self.task.shapes[other.prop].radius * other.scale / self.task.units.length;
            let center = other.pose.translation;
            if center.cmpge(low - reach).all() && center.cmple(high + reach).all() {
                let id = self.insert(*other)?;
                self.world.pin(id);
            }
        }
        Ok(())
    }

    /// One of these props by weight, a scale from its range and an orientation from its own.
    pub fn draw(&mut self, props: &[usize]) -> (usize, f64, DQuat) {
        instance::draw(&self.task.scene.props, props.iter().copied(), &mut self.rng)
    }

    /// One prop, a scale and an orientation, the props by these weights.
    pub fn draw_by(&mut self, props: &[(usize, f64)]) -> (usize, f64, DQuat) {
        instance::draw_by(&self.task.scene.props, props.iter().copied(), &mut self.rng)
    }

    /// Adds a body with the friction of the fill.
    pub fn insert(&mut self, body: Instance) -> Result<BodyId, Error> {
        self.world.insert(&self.task.shapes[body.prop], body, self.task.params.fill.friction)
    }

    /// Gives the loose bodies their own friction.
    pub fn use_real_friction(&mut self) {
        for id in self.world.loose().collect::<Vec<_>>() {
            let friction = self.task.scene.props[self.world.body(id).prop].friction;
            self.world.set_friction(id, friction);
        }
    }

    /// From now on, contacts are as stiff as the pile's, if those are stiffer than the fill's.
    pub fn use_stiffer_contacts(&mut self) {
        let (params, units) = (self.task.params, self.task.units);
        if params.physics.contact_frequency > params.fill_physics(units.time).contact_frequency {
            self.world.use_contacts_of(&params.physics, self.task.least_thickness());
        }
    }

    /// Simulates for a while, characteristic times.
    pub fn settle(&mut self, time: f64, observer: &mut dyn Observer) -> Result<(), Error> {
        let steps = (time / self.world.step_length()).ceil() as usize;
        for _ in 0..steps {
            self.world.step();
            self.progress.step(&self.task, &self.world, observer)?;
        }
        Ok(())
    }

    /// Settles, after a pile that does not fill the container has fallen to its end.
    pub fn settle_from_fall(&mut self, observer: &mut dyn Observer) -> Result<(), Error> {
        let mut left = LONGEST_FALL * (2.0 * self.task.height() / self.gravity).sqrt();
        // Bodies that have just moved upward must stop.
        for id in self.world.loose().collect::<Vec<_>>() {
            self.world.stop(id);
        }
        self.settle(self.task.params.fill.settle, observer)?;
        let mut speed = self.world.falling_speed();
        if speed <= FALLING * self.gravity {
            return Ok(());
        }
        let mut top_speed = speed;
        while left > 0.0 && speed > STILL_FALLING * top_speed {
            self.settle(self.world.step_length(), observer)?;
            left -= self.world.step_length();
            speed = self.world.falling_speed();
            top_speed = top_speed.max(speed);
        }
        self.settle(self.task.params.fill.settle, observer)
    }
}
