//! Small moves with which a pile stands that does not: what floats comes down, and what leans out over its support
//! moves back over it, each with all that it carries.
//!
//! A move is by the geometry of the support, and proven by the statics of the pile that it makes: the moves that are
//! reported are those with which the fewest bodies fall.

use super::{AnalysisOptions, Going, PileContacts, own, part, standing};
use cairn_engine::world::{BodyId, PairSide, World};
use cairn_geometry::pose::Pose;
use cairn_geometry::rectangle::convex_hull;
use cairn_input::error::Error;
use glam::{DVec2, DVec3};
use std::collections::{BTreeMap, BTreeSet};

/// Rounds of moves: what is carried moves after what carries it.
const ROUNDS: usize = 8;
/// They end after so many in a row that help nobody.
const STALE: usize = 2;
/// A body moves by at most this, in its radius: more is no nudge.
const FARTHEST: f64 = 1.0;
/// A contact carries from below if its normal rises at least so.
const CARRIES: f64 = 0.3;
/// The center of mass comes so far inside its support, in the body's radius, where the support is that wide.
const INSIDE: f64 = 0.05;
/// What comes down stops at this gap, in its thickness, and in so many steps.
const STOPS: f64 = 1e-3;
const STEPS: usize = 60;

/// A move of a body, m.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Nudge {
    pub body: usize,
    pub by: [f64; 3],
}

/// The moves, ascending by body, and the bodies that fall even so.
#[derive(Default)]
pub struct Nudged {
    pub nudges: Vec<Nudge>,
    pub falls: Vec<usize>,
}

/// Moves bodies of a world until they stand, as far as such moves are found. `pile`: as it is, with those that
/// fall.
pub(super) fn of(
    world: &mut World,
    mut pile: PileContacts,
    falls: Vec<BodyId>,
    options: &AnalysisOptions,
    going: &mut Going,
) -> Result<Nudged, Error> {
    let begin: BTreeMap<BodyId, Pose> = world.present().map(|id| (id, world.pose(id))).collect();
    let mut best = Nudged { nudges: Vec::new(), falls: falls.clone() };
    let (mut now, mut stale, mut is_proven) = (falls, 0, true);
    for round in 0..ROUNDS {
        going.on(0.9 + 0.1 * round as f64 / ROUNDS as f64)?;
        if !shift(world, &pile, &now, &begin, options.gap) {
            break;
        }
        pile = PileContacts::new(world, options.gap);
        let before = now.len();
        // A large pile is looked at as a whole once, in the end.
        is_proven = pile.pairs.len() <= part::LARGE;
        now = if is_proven { falling(&pile, options, going)? } else { standing::falling_alone(&pile) };
        if is_proven && now.len() < best.falls.len() {
            best = Nudged { nudges: moved(world, &begin), falls: now.clone() };
        }
        stale = if now.len() < before { 0 } else { stale + 1 };
        if now.is_empty() || stale == STALE {
            break;
        }
    }
    if !is_proven {
        now = falling(&pile, options, going)?;
        if now.len() < best.falls.len() {
            best = Nudged { nudges: moved(world, &begin), falls: now };
        }
    }
    Ok(best)
}

/// The bodies that fall, by the statics of the whole.
fn falling(pile: &PileContacts, options: &AnalysisOptions, going: &mut Going) -> Result<Vec<BodyId>, Error> {
    let own = own::of(pile, going)?;
    let found = standing::of(pile, &own, options.friction_share, going)?;
    Ok(pile.named(&found.falls))
}

fn moved(world: &World, begin: &BTreeMap<BodyId, Pose>) -> Vec<Nudge> {
    let moved = |(&id, from): (&BodyId, &Pose)| {
        let by = world.pose(id).translation - from.translation;
        let by = (by * world.units.length).to_array();
        (by != [0.0; 3]).then_some(Nudge { body: id, by })
    };
    begin.iter().filter_map(moved).collect()
}

/// Moves those of these bodies for which a move is found; false: none.
fn shift(
    world: &mut World,
    pile: &PileContacts,
    falls: &[BodyId],
    begin: &BTreeMap<BodyId, Pose>,
    tolerance: f64,
) -> bool {
    let supports = Supports::new(pile);
    let mut order = falls.to_vec();
    let height = |id: BodyId| world.pose(id).translation.y;
    order.sort_by(|&a, &b| height(a).total_cmp(&height(b)).then(a.cmp(&b)));
    let mut moves: BTreeMap<BodyId, DVec3> = BTreeMap::new();
    for id in order {
        let group = supports.carried_by(id);
        if group.iter().any(|one| moves.contains_key(one)) {
            continue;
        }
        let by = match supports.below.get(&id) {
            Some(points) => back_over(world, id, &group, points),
            None => down(world, id, &group),
        };
        let Some(by) = by else { continue };
        let is_near = |one: &BodyId| {
            let way = world.pose(*one).translation + by - begin[one].translation;
            way.length() <= FARTHEST * world.bodies()[*one].radius
        };
        if group.iter().all(is_near) && group.iter().all(|&one| is_free(world, one, by, &group, tolerance)) {
            moves.extend(group.into_iter().map(|one| (one, by)));
        }
    }
    for (&id, &by) in &moves {
        let pose = world.pose(id);
        world.put(id, &Pose { translation: pose.translation + by, ..pose });
    }
    world.zero_step();
    !moves.is_empty()
}

/// What carries each body from below.
struct Supports {
    /// Places of the contacts, across gravity; absent for what floats.
    below: BTreeMap<BodyId, Vec<DVec2>>,
    /// The bodies of these contacts; `None`: what stands still.
    carriers: BTreeMap<BodyId, BTreeSet<Option<BodyId>>>,
}

impl Supports {
    fn new(pile: &PileContacts) -> Supports {
        let mut supports = Supports { below: BTreeMap::new(), carriers: BTreeMap::new() };
        for c in &pile.contacts {
            let ends = [(Some(c.body), c.other, c.normal), (c.other, Some(c.body), -c.normal)];
            for (carried, by, normal) in ends {
                let Some(carried) = carried.filter(|_| normal.y >= CARRIES).map(|k| pile.ids[k]) else { continue };
                supports.below.entry(carried).or_default().push(DVec2::new(c.point.x, c.point.z));
                supports.carriers.entry(carried).or_default().insert(by.map(|k| pile.ids[k]));
            }
        }
        supports
    }

    /// A body, and all that nothing else carries; ascending.
    fn carried_by(&self, id: BodyId) -> BTreeSet<BodyId> {
        let mut group = BTreeSet::from([id]);
        loop {
            let rests_on = |by: &BTreeSet<Option<BodyId>>| by.iter().all(|by| by.is_some_and(|by| group.contains(&by)));
            let more: Vec<BodyId> = (self.carriers.iter())
                .filter(|(one, by)| !group.contains(*one) && rests_on(by))
                .map(|(&one, _)| one)
                .collect();
            if more.is_empty() {
                return group;
            }
            group.extend(more);
        }
    }
}

/// The move that brings the common center of mass over the support.
fn back_over(world: &World, id: BodyId, group: &BTreeSet<BodyId>, points: &[DVec2]) -> Option<DVec3> {
    let mass: f64 = group.iter().map(|&one| world.bodies()[one].mass).sum();
    let center: DVec3 = group.iter().map(|&one| world.bodies()[one].mass * world.pose(one).translation).sum();
    let center = DVec2::new(center.x, center.z) / mass;
    let middle = points.iter().sum::<DVec2>() / points.len() as f64;
    let nearest = nearest_inside(points, center);
    // On the way to the middle; no farther than that.
    let rest = middle - nearest;
    let inward = rest * (INSIDE * world.bodies()[id].radius / rest.length().max(f64::MIN_POSITIVE)).min(1.0);
    let by = nearest + inward - center;
    let is_outside = nearest.distance(center) > 1e-9;
    is_outside.then_some(DVec3::new(by.x, 0.0, by.y))
}

/// The point of the convex hull of some points that is nearest to another.
fn nearest_inside(points: &[DVec2], to: DVec2) -> DVec2 {
    let corners = convex_hull(points);
    let edges = || corners.iter().zip(corners.iter().cycle().skip(1));
    if corners.len() > 2 && edges().all(|(a, b)| (*b - *a).perp_dot(to - *a) >= 0.0) {
        return to;
    }
    let on = |(&a, &b): (&DVec2, &DVec2)| {
        let along = b - a;
        let share = (to - a).dot(along) / along.length_squared().max(f64::MIN_POSITIVE);
        a + along * share.clamp(0.0, 1.0)
    };
    let nearer = |best: DVec2, one: DVec2| if one.distance(to) < best.distance(to) { one } else { best };
    edges().map(on).reduce(nearer).unwrap_or(to)
}

/// The way down to the first thing below.
fn down(world: &World, id: BodyId, group: &BTreeSet<BodyId>) -> Option<DVec3> {
    let body = &world.bodies()[id];
    let (pose, reach) = (world.pose(id), FARTHEST * body.radius);
    let box_of = DVec3::splat(body.radius);
    let (low, high) = (pose.translation - box_of - DVec3::Y * reach, pose.translation + box_of);
    let is_other = |side: PairSide| !matches!(side, PairSide::Body(other) if group.contains(&other));
    let obstacles: Vec<_> = world.obstacles(id, low, high).into_iter().filter(|o| is_other(o.side)).collect();
    let mut way = 0.0;
    for _ in 0..STEPS {
        let at = Pose { translation: pose.translation - DVec3::Y * way, ..pose };
        let gap = obstacles.iter().filter_map(|o| world.gap_at(id, &at, o, reach)).reduce(f64::min)?;
        if gap <= STOPS * body.thickness {
            break;
        }
        way += gap - 0.5 * STOPS * body.thickness;
        if way > reach {
            return None;
        }
    }
    (way > 0.0).then_some(DVec3::NEG_Y * way)
}

/// Whether a body overlaps nothing after a move that does not move too, more than before.
fn is_free(world: &World, id: BodyId, by: DVec3, group: &BTreeSet<BodyId>, tolerance: f64) -> bool {
    let body = &world.bodies()[id];
    let pose = world.pose(id);
    let then = Pose { translation: pose.translation + by, ..pose };
    let reach = DVec3::splat(body.radius) + by.abs();
    let others = world.obstacles(id, pose.translation - reach, pose.translation + reach);
    others.iter().filter(|o| !matches!(o.side, PairSide::Body(other) if group.contains(&other))).all(|obstacle| {
        let depth = |pose: &Pose| (-world.gap_at(id, pose, obstacle, body.radius).unwrap_or(0.0)).max(0.0);
        depth(&then) <= depth(&pose).max(tolerance * body.thickness)
    })
}
