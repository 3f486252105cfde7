//! Lets the bodies of a layout fall until they rest, and tries whether they stay.
//!
//! Engines differ most in friction: that of MuJoCo yields, so that a body that leans on friction creeps. Hence bodies
//! settle with next to none, and on ground that tilts a little to four sides in between: what could roll or tip has
//! done so. Then statics asks whether each body stands a small push to any side: one whose center of mass is right
//! above an edge of what it stands on tips where contacts yield. The trial asks whether they also rest on contacts as
//! soft as theirs.

use crate::Library;
use crate::arrange::Start;
use cairn_engine::shape::corners;
use cairn_engine::world::{BodyId, ContactPoint, Insertion, PairSide, REST_SPEED, World};
use cairn_geometry::contact::REAL_CONTACT;
use cairn_geometry::pose::Pose;
use cairn_input::params::Physics;
use cairn_statics::local::{Analyser, LocalContact, LocalProblem};
use glam::DVec3;
use std::f64::consts::TAU;

/// A layout that moves for longer than this is drawn again, characteristic times: of some 10 cm, 10 s.
const PATIENCE: f64 = 100.0;
/// It rests once no body has moved for this long, characteristic times.
const REST_TIME: f64 = 1.0;
/// On a place without walls, bodies have landed once all have been slower than this, d per characteristic time, for so
/// many steps, or after so many characteristic times.
const SLOW: f64 = 0.1;
const SLOW_STEPS: u64 = 6;
const LANDING: f64 = 20.0;
/// Steps between two looks for bodies that have left the place.
const LOOK: u64 = 16;
/// The ground tilts by this much to each of four sides, degrees, each time for so long, characteristic times. Of 80
/// layouts of household objects, 65 stood in MuJoCo without it, 70 with 2 degrees, and 75 with 4.
const TILT: f64 = 4.0;
const TILT_TIME: f64 = 2.0;
/// Bodies are parted until they overlap by this share of the thinner one's thickness at most.
const RESIDUAL: f64 = 0.01;
/// Steps in which bodies are parted at most.
const MOST_PARTING: u64 = 60;
/// A body that reaches into the place by more than this is stuck in a wall, m.
const STUCK: f64 = 0.002;
/// Time of a trial, s.
pub const TRIAL: f64 = 2.0;
/// Contacts of a trial: the angular frequency of their springs, per characteristic time, a third of the usual one; that
/// of MuJoCo's is about twice as high for props of 10 cm. Few substeps suffice for such.
const SOFT_FREQUENCY: f64 = 7.0;
const SOFT_SUBSTEPS: u32 = 4;
/// A body may move by this much in a trial, in the median prop's diameter: soft contacts sink in. Of 1,000 layouts of
/// household objects within this bound, 983 moved by less than 2 mm in MuJoCo; without it, nine of ten.
pub const MOST_DRIFT: f64 = 0.003;
/// What is nearer than this touches on softer contacts, m: bodies sink into those of MuJoCo by about as much.
const TOUCHING: f64 = 1e-4;
/// Sides to which bodies are pushed, and by how much at most, weights.
const SIDES: u32 = 8;
const MOST_PUSH: f64 = 0.2;
/// Each body stands a push of this share of its weight: else its center of mass is so close above an edge of what it
/// stands on that it tips where contacts yield. Of 1,000 layouts of household objects that moved little in the trial,
/// 983 moved by less than 2 mm in MuJoCo; of the 816 that stand such a push, all but 4.
pub const LEAST_PUSH: f64 = 0.02;
/// A body may move by this much in another engine, m.
pub const MOST_ELSEWHERE: f64 = 0.002;
/// A body may overlap others by this much, m.
pub const MOST_OVERLAP: f64 = 0.001;

/// Why an attempt is no layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rejection {
    /// There was no room for as many bodies as were to be there.
    NoRoom,
    /// Too many bodies left the place, or one lies on its rim.
    NotContained,
    /// Bodies still moved after a long time.
    NotAtRest,
    /// Bodies overlap.
    Overlap,
    /// A body moved in the trial.
    Drift,
    /// A body stands so close to tipping that a small push does it.
    Tips,
    /// A body moved in MuJoCo.
    DriftInMujoco,
    /// Too many or too few bodies rest on the target.
    Covered,
}

/// A layout at rest.
pub struct Settled {
    pub world: World,
    /// The bodies that have not left the place.
    pub ids: Vec<BodyId>,
    /// Where they began. Shape `[body]`.
    pub starts: Vec<Start>,
    pub place: usize,
    /// Largest overlap of two bodies, or of one and the place, m.
    pub overlap: f64,
}

/// Lets bodies fall until they rest.
pub fn settle(library: &Library, place: usize, starts: &[Start]) -> Result<Settled, Rejection> {
    let most = library.catalogue.settle_friction();
    let mut world = library.places[place].world.clone();
    let mut ids = Vec::new();
    for start in starts {
        let prop = &library.scene().props[start.prop];
        let body = Insertion {
            prop: start.prop,
            scale: start.scale,
            pose: world.units.pose_to_engine(&start.pose),
            friction: prop.friction,
            restitution: prop.restitution,
        };
        // A shape that the engine refuses is refused with the catalogue.
        ids.extend(world.insert(&library.shapes[start.prop], &body));
    }
    world.use_contacts_of(&library.params.physics, library.thickness);
    if library.places[place].surfaces.has_walls {
        use_friction(library, place, &mut world, most);
    }
    world.zero_step();
    if !library.places[place].surfaces.has_walls {
        // Nothing else keeps what rolls and slides on a table.
        until_slow(&mut world)?;
        use_friction(library, place, &mut world, most);
    }
    world.roll_freely();
    until_rest(library, place, &mut world)?;
    tilt(&mut world)?;
    until_rest(library, place, &mut world)?;
    let going = |steps: u64| Ok::<bool, std::convert::Infallible>(steps < MOST_PARTING);
    let Ok(parted) = world.depenetrate(RESIDUAL, going);
    if parted > 0 {
        until_rest(library, place, &mut world)?;
    }
    use_friction(library, place, &mut world, f64::INFINITY);
    let kept = ids.iter().zip(starts).filter(|(id, _)| world.is_present(**id));
    let (ids, starts): (Vec<BodyId>, Vec<Start>) = kept.map(|(&id, &start)| (id, start)).unzip();
    if ids.is_empty() || !are_contained(library, place, &world) {
        return Err(Rejection::NotContained);
    }
    let overlap = overlap(&world);
    if overlap > MOST_OVERLAP || is_any_stuck(library, place, &world) {
        return Err(Rejection::Overlap);
    }
    Ok(Settled { world, ids, starts, place, overlap })
}

/// Gives bodies and place their own friction, at most this.
fn use_friction(library: &Library, place: usize, world: &mut World, most: f64) {
    let scene = library.scene();
    for &wall in &library.places[place].walls {
        world.set_wall_friction(wall, scene.statics[place].friction.min(most));
    }
    for id in world.present().collect::<Vec<_>>() {
        let prop = world.bodies()[id].prop;
        world.set_friction(id, scene.props[prop].friction.min(most));
    }
}

/// Tilts the ground to four sides.
fn tilt(world: &mut World) -> Result<(), Rejection> {
    let (sin, cos) = libm::sincos(TILT.to_radians());
    let steps = (TILT_TIME / world.step_length()).ceil() as u64;
    for side in [DVec3::X, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Z] {
        world.set_gravity(DVec3::NEG_Y * cos + side * sin);
        for _ in 0..steps {
            if !world.step().is_empty() {
                return Err(Rejection::NotContained);
            }
        }
    }
    world.set_gravity(DVec3::NEG_Y);
    Ok(())
}

/// Until bodies have landed.
fn until_slow(world: &mut World) -> Result<(), Rejection> {
    let most = (LANDING / world.step_length()).ceil() as u64;
    let mut slow = 0;
    for _ in 0..most {
        if !world.step().is_empty() {
            return Err(Rejection::NotContained);
        }
        slow = if world.present().all(|id| world.speed(id) < SLOW) { slow + 1 } else { 0 };
        if slow >= SLOW_STEPS {
            break;
        }
    }
    Ok(())
}

fn until_rest(library: &Library, place: usize, world: &mut World) -> Result<(), Rejection> {
    let most = (PATIENCE / world.step_length()).ceil() as u64;
    let rest = (REST_TIME / world.step_length()).ceil() as u64;
    let lowest = world.units.height_to_engine(library.places[place].surfaces.lowest);
    let mut still = 0;
    for step in 0..most {
        if !world.step().is_empty() {
            return Err(Rejection::NotContained);
        }
        if step % LOOK == 0 {
            let has_left = |id: &BodyId| world.pose(*id).translation.y < lowest;
            let left: Vec<BodyId> = world.present().filter(has_left).collect();
            left.into_iter().for_each(|id| world.remove(id));
        }
        still = if world.present().all(|id| world.speed(id) < REST_SPEED) { still + 1 } else { 0 };
        if still >= rest {
            return Ok(());
        }
    }
    Err(Rejection::NotAtRest)
}

/// Whether every center of mass is above a surface of the place.
fn are_contained(library: &Library, place: usize, world: &World) -> bool {
    let surfaces = &library.places[place].surfaces;
    world.present().all(|id| surfaces.contains(world.units.point_to_si(world.pose(id).translation)))
}

/// The largest overlap of two collision shapes, m.
fn overlap(world: &World) -> f64 {
    world.contact_pairs(0.0).iter().map(|pair| pair.depth() * world.units.length).fold(0.0, f64::max)
}

/// Whether a body reaches into the place: thin ones may get into a wall, which pushes them out on neither side.
fn is_any_stuck(library: &Library, place: usize, world: &World) -> bool {
    let surfaces = &library.places[place].surfaces;
    world.present().any(|id| {
        let (body, pose) = (&world.bodies()[id], world.units.pose_to_si(&world.pose(id)));
        let center = pose.translation;
        let inner = |corner: DVec3| {
            let way = corner - center;
            center + way * (1.0 - STUCK / way.length().max(STUCK))
        };
        corners(&library.shapes[body.prop], body.scale, &pose).any(|corner| surfaces.is_between(center, inner(corner)))
    })
}

/// The largest way of a body in the trial, m: on soft contacts, with as little friction as it settled with, each point
/// with friction of its own, and nothing that resists rolling.
pub fn drift(library: &Library, settled: &Settled) -> f64 {
    let mut world = settled.world.clone();
    let own = &library.params.physics;
    let soft = Physics { contact_frequency: SOFT_FREQUENCY, substeps: SOFT_SUBSTEPS, ..own.clone() };
    world.use_contacts_of(&soft, library.thickness);
    use_friction(library, settled.place, &mut world, library.catalogue.settle_friction());
    // Wakes all.
    world.set_gravity(DVec3::NEG_Y);
    let before: Vec<Pose> = settled.ids.iter().map(|&id| settled.world.pose(id)).collect();
    let steps = (TRIAL / world.units.time / world.step_length()).ceil() as u64;
    for _ in 0..steps {
        if !world.step().is_empty() {
            return f64::INFINITY;
        }
        if settled.ids.iter().all(|&id| !world.is_awake(id)) {
            break;
        }
    }
    let moved =
        |(&id, before): (&BodyId, &Pose)| world.pose(id).translation.distance(before.translation) * world.units.length;
    settled.ids.iter().zip(&before).map(moved).fold(0.0, f64::max)
}

/// The largest share of its weight by which each body can be pushed at its center of mass to any side, at most
/// [`MOST_PUSH`], and neither tips nor slides, by statics of the body among others that stand still; the least of the
/// layout. Of a body that others hold down where it is, this says nothing.
pub fn push(settled: &Settled) -> f64 {
    let world = &settled.world;
    let mut contacts = vec![Vec::new(); world.bodies().len()];
    for pair in world.contact_pairs(REAL_CONTACT) {
        let friction = pair.friction;
        let touches = |point: &&ContactPoint| point.gap * world.units.length < TOUCHING;
        for &ContactPoint { point, normal, .. } in pair.points.iter().filter(touches) {
            contacts[pair.a].push(LocalContact { point, normal, friction });
            if let PairSide::Body(b) = pair.b {
                contacts[b].push(LocalContact { point, normal: -normal, friction });
            }
        }
    }
    let way = |side: u32| {
        let (sin, cos) = libm::sincos(f64::from(side) * TAU / f64::from(SIDES));
        DVec3::new(cos, 0.0, sin)
    };
    let ways: Vec<DVec3> = (0..SIDES).map(way).collect();
    let mut analyser = Analyser::new();
    let pushes = |&id: &BodyId| {
        let body = LocalProblem {
            contacts: &contacts[id],
            mass: 1.0,
            center_of_mass: world.pose(id).translation,
            radius: world.bodies()[id].radius,
            gravity: DVec3::NEG_Y,
        };
        analyser.pushes(&body, &ways, MOST_PUSH).ok().flatten().unwrap_or_default()
    };
    settled.ids.iter().flat_map(pushes).fold(MOST_PUSH, f64::min)
}
