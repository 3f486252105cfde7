//! Filling the container with props (Cho et al. 2007; paper, 4.1).

mod insert;
mod pockets;
mod pour;

use crate::error::Error;
use crate::geometry::pose::Pose;
use crate::input::observer::{Frame, Observer, Progress, Shown, Stage, State, observe};
use crate::input::params::{FillMethod, Params};
use crate::input::scene::Scene;
use crate::prepare::container::Container;
use crate::prepare::packing::{Room, expected_bodies};
use crate::prepare::shape::{Shape, Size, Solid};
use crate::sim::instance::{self, Instance};
use crate::sim::policy::Policy;
use crate::world::{BodyId, Counters, Insertion, Role, Side, Touch, Units, WallId, World, WorldBody};
use glam::{DQuat, DVec3};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;

/// A full container. Plain data: a release starts from it as often as one likes.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Filled {
    pub bodies: Vec<Instance>,
    pub removed: Removed,
    /// Without those of the depenetration.
    pub steps: u64,
    pub depenetration_steps: u64,
    /// Whether the container was full, rather than a limit reached.
    pub full: bool,
    /// Share of the container's volume that no body is near.
    pub pockets: f64,
    /// Triangles that simplification took from the walls, and how far it moved them, in d.
    pub wall_triangles_saved: usize,
    pub wall_deviation: f64,
    pub counters: Counters,
}

/// Bodies that the fill took out again, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Removed {
    pub sticking_out: usize,
    pub overlapping: usize,
    pub escaped: usize,
}

/// What a fill works with.
pub(crate) struct Filling<'a> {
    pub scene: &'a Scene,
    pub shapes: &'a [Shape],
    pub params: &'a Params,
    pub container: &'a Container,
    pub world: World,
    pub rng: Pcg64Mcg,
    pub removed: Removed,
    /// Bodies that the container is expected to take.
    pub expected: usize,
    /// Bodies simulated so far, times natural times.
    work: f64,
    /// Frames shown; `None` where none are to be.
    shown: Option<usize>,
}

/// Natural times for which the bodies of a fill are usually simulated, times the expected bodies.
const USUAL_WORK: f64 = 15.0;
/// Progress when the usual work is done; the rest is for fills that take longer.
const USUAL_END: f64 = 0.9;

/// Rounds of removing what sticks out or overlaps and settling again.
const CLEANUP_ROUNDS: usize = 4;
/// Settling after each of them, natural times.
const CLEANUP_SETTLE: f64 = 0.5;

/// Places for so many times the expected bodies are before the walls.
const ROOM: usize = 2;

/// Steps of depenetration at most: what has not come apart by then is locked in.
const MOST_DEPENETRATION: u64 = 60;

/// A fill of a wanted number of bodies has more by this share before the clean-up, which takes about as many.
const SURPLUS: f64 = 0.02;
/// What it takes beyond that is replaced so many times.
const REPLACEMENTS: usize = 3;

/// Fills the container and lets the props settle in it.
pub fn run(
    scene: &Scene,
    shapes: &[Shape],
    params: &Params,
    units: Units,
    container: &Container,
    observer: &mut dyn Observer,
) -> Result<Filled, Error> {
    let mut filling = Filling::new(scene, shapes, params, units, container);
    filling.place_given()?;
    let poured = match params.fill.method {
        FillMethod::Pour => Some(pour::run(&mut filling, observer)?),
        FillMethod::Insert | FillMethod::Off => None,
    };
    let closed = container.closed();
    let room = ROOM * filling.expected.min(params.fill.max_bodies as usize);
    let (walls, core, floor) = filling.world.add_behind(room, |world| {
        let walls = world.add_container(&closed.mesh, 0.0);
        let core = add_core(world, container);
        (walls, core, world.add_wall(DVec3::new(0.0, container.base, 0.0), DVec3::Y, 0.0))
    });
    let (walls, core) = (walls.map_err(Error::Internal)?, core?);
    let wanted = params.fill.count.unwrap_or(u32::MAX).min(params.fill.max_bodies) as usize;
    let full = match poured {
        Some(full) => full,
        None => {
            let surplus = params.fill.count.map_or(0.0, |n| SURPLUS * f64::from(n)) as usize;
            insert::run(&mut filling, wanted.saturating_add(surplus), observer)?
        }
    };
    filling.use_real_friction();
    // Turned over with the container still around it, the pile closes its gaps under its own weight.
    filling.world.set_gravity_up(false);
    filling.settle(params.fill.settle, observer)?;
    filling.clean_up(observer)?;
    for _ in 0..REPLACEMENTS {
        let missing = |filling: &Filling| params.fill.count.is_some_and(|n| filling.loose().count() < n as usize);
        if full || poured.is_some() || !missing(&filling) {
            break;
        }
        insert::run(&mut filling, wanted, observer)?;
        filling.use_real_friction();
        filling.settle(params.fill.settle, observer)?;
        filling.clean_up(observer)?;
    }
    filling.cut_to(wanted);
    // Parted bodies need the room that the walls do not leave them.
    filling.world.remove_wall(walls);
    let depenetration_steps = filling.depenetrate(observer)?;
    core.into_iter().for_each(|core| filling.world.remove_wall(core));
    filling.world.remove_wall(floor);
    let bodies = filling.loose().map(|id| filling.placed(id)).collect();
    let pockets = pockets::fraction(&filling);
    let (steps, counters) = (filling.world.steps - depenetration_steps, filling.world.counters);
    Ok(Filled {
        bodies,
        removed: filling.removed,
        steps,
        depenetration_steps,
        full,
        pockets,
        wall_triangles_saved: closed.saved,
        wall_deviation: closed.deviation,
        counters,
    })
}

/// The core, where there is one.
fn add_core(world: &mut World, container: &Container) -> Result<Option<WallId>, Error> {
    container.core.as_ref().map(|mesh| world.add_container(mesh, 0.0)).transpose().map_err(Error::Internal)
}

/// Pours the props through the opening and leaves them as they fell, upside down: no settling, no clean-up.
pub(crate) fn pour_only(
    scene: &Scene,
    shapes: &[Shape],
    params: &Params,
    units: Units,
    container: &Container,
    observer: &mut dyn Observer,
) -> Result<Vec<Instance>, Error> {
    let mut filling = Filling::new(scene, shapes, params, units, container);
    filling.shown = None;
    pour::run(&mut filling, observer)?;
    Ok(filling.world.present().map(|id| filling.placed(id)).collect())
}

impl<'a> Filling<'a> {
    /// An empty world under upward gravity.
    fn new(
        scene: &'a Scene,
        shapes: &'a [Shape],
        params: &'a Params,
        units: Units,
        container: &'a Container,
    ) -> Filling<'a> {
        let thickness =
            (shapes.iter().zip(&scene.props)).filter(|(_, p)| p.weight > 0.0).map(|(s, p)| s.thickness() * p.scale[0]);
        let thickness = thickness.fold(f64::INFINITY, f64::min);
        let sizes: Vec<Size> = shapes.iter().map(|s| s.size).collect();
        let room =
            Room { volume: container.volume * units.length.powi(3), area: container.area * units.length.powi(2) };
        let expected = expected_bodies(scene, &sizes, &room, &params.fill, 1.0);
        let compounds = shapes.iter().any(|s| s.solid.parts() > 1);
        let mut world = World::new(units, &params.fill_physics(units.time), thickness / units.length, compounds);
        world.set_gravity_up(true);
        Filling {
            scene,
            shapes,
            params,
            container,
            world,
            rng: Pcg64Mcg::seed_from_u64(params.seed),
            removed: Removed::default(),
            expected,
            work: 0.0,
            shown: Some(0),
        }
    }

    /// Puts the bodies placed by hand where they belong: the rest is filled around them.
    fn place_given(&mut self) -> Result<(), Error> {
        for given in self.scene.bodies.iter().filter(|body| body.is_stacked()) {
            let pose = self.shapes[given.prop].body_pose(&given.pose, given.scale);
            let id = self.insert(given.prop, given.scale, self.world.units.pose_to_engine(&pose))?;
            Policy::pin(&mut self.world, id);
        }
        Ok(())
    }

    /// The bodies that were filled in, rising.
    pub fn loose(&self) -> impl Iterator<Item = BodyId> + '_ {
        self.world.present().filter(|&id| self.world.bodies()[id].role != Role::Pinned)
    }

    /// A prop by weight, a scale from its range and an orientation from its own.
    pub fn draw(&mut self) -> (usize, f64, DQuat) {
        instance::draw(&self.scene.props, 0..self.scene.props.len(), &mut self.rng)
    }

    pub fn insert(&mut self, prop: usize, scale: f64, pose: Pose) -> Result<BodyId, Error> {
        let body = Insertion { prop, scale, pose, friction: self.params.fill.friction, restitution: 0.0 };
        self.world.insert(&self.shapes[prop], &body).map_err(Error::Internal)
    }

    /// Ends the friction of the fill.
    fn use_real_friction(&mut self) {
        for id in self.loose().collect::<Vec<_>>() {
            let friction = self.scene.props[self.world.bodies()[id].prop].friction;
            self.world.set_friction(id, friction);
        }
    }

    /// Simulates for a while, natural times.
    pub fn settle(&mut self, time: f64, observer: &mut dyn Observer) -> Result<(), Error> {
        let steps = (time / self.world.step_length()).ceil() as usize;
        for _ in 0..steps {
            self.world.step();
            self.show(observer);
            self.tell(observer)?;
        }
        Ok(())
    }

    /// Shows the bodies at the frame rate, at the end of the step that a frame falls into.
    fn show(&mut self, observer: &mut dyn Observer) {
        let Some(number) = self.shown.filter(|_| observer.wants_frames()) else { return };
        let units = self.world.units;
        let time = self.world.steps as f64 * self.world.step_length() * units.time;
        if time * self.params.output.fps < number as f64 {
            return;
        }
        let shown = |(id, body): (BodyId, &WorldBody)| {
            let pose = || self.shapes[body.prop].prop_pose(&units.pose_to_si(&self.world.pose(id)), body.scale);
            (body.role != Role::Gone).then(|| Shown {
                prop: body.prop,
                scale: body.scale,
                pose: pose(),
                state: State::Free,
            })
        };
        let bodies: Vec<Option<Shown>> = self.world.bodies().iter().enumerate().map(shown).collect();
        observer.frame(&Frame { stage: Stage::Fill, number, time, bodies: &bodies });
        self.shown = Some(number + 1);
    }

    pub fn tell(&mut self, observer: &mut dyn Observer) -> Result<(), Error> {
        let bodies = self.loose().count();
        self.work += bodies as f64 * self.world.step_length();
        let share = self.work / (USUAL_WORK * self.expected as f64);
        let beyond = (1.0 - USUAL_END) * (1.0 - 1.0 / share.max(1.0));
        let fraction = (USUAL_END * share.min(1.0) + beyond).min(0.99);
        let progress = Progress { stage: Stage::Fill, fraction, bodies, released: 0, at_rest: 0, nails: 0 };
        observe(observer, &progress)
    }

    fn placed(&self, id: BodyId) -> Instance {
        let body = &self.world.bodies()[id];
        Instance { prop: body.prop, scale: body.scale, pose: self.world.pose(id) }
    }

    /// How far the farthest corner of a body is outside the container, engine units.
    pub fn protrusion(&self, id: BodyId) -> f64 {
        let placed = self.placed(id);
        corners(&self.shapes[placed.prop], placed.scale / self.world.units.length, &placed.pose)
            .map(|p| self.container.distance.signed_distance(p).max(self.container.base - p.y))
            .fold(0.0, f64::max)
    }

    /// Takes out the newest bodies beyond `limit`.
    fn cut_to(&mut self, limit: usize) {
        for id in self.loose().skip(limit).collect::<Vec<_>>() {
            self.world.remove(id);
        }
    }

    /// Takes out what left the container.
    pub fn remove_escaped(&mut self) {
        for id in self.loose().collect::<Vec<_>>() {
            let center = self.world.pose(id).translation;
            if !(self.container.distance.signed_distance(center) <= 0.0 && center.y > self.container.base) {
                self.world.remove(id);
                self.removed.escaped += 1;
            }
        }
    }

    /// Takes out what sticks out or overlaps, until nothing does.
    fn clean_up(&mut self, observer: &mut dyn Observer) -> Result<(), Error> {
        for round in 0.. {
            self.remove_escaped();
            let out = self.loose().filter(|&id| self.protrusion(id) > self.params.fill.protrusion).collect::<Vec<_>>();
            self.removed.sticking_out += out.len();
            out.iter().for_each(|&id| self.world.remove(id));
            let pairs = self.overlapping(self.params.fill.overlap);
            let overlapping = self.separate(pairs, 0);
            self.removed.overlapping += overlapping;
            if (out.is_empty() && overlapping == 0) || round == CLEANUP_ROUNDS {
                break;
            }
            self.settle(CLEANUP_SETTLE, observer)?;
        }
        Ok(())
    }

    /// Parts what still overlaps. Returns the steps that this took.
    fn depenetrate(&mut self, observer: &mut dyn Observer) -> Result<u64, Error> {
        let residual = self.params.fill.residual_overlap;
        if residual >= 1.0 {
            return Ok(0);
        }
        let (bodies, fraction) = (self.loose().count(), 0.99);
        let progress = Progress { stage: Stage::Fill, fraction, bodies, released: 0, at_rest: 0, nails: 0 };
        let going = |step| observe(observer, &progress).map(|()| step < MOST_DEPENETRATION);
        self.world.depenetrate(residual, going)
    }

    /// Pairs that overlap by more than `limit` of the thinner one's thickness, rising; the lower number first.
    pub fn overlapping(&mut self, limit: f64) -> Vec<(BodyId, BodyId)> {
        self.world.zero_step();
        let too_deep = |t: &Touch| match t.b {
            Side::Body(b) => (t.depth() > limit * self.world.pair_thickness(t)).then_some((t.a, b)),
            _ => None,
        };
        self.world.touches(0.0).iter().filter_map(too_deep).collect()
    }

    /// Takes out bodies from `first` on until none of these pairs is left: those in most of them first. Returns how many.
    pub fn separate(&mut self, mut pairs: Vec<(BodyId, BodyId)>, first: BodyId) -> usize {
        let mut removed = 0;
        while !pairs.is_empty() {
            let mut count = BTreeMap::<BodyId, usize>::new();
            for &(a, b) in &pairs {
                for id in [a, b].into_iter().filter(|&id| id >= first && self.world.bodies()[id].role != Role::Pinned) {
                    *count.entry(id).or_default() += 1;
                }
            }
            let Some((&worst, _)) = count.iter().max_by_key(|&(&id, &n)| (n, id)) else { break };
            self.world.remove(worst);
            removed += 1;
            pairs.retain(|&(a, b)| a != worst && b != worst);
        }
        removed
    }
}

/// The corners of a shape at a pose, `scale` engine units per metre of the prop.
pub fn corners<'a>(shape: &'a Shape, scale: f64, pose: &Pose) -> Box<dyn Iterator<Item = DVec3> + 'a> {
    let pose = *pose;
    match &shape.solid {
        Solid::Box(b) => Box::new((0..8).map(move |i| {
            let sign = DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2 & 1)) * 2.0 - 1.0;
            pose.transform_point((b.center + b.rotation * (b.half * sign)) * scale)
        })),
        Solid::Ball { center, radius } => Box::new((0..6).map(move |i| {
            let axis = DVec3::AXES[i / 2] * if i % 2 == 0 { *radius } else { -*radius };
            pose.transform_point(*center * scale) + axis * scale
        })),
        Solid::Convex(parts) => Box::new(parts.iter().flatten().map(move |&p| pose.transform_point(p * scale))),
    }
}
