//! Keep: bodies of an earlier pile whose surroundings did not change stay where they lie, and the fill replaces the
//! others around them.
//!
//! A kept body starts at its earlier pose: that of the last frame, where control or glue hold the shape, or the pile
//! settles before frame 0; else that of frame 0, since its motion may reach everywhere. The fill has it as a fixed
//! obstacle; from turning over on it is a body like the others. Where it comes to rest within [`STAYS`] of its earlier
//! pose, it is delivered there, to the last bit; else it counts as moved.

use crate::report::bake::BakedBody;
use cairn_engine::shape::{Shape, corners};
use cairn_engine::units::Units;
use cairn_engine::world::BodyId;
use cairn_geometry::pose::Pose;
use cairn_input::earlier::{EarlierBody, EarlierDot, EarlierPile, EarlierProp};
use cairn_input::params::Params;
use cairn_input::scene::Scene;
use cairn_motion::glue::sites::{KnownGlue, KnownJoint};
use cairn_motion::instance::Instance;
use cairn_motion::pile::Pile;
use cairn_prepare::changes::Changes;
use cairn_prepare::check::CheckedScene;
use cairn_prepare::container::Container;
use cairn_prepare::effects::{EffectName, Resolved};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// A kept body that is within this of its earlier pose at every moment, d, stands there: what moved it is the sag of
/// the simulated pile between the earlier rest and this one, of which the trial of glue lets as much pass in the mean
/// ([`crate::glue::policy::SAGS`]). A beam of 205 bricks that nothing changed sinks by up to 0.03 when it is released
/// again; with 0.025, 15 of them counted as moved.
pub const STAYS: f64 = 0.06;
/// A body's corner may be this much farther outside the shape than the fill lets it, d, to be kept: since then, the
/// pile has moved a little.
const SLACK: f64 = 0.3;
/// Edge of the cells in which places of the region differ, d, and at least this share of the container.
const CELL: f64 = 0.25;
const FINEST: f64 = 1.0 / 250.0;

/// What stays of an earlier pile, and where the fill adds to it. Engine units.
pub struct Kept {
    /// The bodies that stay: obstacles of the fill, and the first bodies of the pile.
    pub instances: Vec<Instance>,
    /// The body of the earlier pile that each of them is.
    pub origins: Vec<usize>,
    /// Bodies whose prop was replaced, with the new one: the fill lets them grow first.
    pub exchanged: Vec<Instance>,
    /// They start at the poses of frame 0.
    pub from_first: bool,
    /// Number of the earlier bodies, and the first number that no name of them has.
    pub earlier: usize,
    pub next_number: usize,
    region: Option<Region>,
}

/// The places where the fill adds bodies: near what is new, or away from all kept bodies.
struct Region {
    /// The first cell, and the number of cells along each axis.
    low: [i32; 3],
    size: [usize; 3],
    /// Their edge, d.
    edge: f64,
    /// Shape `[z][y][x]`.
    is_open: Vec<bool>,
    /// Share of the room that is open.
    share: f64,
}

impl Kept {
    /// `None` without an earlier pile, or where nothing is filled.
    pub fn new(
        scene: &Scene,
        params: &Params,
        checked: &CheckedScene,
        resolved: &Resolved,
        shapes: &[Shape],
        units: Units,
        container: Option<&Container>,
    ) -> Option<Kept> {
        let (earlier, container) = (scene.earlier.as_ref()?, container?);
        let ground = params.ground.then_some(checked.ground);
        let changes = Changes::new(earlier, scene, ground, checked.diameter);
        let holds = resolved.is_on(EffectName::Glue) || resolved.is_on(EffectName::Control);
        let from_first = !holds && !params.output.settled.is_on(checked.rides);
        let outside = params.fill.protrusion + params.fill.outside() + SLACK;
        let (mut instances, mut origins, mut exchanged) = (Vec::new(), Vec::new(), Vec::new());
        for (index, body) in earlier.bodies.iter().enumerate() {
            let pose = if from_first { body.first } else { body.last };
            let stays = |prop: usize| {
                let [low, high] = scene.props[prop].scale;
                let shape = &shapes[prop];
                let is_of_size = (low * (1.0 - ROUNDING)..=high * (1.0 + ROUNDING)).contains(&body.scale);
                let instance = engine_instance(prop, body.scale, &pose, shape, units);
                let center = units.point_to_si(instance.pose.translation);
                let size = body.scale / units.length;
                let fits = container.distance.signed_distance(instance.pose.translation) <= params.fill.outside()
                    && !container.is_solid_at(instance.pose.translation)
                    && corners(shape, size, &instance.pose)
                        .all(|p| container.shell().signed_distance(p).max(container.base - p.y) <= outside);
                (is_of_size && fits && !changes.is_near(center)).then_some(instance)
            };
            match body.prop {
                EarlierProp::Same(prop) => {
                    if let Some(instance) = stays(prop) {
                        instances.push(instance);
                        origins.push(index);
                    }
                }
                EarlierProp::Replaced(prop) if scene.props[prop].weight > 0.0 => {
                    let (scale, pose) = exchange(earlier, body, scene.props[prop].scale, &shapes[prop], &pose);
                    let instance = engine_instance(prop, scale, &pose, &shapes[prop], units);
                    let is_near = changes.is_near(units.point_to_si(instance.pose.translation));
                    exchanged.extend((!is_near).then_some(instance));
                }
                EarlierProp::Replaced(_) | EarlierProp::Gone => {}
            }
        }
        let wanted = params.fill.count.unwrap_or(u32::MAX).min(params.fill.max_bodies) as usize;
        if scene.piles.is_empty() && instances.len() > wanted {
            keep_lowest(&mut instances, &mut origins, wanted);
        }
        let is_whole = changes.is_empty() && instances.len() == earlier.bodies.len();
        let region = (!earlier.refills).then(|| match is_whole {
            true => Region::closed(),
            false => Region::new(&changes, &instances, shapes, units, container),
        });
        let next_number = earlier.bodies.iter().map(|body| body.number + 1).max().unwrap_or(0);
        let earlier = earlier.bodies.len();
        Some(Kept { instances, origins, exchanged, from_first, earlier, next_number, region })
    }

    /// Whether the fill may add a body here; engine units.
    pub fn is_open(&self, p: DVec3) -> bool {
        self.region.as_ref().is_none_or(|region| region.contains(p))
    }

    /// Bodies that a fill of this container may add, where it is expected to take so many when empty.
    pub fn expected(&self, container: &Container, all: usize) -> usize {
        let left = all.saturating_sub(self.inside(container)) as f64;
        let open = self.region.as_ref().map_or(left, |region| region.share * all as f64);
        (open.max(LEAST_LEFT * left).ceil() as usize).max(1)
    }

    /// Number of the kept bodies whose centres are in a container.
    pub fn inside(&self, container: &Container) -> usize {
        let is_inside = |body: &&Instance| container.distance.signed_distance(body.pose.translation) <= 0.0;
        self.instances.iter().filter(is_inside).count()
    }
}

/// Where the open room is small, the fill may still add this share of what is left to the expected number.
const LEAST_LEFT: f64 = 0.05;
/// What rounding does to a scale, as a share of it.
const ROUNDING: f64 = 1e-9;

fn engine_instance(prop: usize, scale: f64, pose: &Pose, shape: &Shape, units: Units) -> Instance {
    Instance { prop, scale, pose: units.pose_to_engine(&shape.body_pose(pose, scale)) }
}

/// Scale and pose of a body of a replaced prop with the new one: about the same centre, at the same share of the range
/// of scales.
fn exchange(
    earlier: &EarlierPile,
    body: &EarlierBody,
    [low, high]: [f64; 2],
    shape: &Shape,
    pose: &Pose,
) -> (f64, Pose) {
    let scales = earlier.bodies.iter().filter(|other| other.prop == body.prop).map(|other| other.scale);
    let (least, most) = scales.fold((f64::INFINITY, 0.0f64), |(low, high), s| (low.min(s), high.max(s)));
    let share = if most > least { (body.scale - least) / (most - least) } else { 0.5 };
    let scale = low + share * (high - low);
    // The old shape is unknown: its origin stands for its centre.
    (scale, Pose { translation: pose.translation - pose.rotation * (shape.center * scale), ..*pose })
}

/// Takes out the highest bodies until this many are left: little rests on them.
fn keep_lowest(instances: &mut Vec<Instance>, origins: &mut Vec<usize>, count: usize) {
    let mut order: Vec<usize> = (0..instances.len()).collect();
    let height = |i: usize| instances[i].pose.translation.y;
    order.sort_by(|&a, &b| height(a).total_cmp(&height(b)).then(a.cmp(&b)));
    order.truncate(count);
    order.sort_unstable();
    *instances = order.iter().map(|&i| instances[i]).collect();
    *origins = order.iter().map(|&i| origins[i]).collect();
}

impl Region {
    /// No place: all is as it was.
    fn closed() -> Region {
        Region { low: [0; 3], size: [0; 3], edge: CELL, is_open: Vec::new(), share: 0.0 }
    }

    fn new(changes: &Changes, kept: &[Instance], shapes: &[Shape], units: Units, container: &Container) -> Region {
        let edge = CELL.max(FINEST * (container.high - container.low).max_element());
        let low = cell(container.low - edge, edge);
        let high = cell(container.high + edge, edge);
        let size = [0, 1, 2].map(|k| (high[k] - low[k] + 1).max(1) as usize);
        let middle = |i: usize| {
            let at = [i % size[0], i / size[0] % size[1], i / size[0] / size[1]];
            let place = [0, 1, 2].map(|k| (f64::from(low[k]) + at[k] as f64 + 0.5) * edge);
            DVec3::from_array(place)
        };
        let count = size.iter().product::<usize>();
        let near = (0..count).into_par_iter().map(|i| changes.is_near(units.point_to_si(middle(i))));
        let near: Vec<bool> = near.collect();
        let mut is_open = vec![true; count];
        for body in kept {
            let (center, radius) = (body.pose.translation, shapes[body.prop].radius * body.scale / units.length);
            let (from, to) = (cell(center - radius, edge), cell(center + radius, edge));
            let range =
                |k: usize| (from[k] - low[k]).max(0) as usize..((to[k] - low[k] + 1).max(0) as usize).min(size[k]);
            for z in range(2) {
                for y in range(1) {
                    for x in range(0) {
                        let i = (z * size[1] + y) * size[0] + x;
                        is_open[i] &= middle(i).distance_squared(center) > radius * radius;
                    }
                }
            }
        }
        is_open.iter_mut().zip(near).for_each(|(open, near)| *open |= near);
        let room: Vec<usize> = (0..count).filter(|&i| container.distance.signed_distance(middle(i)) <= 0.0).collect();
        let open = room.iter().filter(|&&i| is_open[i]).count();
        let share = open as f64 / room.len().max(1) as f64;
        Region { low, size, edge, is_open, share }
    }

    fn contains(&self, p: DVec3) -> bool {
        let at = cell(p, self.edge);
        let place = [0, 1, 2].map(|k| usize::try_from(at[k] - self.low[k]).ok().filter(|i| *i < self.size[k]));
        let [Some(x), Some(y), Some(z)] = place else { return false };
        self.is_open[(z * self.size[1] + y) * self.size[0] + x]
    }
}

fn cell(p: DVec3, edge: f64) -> [i32; 3] {
    (p / edge).floor().as_ivec3().to_array()
}

/// What became of the bodies of an earlier pile.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Bodies that are delivered at their earlier poses: their ids, and those poses, SI, from the prop's own frame.
    pub delivered: Vec<(BodyId, Pose)>,
    /// Bodies that were to stay, and did not.
    pub moved: usize,
    /// Bodies of the fill that are no earlier ones.
    pub added: usize,
    /// Earlier bodies that are no longer there.
    pub gone: usize,
    /// The delivered poses are those of frame 0 alone.
    pub from_first: bool,
    /// The number in the name of each body of the pile.
    pub numbers: Vec<usize>,
}

impl Outcome {
    /// The bodies that are delivered at their earlier poses, ascending.
    pub fn ids(&self) -> impl Iterator<Item = BodyId> {
        self.delivered.iter().map(|(id, _)| *id)
    }

    /// Gives the bodies their names' numbers, and those that stay their earlier poses to the bit.
    pub fn apply(&self, bodies: &mut [BakedBody], frames: &mut [Vec<Pose>]) {
        bodies.iter_mut().zip(&self.numbers).for_each(|(body, number)| body.number = *number);
        let count = if self.from_first { 1 } else { frames.len() };
        for frame in frames.iter_mut().take(count) {
            for &(id, pose) in &self.delivered {
                frame[id] = pose;
            }
        }
    }

    /// Share of the bodies that were to stay that do.
    pub fn stayed(&self) -> Option<f64> {
        let all = self.delivered.len() + self.moved;
        (all > 0).then(|| self.delivered.len() as f64 / all as f64)
    }
}

/// Where nearly all bodies of a pile are of an earlier one, its joints are a start: the search of glue begins with them
/// from this share on. With 0.6 of the bodies of a man of sticks, it found 486 joints instead of 373, and took longer;
/// with all, 307 instead of 328, in two thirds of the time.
const MOSTLY: f64 = 0.95;

/// A body that has no new body, and none that is gone, within this distance of its centre, d, is as it was: the glue
/// there stays.
const NEAR: f64 = 1.5;

/// The glue of an earlier pile between bodies that stay.
pub fn glue(kept: &Kept, earlier: &EarlierPile, pile: &Pile) -> KnownGlue {
    let mut ids: Vec<Option<BodyId>> = vec![None; earlier.bodies.len()];
    for (id, &place) in pile.places.iter().enumerate().filter(|(_, place)| **place < kept.origins.len()) {
        ids[kept.origins[place]] = Some(id);
    }
    let stay: BTreeSet<BodyId> = ids.iter().flatten().copied().collect();
    if earlier.dots.is_empty() {
        return KnownGlue::default();
    }
    let cell = |p: DVec3| (p / NEAR).floor().as_ivec3().to_array();
    let mut others: BTreeMap<[i32; 3], Vec<DVec3>> = BTreeMap::new();
    let gone = earlier.bodies.iter().zip(&ids).filter(|(_, id)| id.is_none());
    let gone = gone.map(|(body, _)| pile.world.units.point_to_engine(body.last.translation));
    let new = (0..pile.instances.len()).filter(|id| !stay.contains(id)).map(|id| pile.instances[id].pose.translation);
    gone.chain(new).for_each(|p| others.entry(cell(p)).or_default().push(p));
    let is_still = |&id: &BodyId| {
        let p = pile.instances[id].pose.translation;
        let [x, y, z] = cell(p);
        let near = |at: [i32; 3]| others.get(&at).is_some_and(|all| all.iter().any(|q| q.distance(p) <= NEAR));
        !(-1..=1).any(|i| (-1..=1).any(|j| (-1..=1).any(|k| near([x + i, y + j, z + k]))))
    };
    let still = stay.iter().copied().filter(is_still).collect();
    let is_start = stay.len() as f64 >= MOSTLY * pile.instances.len() as f64;
    let units = pile.world.units;
    let force = units.mass * units.length / (units.time * units.time);
    let joint = |dot: &EarlierDot| {
        let body = ids[dot.body]?;
        let other = match dot.other {
            Some(other) => Some(ids[other]?),
            None => None,
        };
        let (force, moment) = (dot.force / force, dot.moment / (force * units.length));
        Some(KnownJoint { bodies: (body, other), force, moment })
    };
    KnownGlue { joints: earlier.dots.iter().filter_map(joint).collect(), still, is_start }
}

/// Puts the kept bodies that stand where they were to their earlier poses, in the world and in all frames. Bodies that
/// are glued to each other are one: they stand together or not, and new ones go with the earlier ones that they hold.
pub fn deliver(kept: &Kept, earlier: &EarlierPile, pile: &mut Pile) -> Outcome {
    let count = pile.instances.len();
    let mut outcome = Outcome { from_first: kept.from_first, ..Outcome::default() };
    let mut next = kept.next_number;
    let place = |pile: &Pile, id: BodyId| pile.places.get(id).copied().filter(|place| *place < kept.instances.len());
    for id in 0..count {
        outcome.numbers.push(match place(pile, id) {
            Some(place) => earlier.bodies[kept.origins[place]].number,
            None => {
                next += 1;
                next - 1
            }
        });
    }
    let mut groups: Vec<Vec<BodyId>> = pile.glue.clusters().map(<[BodyId]>::to_vec).collect();
    let grouped: BTreeSet<BodyId> = groups.iter().flatten().copied().collect();
    groups.extend((0..count).filter(|id| !grouped.contains(id)).map(|id| vec![id]));
    let mut has_put = false;
    for group in groups {
        let members: Vec<(BodyId, usize)> =
            group.iter().filter_map(|&id| place(pile, id).map(|place| (id, place))).collect();
        let Some(&(first, first_place)) = members.first() else { continue };
        let stands = members.iter().all(|&(id, place)| {
            let (pose, radius) = (kept.instances[place].pose, pile.world.bodies()[id].radius);
            let stays = |now: &Pose| now.moved(&pose, radius) <= STAYS;
            match kept.from_first {
                true => pile.recorder.frames.first().and_then(|frame| frame.get(id)).is_some_and(stays),
                false => pile.world.is_present(id) && pile.recorder.always(id, stays),
            }
        });
        if !stands {
            outcome.moved += members.len();
            continue;
        }
        let pose = |body: &EarlierBody| if kept.from_first { body.first } else { body.last };
        outcome.delivered.extend(members.iter().map(|&(id, place)| (id, pose(&earlier.bodies[kept.origins[place]]))));
        if !kept.from_first {
            has_put = true;
            pile.world.put_carrier(first, &kept.instances[first_place].pose);
            group.iter().for_each(|&id| pile.recorder.stay(id));
        }
    }
    if has_put {
        pile.world.zero_step();
    }
    outcome.delivered.sort_by_key(|(id, _)| *id);
    let kept_there = outcome.delivered.len() + outcome.moved;
    outcome.added = pile.places.len() - kept_there;
    outcome.gone = kept.earlier - kept_there;
    outcome
}
