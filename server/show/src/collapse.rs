//! A designed fall: a pile that rests comes down, one body first, to one side.
//!
//! All that touches is one solid from the moment on in which it begins, whatever held it before. A solid that is higher
//! than its foot is wide gets little more than the least push with which it topples over the edge of the foot, to the
//! side of the fall: the energy that raises its center of mass over that edge. It breaks up in a front that starts at
//! the first body, runs ahead toward the side of the fall, and reaches the other side last. A wider pile cannot topple:
//! it comes apart in the same order.

use super::taking_apart::{FALLEN, MOVED};
use cairn_engine::world::{BodyId, PairSide, Role};
use cairn_geometry::contact::REAL_CONTACT;
use cairn_geometry::pose::Pose;
use cairn_input::error::Error;
use cairn_input::observer::{Observer, Stage};
use cairn_input::params::Params;
use cairn_input::scene::CollapseRequest;
use cairn_motion::glue::sites::Sites;
use cairn_motion::glue::{Joint, PileGlue};
use cairn_motion::hold::{self, HoldOutcome};
use cairn_motion::pile::Pile;
use cairn_motion::step::Simulation;
use glam::DVec3;
use std::collections::BTreeSet;

/// How much the front runs ahead: its distance from the first body counts less by this share of the way toward the
/// side of the fall, and more by the same behind.
const AHEAD: f64 = 0.5;
/// The first body goes so long before the others, characteristic times.
const LEAD: f64 = 0.5;
/// The push is larger than the least one by this factor.
const SURE: f64 = 1.4;
/// The front takes this share of the time of a fall from the top. Of a tower of 123 bricks, to eight sides, the way is
/// off by 4 degrees in the mean; with 1.5, by 10.
const FRONT: f64 = 0.7;
/// Where no body is named, the first one is of the lowest part of the pile of this share of its height.
const LOW: f64 = 0.25;

/// What has not moved so long after the last joint broke, characteristic times, stays.
const LATEST: f64 = 5.0;

/// What became of it.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Collapse {
    /// The body that was to go first, and those that were the first to move by more than 0.02 d: all of one step.
    pub first: usize,
    pub moved_first: Vec<usize>,
    /// The frame in which it begins, the one in which the last joint breaks, and the one in which all rest again.
    pub frame: usize,
    pub last_joint_frame: usize,
    pub rest_frame: usize,
    /// Pairs that touched and came apart in the front.
    pub joints: usize,
    /// Speed of the center of mass with which the pile topples, m/s; 0: it is too wide.
    pub push: f64,
    /// Bodies that were there, those that moved, and those that came down by more than 0.1 d.
    pub bodies: usize,
    pub moved: usize,
    pub came_down: usize,
    /// Direction of the fall that was asked for, and that of the mean way of the pile across gravity: degrees from +Z
    /// toward +X. `None`: it moved by less than 0.02 d in the mean.
    pub azimuth: f64,
    pub fell_to: Option<f64>,
    /// Whether all came to rest.
    pub at_rest: bool,
}

impl Collapse {
    /// Angle between the direction that was asked for and that of the fall, degrees.
    pub fn deviation(&self) -> Option<f64> {
        let apart = (self.fell_to? - self.azimuth).rem_euclid(360.0);
        Some(apart.min(360.0 - apart))
    }
}

/// Brings the pile down, and lets it come to rest. `held`: how the hold before ended.
pub fn run(
    sim: &mut Simulation,
    request: Option<&CollapseRequest>,
    params: &Params,
    held: HoldOutcome,
    observer: &mut dyn Observer,
) -> Result<(HoldOutcome, Option<Collapse>), Error> {
    let Some(request) = request else { return Ok((held, None)) };
    let is_over =
        |sim: &Simulation| params.output.frames.is_some_and(|last| sim.pile.recorder.count() >= last as usize);
    while sim.seconds_so_far() < request.start.unwrap_or(0.0) && !is_over(sim) {
        sim.advance(observer, Stage::Hold, |_| 0.99)?;
    }
    let (sin, cos) = libm::sincos(request.azimuth.to_radians());
    let toward = DVec3::new(sin, 0.0, cos);
    let Some(first) = first(&sim.pile, request, toward).filter(|_| !is_over(sim)) else {
        let what = "collapse: there is no such body in the pile, or the last frame came before it; choose another \
                    body, or bake more frames";
        sim.pile.notes.push(what.into());
        return Ok((held, None));
    };
    let before: Vec<(BodyId, Pose)> = sim.pile.world.present().map(|id| (id, sim.pile.world.pose(id))).collect();
    let frame = sim.pile.recorder.count();
    sim.pile.begin_collapse();
    sim.guard.expect_pushes();
    let mut solid = solid(&mut sim.pile, first);
    let order = order(&sim.pile, &solid.joints, first, toward);
    let duration = duration(&sim.pile, request, &before);
    let speed = speed(&sim.pile, request, first);
    sim.pile.world.launch(first, toward * speed, DVec3::ZERO);
    let (mut time, mut done, mut moved_first, mut push) = (0.0, 0, Vec::new(), None);
    while !is_over(sim) && (done < order.len() || moved_first.is_empty() && time < duration + LATEST) {
        sim.advance(observer, Stage::Hold, |_| 0.99)?;
        time += sim.pile.world.step_length();
        if time >= LEAD {
            push = push.or_else(|| Some(topple(&mut sim.pile, &solid, toward)));
        }
        if moved_first.is_empty() {
            moved_first = moved(&sim.pile, &before).filter(|(_, way, _)| *way > MOVED).map(|(id, ..)| id).collect();
        }
        let due = order[done..].iter().take_while(|(when, _)| LEAD + when * duration <= time).map(|(_, joint)| *joint);
        let world = &sim.pile.world;
        let gone = |joint: &Joint| joint.bodies().any(|id| !world.is_present(id));
        let gone = (0..solid.joints.len()).filter(|&k| gone(&solid.joints[k]));
        let broken: BTreeSet<usize> = due.clone().chain(gone).filter(|&k| !solid.joints[k].is_broken).collect();
        done += due.count();
        sim.pile.break_joints(&mut solid, &broken.into_iter().collect::<Vec<_>>());
    }
    solid.end(&mut sim.pile.world, &mut sim.pile.policy);
    let last_joint_frame = sim.pile.recorder.count();
    let held = hold::run(sim, params, false, observer)?;
    let pile = &sim.pile;
    let units = pile.world.units;
    let down = |id: BodyId, from: &Pose| from.translation.y - pile.world.pose(id).translation.y;
    let came_down = before.iter().filter(|(id, from)| !pile.world.is_present(*id) || down(*id, from) > FALLEN).count();
    let all: Vec<(BodyId, f64, DVec3)> = moved(pile, &before).collect();
    let mean = all.iter().map(|(.., way)| *way).sum::<DVec3>() / all.len().max(1) as f64;
    let fell_to = (mean.length() > MOVED).then(|| libm::atan2(mean.x, mean.z).to_degrees().rem_euclid(360.0));
    let collapse = Collapse {
        first,
        moved_first,
        frame,
        last_joint_frame,
        rest_frame: pile.recorder.count(),
        joints: solid.tally.broken as usize,
        push: push.unwrap_or(0.0) * units.length / units.time,
        bodies: before.len(),
        moved: all.iter().filter(|(_, way, _)| *way > MOVED).count() + (before.len() - all.len()),
        came_down,
        azimuth: request.azimuth,
        fell_to,
        at_rest: held.at_rest,
    };
    Ok((held, Some(collapse)))
}

/// Bodies that are there, how far each has moved, and its way across gravity; d.
fn moved<'a>(pile: &'a Pile, before: &'a [(BodyId, Pose)]) -> impl Iterator<Item = (BodyId, f64, DVec3)> + 'a {
    let world = &pile.world;
    before.iter().filter(|(id, _)| world.is_present(*id)).map(|(id, from)| {
        let now = world.pose(*id);
        let way = (now.translation - from.translation) * DVec3::new(1.0, 0.0, 1.0);
        (*id, from.moved(&now, world.bodies()[*id].radius), way)
    })
}

/// The body that goes first: the one that is named, or else, of the lowest ones, the one that is farthest to the side
/// of the fall.
fn first(pile: &Pile, request: &CollapseRequest, toward: DVec3) -> Option<BodyId> {
    let world = &pile.world;
    let ids = (0..pile.instances.len()).filter(|&id| request.prop.is_none_or(|prop| pile.instances[id].prop == prop));
    if let Some(number) = request.number {
        return ids.into_iter().nth(number).filter(|&id| world.is_present(id));
    }
    let there: Vec<(BodyId, DVec3)> =
        ids.filter(|&id| world.is_present(id)).map(|id| (id, world.pose(id).translation)).collect();
    let heights = || there.iter().map(|(_, place)| place.y);
    let (low, high) = (heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max));
    let lowest = there.iter().filter(|(_, place)| place.y <= low + LOW * (high - low));
    lowest.max_by(|(a, p), (b, q)| p.dot(toward).total_cmp(&q.dot(toward)).then(b.cmp(a))).map(|(id, _)| *id)
}

/// From now on, all that touches is one solid, but for the first body, the ground, and what is placed to stay.
fn solid(pile: &mut Pile, first: BodyId) -> PileGlue {
    let sites = Sites::new(&pile.world, None, false, &BTreeSet::new());
    let moves = |id: BodyId| id != first && pile.world.bodies()[id].role != Role::Pinned;
    let joints = (0..sites.between.len())
        .filter(|&site| matches!(sites.between[site], (a, PairSide::Body(b)) if moves(a) && moves(b)))
        .map(|site| sites.joint(site, DVec3::ZERO, DVec3::ZERO, f64::INFINITY, 1.0));
    let solid = PileGlue::new(joints.collect(), false, &mut pile.world, &mut pile.policy);
    // Its contacts with the ground.
    pile.world.zero_step();
    solid
}

/// Pushes each solid that is higher than the part of its foot on the side of the fall is wide, so that it topples over
/// that edge. Returns the largest push, as the speed of a center of mass, d per characteristic time.
fn topple(pile: &mut Pile, solid: &PileGlue, toward: DVec3) -> f64 {
    let world = &pile.world;
    let axis = DVec3::Y.cross(toward);
    let pairs = world.contact_pairs(REAL_CONTACT);
    let feet = |members: &[BodyId]| {
        let stands = |side: PairSide| matches!(side, PairSide::Ground | PairSide::Scenery);
        let own = pairs.iter().filter(|pair| stands(pair.b) && members.binary_search(&pair.a).is_ok());
        let points = own.flat_map(|pair| pair.points.iter().map(|point| point.point));
        points.max_by(|p, q| p.dot(toward).total_cmp(&q.dot(toward)))
    };
    let mut pushes: Vec<(BodyId, DVec3, f64)> = Vec::new();
    let mut largest = 0.0f64;
    for members in solid.clusters() {
        let Some(edge) = feet(members) else { continue };
        let of =
            |id: &BodyId| (world.bodies()[*id].mass, world.pose(*id).translation - edge, world.bodies()[*id].radius);
        let mass: f64 = members.iter().map(|id| of(id).0).sum();
        let center = members.iter().map(of).map(|(m, r, _)| m * r).sum::<DVec3>() / mass;
        let (width, height) = (-center.dot(toward), center.y);
        if width <= 0.0 || width >= height {
            continue;
        }
        // About the edge; each body as a ball of its own radius.
        let inertia: f64 = members
            .iter()
            .map(of)
            .map(|(m, r, own)| m * (r.reject_from(axis).length_squared() + 0.4 * own * own))
            .sum();
        let arm = libm::hypot(width, height);
        let raise = arm - height;
        let spin = SURE * (2.0 * mass * raise / inertia).sqrt();
        largest = largest.max(spin * arm);
        pushes.push((members[0], edge, spin));
    }
    for (id, edge, spin) in pushes {
        pile.world.spin(id, edge, axis * spin);
    }
    largest
}

/// The joints in the order in which they break, and when, 0 to 1.
fn order(pile: &Pile, joints: &[Joint], first: BodyId, toward: DVec3) -> Vec<(f64, usize)> {
    let from = pile.world.pose(first).translation;
    let joints = joints.iter().enumerate();
    let mut order: Vec<(f64, usize)> = joints
        .map(|(number, joint)| {
            let way = joint.point - from;
            (way.length() - AHEAD * way.dot(toward), number)
        })
        .collect();
    let last = order.iter().map(|(when, _)| *when).fold(f64::MIN_POSITIVE, f64::max);
    order.iter_mut().for_each(|(when, _)| *when /= last);
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    order
}

/// The speed that the first body gets, m/s: unless given, that of a fall by half its diameter.
fn speed(pile: &Pile, request: &CollapseRequest, first: BodyId) -> f64 {
    let units = pile.world.units;
    let falls = (2.0 * pile.world.bodies()[first].radius).sqrt() * units.length / units.time;
    request.speed.unwrap_or(falls)
}

/// The time from the first joint to the last, characteristic times; unless given, [`FRONT`].
fn duration(pile: &Pile, request: &CollapseRequest, before: &[(BodyId, Pose)]) -> f64 {
    let heights = || before.iter().map(|(_, pose)| pose.translation.y);
    let height = heights().fold(f64::NEG_INFINITY, f64::max) - heights().fold(f64::INFINITY, f64::min);
    let falls = FRONT * (2.0 * height.max(0.0)).sqrt();
    request.duration.map_or(falls, |seconds| seconds / pile.world.units.time)
}
