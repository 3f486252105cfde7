//! Lets the bodies of a layout fall until they rest, and tries whether they stay.

use crate::Library;
use crate::arrange::Start;
use cairn_engine::world::{BodyId, Insertion, PairSide, REST_SPEED, World};
use cairn_geometry::pose::Pose;
use glam::DVec3;

/// A layout that moves for longer than this is drawn again, characteristic times: of some 10 cm, 10 s.
const PATIENCE: f64 = 100.0;
/// It rests once no body has moved for this long, characteristic times.
const REST_TIME: f64 = 1.0;
/// Steps between two looks for bodies that have left the place.
const LOOK: u64 = 16;
/// A body that is below the place's lowest point has left it.
const FALLEN: f64 = 0.0;
/// Bodies are parted until they overlap by this share of the thinner one's thickness at most.
const RESIDUAL: f64 = 0.004;
/// Steps in which bodies are parted at most.
const MOST_PARTING: u64 = 60;
/// Time of a trial, s.
pub const TRIAL: f64 = 2.0;
/// A body may move by this much in a trial, m.
pub const MOST_DRIFT: f64 = 0.002;
/// A body may overlap others by this much, m.
pub const MOST_OVERLAP: f64 = 0.001;

/// Why an attempt is no layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rejection {
    /// There was no room for as many bodies as were to be there.
    NoRoom,
    /// A body left the place, or lies on its rim.
    NotContained,
    /// Bodies still moved after a long time.
    NotAtRest,
    /// Bodies overlap.
    Overlap,
    /// A body moved in the trial.
    Drift,
    /// A body moved in MuJoCo.
    DriftInMujoco,
    /// The target is seen too much or too little.
    Visible,
    /// Too many or too few bodies rest on the target.
    Covered,
}

/// A layout at rest.
pub struct Settled {
    pub world: World,
    /// Shape `[body]`, as in the starts.
    pub ids: Vec<BodyId>,
    /// Largest overlap of two bodies, or of one and the place, m.
    pub overlap: f64,
    pub steps: u64,
}

/// Lets bodies fall until they rest.
pub fn settle(library: &Library, place: usize, starts: &[Start]) -> Result<Settled, Rejection> {
    let most = library.catalogue.settle_friction();
    let mut world = library.places[place].world.clone();
    let wall = library.scene().statics[place].friction;
    world.set_wall_friction(library.places[place].wall, wall.min(most));
    let mut ids = Vec::new();
    for start in starts {
        let prop = &library.scene().props[start.prop];
        let body = Insertion {
            prop: start.prop,
            scale: start.scale,
            pose: world.units.pose_to_engine(&start.pose),
            friction: prop.friction.min(most),
            restitution: prop.restitution,
        };
        // A shape that the engine refuses is refused with the catalogue.
        ids.extend(world.insert(&library.shapes[start.prop], &body));
    }
    world.zero_step();
    until_rest(library, place, &mut world)?;
    let going = |steps: u64| Ok::<bool, std::convert::Infallible>(steps < MOST_PARTING);
    let Ok(parted) = world.depenetrate(RESIDUAL, going);
    if parted > 0 {
        until_rest(library, place, &mut world)?;
    }
    world.set_wall_friction(library.places[place].wall, wall);
    for (&id, start) in ids.iter().zip(starts) {
        world.set_friction(id, library.scene().props[start.prop].friction);
    }
    if world.present().count() < ids.len() || !are_contained(library, place, &world) {
        return Err(Rejection::NotContained);
    }
    let overlap = overlap(library, &world);
    if overlap > MOST_OVERLAP {
        return Err(Rejection::Overlap);
    }
    Ok(Settled { ids, overlap, steps: world.steps, world })
}

fn until_rest(library: &Library, place: usize, world: &mut World) -> Result<(), Rejection> {
    let most = (PATIENCE / world.step_length()).ceil() as u64;
    let rest = (REST_TIME / world.step_length()).ceil() as u64;
    let floor = world.units.height_to_engine(library.places[place].surfaces.bounds.0.y) - FALLEN;
    let mut still = 0;
    for step in 0..most {
        if !world.step().is_empty() {
            return Err(Rejection::NotContained);
        }
        if step % LOOK == 0 && world.present().any(|id| world.pose(id).translation.y < floor) {
            return Err(Rejection::NotContained);
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

/// The largest overlap of what is seen: the skins of bodies are taken off.
fn overlap(library: &Library, world: &World) -> f64 {
    let skin = |id: BodyId| library.skins[world.bodies()[id].prop] * world.bodies()[id].scale;
    let pairs = world.contact_pairs(0.0);
    let depth = pairs.iter().map(|pair| {
        let other = if let PairSide::Body(other) = pair.b { skin(other) } else { 0.0 };
        pair.depth() * world.units.length - skin(pair.a) - other
    });
    depth.fold(0.0, f64::max)
}

/// The largest way of a body in a trial as other engines may have it, m: each contact point has friction of its own,
/// nothing resists rolling, and every body is a little smaller and off its place.
pub fn drift(library: &Library, settled: &Settled) -> f64 {
    let mut world = settled.world.clone();
    world.act_as_any_engine(&library.shapes);
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
    let moved = |(&id, before): (&BodyId, &Pose)| {
        let way: DVec3 = world.pose(id).translation - before.translation;
        way.length() * world.units.length
    };
    settled.ids.iter().zip(&before).map(moved).fold(0.0, f64::max)
}
