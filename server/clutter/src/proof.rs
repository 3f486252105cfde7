//! Whether the bodies of a layout at rest stay, here and elsewhere: which are at fault, and why.

use crate::pile::{self, Pile};
use crate::settle::{Rejection, use_friction};
use cairn_engine::shape::corners;
use cairn_engine::world::{BodyId, ContactPair, ContactPoint, PairSide, World};
use cairn_geometry::contact::REAL_CONTACT;
use cairn_geometry::pose::Pose;
use cairn_input::params::Physics;
use cairn_statics::local::{Analyser, LocalContact, LocalProblem};
use glam::DVec3;
use std::f64::consts::TAU;

/// A body that reaches into the place by more than this is stuck in a wall, m.
const STUCK: f64 = 0.002;
/// Time of a trial, s.
pub const TRIAL: f64 = 2.0;
/// Contacts of a trial: the angular frequency of their springs, per characteristic time, a third of the usual one; that
/// of MuJoCo's is about twice as high for props of 10 cm. Few substeps suffice for such.
const SOFT_FREQUENCY: f64 = 7.0;
const SOFT_SUBSTEPS: u32 = 4;
/// A body may move by this much in a trial, in the median prop's diameter: soft contacts sink in. Of 1,000 layouts of
/// household objects within half as much more, 983 moved by less than 2 mm in MuJoCo; without a bound, nine of ten.
/// What moves by more sways: a bar on a brick on a bar swung by 3 mm.
pub const MOST_DRIFT: f64 = 0.002;
/// What is nearer than this touches on softer contacts, m: bodies sink into those of MuJoCo by about as much.
const TOUCHING: f64 = 1e-4;
/// Sides to which bodies are pushed, and by how much at most, weights.
const SIDES: u32 = 8;
pub const MOST_PUSH: f64 = 0.2;
/// Each body stands a push of this share of its weight: else its center of mass is so close above an edge of what it
/// stands on that it tips where contacts yield. Of 1,000 layouts of household objects that moved little in the trial,
/// 983 moved by less than 2 mm in MuJoCo; of the 816 that stand a third of such a push, all but 4. Of 80 tables of 50,
/// of which each body stood that third, 6 did not stay; of 100 with two thirds, which had tilted for half as long, 5:
/// tall ones on narrow ones, which all stood little more.
pub const LEAST_PUSH: f64 = 0.06;
/// A body and what rests on it are tried as one if these are no more; larger heaps lean on each other.
const MOST_CARRIED: usize = 6;
/// A body may move by this much in another engine, m.
pub const MOST_ELSEWHERE: f64 = 0.002;
/// A body may overlap others by this much, m.
pub const MOST_OVERLAP: f64 = 0.001;

/// What was found of bodies at rest.
pub struct Found {
    /// Bodies that cannot stay, each with a reason.
    pub faults: Vec<(BodyId, Rejection)>,
    /// Pushes that bodies stand, alone or laden, weights; only of those that were tried and stand by themselves.
    pub pushes: Vec<(BodyId, f64)>,
}

/// The pushes that bodies stand, weights; only of those that stand by themselves.
#[derive(Default)]
struct Pushes {
    /// Each body, the others standing still.
    alone: Vec<(BodyId, f64)>,
    /// Each that carries others, as one with them.
    laden: Vec<(BodyId, f64)>,
}

/// Looks at each body: whether it is in its place, overlaps and, if `is_tried`, stands a push.
pub fn faults(pile: &Pile, is_tried: bool) -> Found {
    let world = &pile.world;
    let pairs = world.contact_pairs(REAL_CONTACT);
    let mut faults = Vec::new();
    let surfaces = &pile.library.places[pile.drawn.place].surfaces;
    for id in world.present() {
        if !surfaces.contains(world.units.point_to_si(world.pose(id).translation)) {
            faults.push((id, Rejection::NotContained));
        } else if is_stuck(pile, id) {
            faults.push((id, Rejection::Overlap));
        }
    }
    for pair in pairs.iter().filter(|pair| pair.depth() * world.units.length > MOST_OVERLAP) {
        let goes = match pair.b {
            PairSide::Body(b) if pile.carries_less(b, pair.a, &pairs) => b,
            _ => pair.a,
        };
        faults.push((goes, Rejection::Overlap));
    }
    let Pushes { alone, laden } = if is_tried { pushes(world, &pairs) } else { Pushes::default() };
    let is_weak = |&&(_, push): &&(BodyId, f64)| push < LEAST_PUSH;
    faults.extend(alone.iter().filter(is_weak).map(|&(id, _)| (id, Rejection::Tips)));
    // One that tips with its load stays without it.
    let loads = laden.iter().filter(is_weak).flat_map(|&(id, _)| pile::resting_on(id, &pairs));
    faults.extend(loads.map(|id| (id, Rejection::Tips)));
    Found { faults, pushes: alone.into_iter().chain(laden).collect() }
}

/// The largest overlap of two collision shapes, m.
pub fn overlap(world: &World) -> f64 {
    world.contact_pairs(0.0).iter().map(|pair| pair.depth() * world.units.length).fold(0.0, f64::max)
}

/// Whether a body reaches into the place: thin ones may get into a wall, which pushes them out on neither side.
fn is_stuck(pile: &Pile, id: BodyId) -> bool {
    let (world, surfaces) = (&pile.world, &pile.library.places[pile.drawn.place].surfaces);
    let (body, pose) = (&world.bodies()[id], world.units.pose_to_si(&world.pose(id)));
    let center = pose.translation;
    let inner = |corner: DVec3| {
        let way = corner - center;
        center + way * (1.0 - STUCK / way.length().max(STUCK))
    };
    let shape = &pile.library.shapes[body.prop];
    corners(shape, body.scale, &pose).any(|corner| surfaces.is_between(center, inner(corner)))
}

/// The way of each body in the trial, m: on soft contacts, with as little friction as it settled with, each point with
/// friction of its own, and nothing that resists rolling.
pub fn drifts(pile: &Pile) -> Vec<(BodyId, f64)> {
    let library = pile.library;
    let mut world = pile.world.clone();
    let own = &library.params.physics;
    let soft = Physics { contact_frequency: SOFT_FREQUENCY, substeps: SOFT_SUBSTEPS, ..own.clone() };
    world.use_contacts_of(&soft, library.thickness);
    use_friction(library, pile.drawn.place, &mut world, library.rest_friction());
    // Wakes all.
    world.set_gravity(DVec3::NEG_Y);
    let before: Vec<(BodyId, Pose)> = pile.world.present().map(|id| (id, pile.world.pose(id))).collect();
    let steps = (TRIAL / world.units.time / world.step_length()).ceil() as u64;
    for _ in 0..steps {
        // What the engine loses is not there afterwards.
        world.step();
        if before.iter().all(|&(id, _)| !world.is_present(id) || !world.is_awake(id)) {
            break;
        }
    }
    let moved = |(id, before): (BodyId, Pose)| {
        let way = world.pose(id).translation.distance(before.translation) * world.units.length;
        (id, if world.is_present(id) { way } else { f64::INFINITY })
    };
    before.into_iter().map(moved).collect()
}

/// The largest share of its weight by which each body can be pushed at its center of mass to any side, at most
/// [`MOST_PUSH`], and neither tips nor slides, by statics of the body among others that stand still. Of a body that
/// others hold down where it is, this says nothing. The same of each body together with all that rests on it, as one.
fn pushes(world: &World, pairs: &[ContactPair]) -> Pushes {
    let mut touches = Vec::new();
    for pair in pairs {
        let b = if let PairSide::Body(b) = pair.b { Some(b) } else { None };
        let is_near = |point: &&ContactPoint| point.gap * world.units.length < TOUCHING;
        let touching = |&ContactPoint { point, normal, .. }: &ContactPoint| Touching {
            a: pair.a,
            b,
            contact: LocalContact { point, normal, friction: pair.friction },
        };
        touches.extend(pair.points.iter().filter(is_near).map(touching));
    }
    let way = |side: u32| {
        let (sin, cos) = libm::sincos(f64::from(side) * TAU / f64::from(SIDES));
        DVec3::new(cos, 0.0, sin)
    };
    let ways: Vec<DVec3> = (0..SIDES).map(way).collect();
    let mut analyser = Analyser::new();
    let mut push = |contacts: &[LocalContact], center_of_mass: DVec3, radius: f64| {
        let body = LocalProblem { contacts, mass: 1.0, center_of_mass, radius, gravity: DVec3::NEG_Y };
        let pushes = analyser.pushes(&body, &ways, MOST_PUSH).ok().flatten()?;
        Some(pushes.into_iter().fold(MOST_PUSH, f64::min))
    };
    let mut found = Pushes::default();
    for id in world.present() {
        let (center, radius) = (world.pose(id).translation, world.bodies()[id].radius);
        let own: Vec<LocalContact> = touches.iter().filter_map(|touch| touch.on(&|other| other == id)).collect();
        found.alone.extend(push(&own, center, radius).map(|push| (id, push)));
        let group = pile::all_resting_on(id, pairs);
        if group.is_empty() || group.len() > MOST_CARRIED {
            continue;
        }
        let is_in = |other: BodyId| other == id || group.contains(&other);
        let of_group: Vec<LocalContact> = touches.iter().filter_map(|touch| touch.on(&is_in)).collect();
        let members = || std::iter::once(id).chain(group.iter().copied());
        let mass: f64 = members().map(|id| world.bodies()[id].mass).sum();
        let middle = members().map(|id| world.pose(id).translation * world.bodies()[id].mass).sum::<DVec3>() / mass;
        let reach = |id: BodyId| world.pose(id).translation.distance(middle) + world.bodies()[id].radius;
        let radius = members().map(reach).fold(0.0, f64::max);
        found.laden.extend(push(&of_group, middle, radius).map(|push| (id, push)));
    }
    found
}

/// A contact that carries where contacts yield.
struct Touching {
    a: BodyId,
    b: Option<BodyId>,
    contact: LocalContact,
}

impl Touching {
    /// The contact as it acts on a group of bodies from outside.
    fn on(&self, is_in: &impl Fn(BodyId) -> bool) -> Option<LocalContact> {
        match (is_in(self.a), self.b.is_some_and(is_in)) {
            (true, false) => Some(self.contact),
            (false, true) => Some(LocalContact { normal: -self.contact.normal, ..self.contact }),
            _ => None,
        }
    }
}
