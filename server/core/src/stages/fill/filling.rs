//! The state of a fill: the world, what is in it, and what every method does with it.

use super::Removed;
use super::mixture::Mixture;
use crate::error::Error;
use crate::geometry::pose::Pose;
use crate::input::observer::{Frame, Observer, Progress, Shown, Stage, State, observe};
use crate::input::params::{FillMethod, Params};
use crate::input::scene::Scene;
use crate::prepare::container::Container;
use crate::prepare::packing::{Room, expected_bodies};
use crate::prepare::shape::{Shape, Size, corners};
use crate::sim::instance::{self, Instance};
use crate::sim::policy::Policy;
use crate::world::{BodyId, ContactPair, Insertion, PairSide, Role, Units, World, WorldBody};
use glam::{DQuat, DVec3};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use std::collections::{BTreeMap, BTreeSet};

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
    /// The props that are drawn now.
    pub among: Vec<usize>,
    pub mixture: Option<Mixture>,
    /// The first body of the last round, if the method knows rounds.
    pub newest: BodyId,
    /// Bodies simulated so far, times natural times.
    work: f64,
    /// Frames shown; `None` where none are to be.
    pub shown: Option<usize>,
    /// Share of gravity that pulls.
    weight: f64,
}

/// A container this high, in d, is filled under full gravity; a higher one under less, so that what is at its end is not squeezed more.
const TALL: f64 = 6.0;

/// Natural times for which the bodies of a fill are usually simulated, times the expected bodies.
const USUAL_WORK: f64 = 15.0;
/// Progress when the usual work is done; the rest is for fills that take longer.
const USUAL_END: f64 = 0.9;
/// Rounds of removing what sticks out or overlaps and settling again.
const CLEANUP_ROUNDS: usize = 4;
/// Settling after each of them, natural times.
const CLEANUP_SETTLE: f64 = 0.5;
/// The pile as a whole falls if its mean speed downward is more than this, d per natural time under full gravity (what closes gaps is
/// slower), and at least this share of what it has been.
const FALLING: f64 = 0.1;
const FALLING_ON: f64 = 0.1;
/// It is let fall for so many times as long at most as it would take through all of the container.
const LANDING: f64 = 1.5;
/// Steps of depenetration at most: what has not come apart by then is locked in.
const MOST_DEPENETRATION: u64 = 60;

impl<'a> Filling<'a> {
    /// An empty world, under upward gravity.
    pub fn new(
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
        let world = World::new(units, &params.fill_physics(units.time), thickness / units.length, compounds);
        let weight = match params.fill.method {
            FillMethod::Insert => (TALL / (container.high.y - container.base)).min(1.0),
            _ => 1.0,
        };
        let mut filling = Filling {
            scene,
            shapes,
            params,
            container,
            world,
            rng: Pcg64Mcg::seed_from_u64(params.seed),
            removed: Removed::default(),
            expected,
            among: (0..scene.props.len()).collect(),
            mixture: None,
            newest: BodyId::MAX,
            work: 0.0,
            shown: Some(0),
            weight,
        };
        // An upright container is filled as if it stood on its head.
        filling.pull(DVec3::Y);
        filling
    }

    /// Which way gravity of 1 points.
    pub fn pull(&mut self, direction: DVec3) {
        self.world.set_gravity(direction * self.weight);
    }

    /// Puts the bodies placed by hand where they belong: the rest is filled around them.
    pub fn place_given(&mut self) -> Result<(), Error> {
        for given in self.scene.bodies.iter().filter(|body| body.is_stacked()) {
            let pose = self.shapes[given.prop].body_pose(&given.pose, given.scale);
            let id = self.insert(given.prop, given.scale, self.world.units.pose_to_engine(&pose))?;
            Policy::pin(&mut self.world, id);
        }
        Ok(())
    }

    /// Nodes of the container's distance grid that are inside.
    pub fn inside(&self) -> Vec<DVec3> {
        let grid = &self.container.distance;
        let (origin, size, values) = grid.nodes();
        let place =
            |i: usize| DVec3::new((i % size[0]) as f64, (i / size[0] % size[1]) as f64, (i / size[0] / size[1]) as f64);
        let inside = values.iter().enumerate().filter(|(_, distance)| **distance <= 0.0);
        inside.map(|(i, _)| origin + grid.spacing() * place(i)).collect()
    }

    /// Whether the mixture lets a prop be here.
    pub fn may_be(&mut self, prop: usize, p: DVec3) -> bool {
        self.mixture.as_ref().is_none_or(|mixture| mixture.allows(prop, p, &mut self.rng))
    }

    /// The bodies that were filled in, rising.
    pub fn loose(&self) -> impl Iterator<Item = BodyId> + '_ {
        self.world.present().filter(|&id| self.world.bodies()[id].role != Role::Pinned)
    }

    /// A prop by weight, a scale from its range and an orientation from its own.
    pub fn draw(&mut self) -> (usize, f64, DQuat) {
        instance::draw(&self.scene.props, self.among.iter().copied(), &mut self.rng)
    }

    /// A scale and an orientation of this prop.
    pub fn draw_of(&mut self, prop: usize) -> (usize, f64, DQuat) {
        instance::draw(&self.scene.props, std::iter::once(prop), &mut self.rng)
    }

    pub fn insert(&mut self, prop: usize, scale: f64, pose: Pose) -> Result<BodyId, Error> {
        let body = Insertion { prop, scale, pose, friction: self.params.fill.friction, restitution: 0.0 };
        self.world.insert(&self.shapes[prop], &body).map_err(Error::Internal)
    }

    /// Ends the friction of the fill.
    pub fn use_real_friction(&mut self) {
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

    /// Settles, also from the fall of what does not fill the container: it goes on for as long at most as a fall through all of it takes.
    pub fn land(&mut self, observer: &mut dyn Observer) -> Result<(), Error> {
        let height = self.container.high.y - self.container.base;
        let mut left = LANDING * (2.0 * height / self.weight).sqrt();
        // What has just risen must not rise on.
        for id in self.loose().collect::<Vec<_>>() {
            self.world.launch(id, DVec3::ZERO, DVec3::ZERO);
        }
        self.settle(self.params.fill.settle, observer)?;
        let mut speed = self.falling_speed();
        if speed <= FALLING * self.weight {
            return Ok(());
        }
        let mut top_speed = speed;
        while left > 0.0 && speed > FALLING_ON * top_speed {
            self.settle(self.world.step_length(), observer)?;
            left -= self.world.step_length();
            speed = self.falling_speed();
            top_speed = top_speed.max(speed);
        }
        self.settle(self.params.fill.settle, observer)
    }

    /// Mean speed downward, d per natural time.
    fn falling_speed(&self) -> f64 {
        let speeds = || self.loose().map(|id| -self.world.velocity(id).y);
        speeds().sum::<f64>() / speeds().count().max(1) as f64
    }

    /// Shows the bodies at the frame rate, at the end of the step that a frame falls into.
    pub fn show(&mut self, observer: &mut dyn Observer) {
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

    pub fn placed(&self, id: BodyId) -> Instance {
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

    /// Takes out the newest bodies beyond `limit`. Those of a round are equally new: of them, some from everywhere.
    pub fn cut_to(&mut self, limit: usize) {
        let beyond = self.loose().count().saturating_sub(limit);
        let round: Vec<BodyId> = self.loose().filter(|&id| id >= self.newest).collect();
        let out: Vec<BodyId> = match beyond {
            0 => Vec::new(),
            _ if beyond <= round.len() => (0..beyond).map(|i| round[i * round.len() / beyond]).collect(),
            _ => self.loose().skip(limit).collect(),
        };
        out.into_iter().for_each(|id| self.world.remove(id));
    }

    /// Takes out what left the container.
    pub fn remove_escaped(&mut self) {
        let outside = self.params.fill.outside();
        for id in self.loose().collect::<Vec<_>>() {
            let center = self.world.pose(id).translation;
            if !(self.container.distance.signed_distance(center) <= outside && center.y > self.container.base) {
                self.world.remove(id);
                self.removed.escaped += 1;
            }
        }
    }

    /// Takes out what sticks out or overlaps, until nothing does.
    pub fn clean_up(&mut self, observer: &mut dyn Observer) -> Result<(), Error> {
        for round in 0.. {
            self.remove_escaped();
            let most = self.params.fill.protrusion + self.params.fill.outside();
            let out = self.loose().filter(|&id| self.protrusion(id) > most).collect::<Vec<_>>();
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
    pub fn depenetrate(&mut self, observer: &mut dyn Observer) -> Result<u64, Error> {
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
        let too_deep = |t: &ContactPair| match t.b {
            PairSide::Body(b) => (t.depth() > limit * self.world.pair_thickness(t)).then_some((t.a, b)),
            _ => None,
        };
        self.world.contact_pairs(0.0).iter().filter_map(too_deep).collect()
    }

    /// Takes out bodies from `first` on until none of these pairs is left: those in most of them first. Returns how many.
    pub fn separate(&mut self, pairs: Vec<(BodyId, BodyId)>, first: BodyId) -> usize {
        let may_go = |id: BodyId| id >= first && self.world.bodies()[id].role != Role::Pinned;
        let mut others = BTreeMap::<BodyId, Vec<BodyId>>::new();
        for (a, b) in pairs.into_iter().flat_map(|(a, b)| [(a, b), (b, a)]) {
            others.entry(a).or_default().push(b);
        }
        let mut count: BTreeMap<BodyId, usize> = others.iter().map(|(&id, others)| (id, others.len())).collect();
        let mut order: BTreeSet<(usize, BodyId)> =
            count.iter().filter(|(id, _)| may_go(**id)).map(|(&id, &n)| (n, id)).collect();
        let mut removed = 0;
        while let Some((1.., worst)) = order.pop_last() {
            self.world.remove(worst);
            removed += 1;
            for other in others.remove(&worst).unwrap_or_default() {
                let Some(n) = count.get_mut(&other).filter(|_| others.contains_key(&other)) else { continue };
                if order.remove(&(*n, other)) {
                    order.insert((*n - 1, other));
                }
                *n -= 1;
            }
        }
        removed
    }
}
