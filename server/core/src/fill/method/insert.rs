//! The `insert` fill: props are put at free places inside the closed container at a fraction of their size and grow
//! there, while upward gravity packs them. Denser and more even than a pour, and it reaches under overhangs.

use super::{Method, Pass};
use crate::fill::filling::Filling;
use cairn_engine::shape::corners;
use cairn_engine::world::{BodyId, ReservedPlaces};
use cairn_geometry::pose::Pose;
use cairn_input::error::Error;
use cairn_input::observer::Observer;
use cairn_motion::instance::Instance;
use glam::{DQuat, DVec3};
use rand::RngExt;
use std::collections::BTreeMap;

/// A container this high, in d, is filled under full gravity; a higher one under less, so that bodies at its end are
/// squeezed no more.
const TALL: f64 = 6.0;
/// Size at insertion, as a share of the full size.
const SEED_SCALE: f64 = 0.4;
/// Where overlaps are to be removed, props grow beyond their full size by this share, and shrink to it once the
/// container is full: most overlaps vanish, and the rest can part in the room that this makes. With less, a full
/// container leaves no such room; with more, the pile is less dense and keeps its shape less well.
const OVERGROWTH: f64 = 0.02;
/// A seed grows to its full size in equal stages of about this length, characteristic times.
const GROWTH_STAGE: f64 = 0.2;
/// Places tried for each prop wanted in a round. A place costs a thousandth of a prop that grows there.
const TRIES_PER_PROP: usize = 60;
/// Places tried at least in a round.
const LEAST_TRIES: usize = 1000;
/// Bound on the rounds; a fill takes about 15.
const MAX_ROUNDS: usize = 200;
/// A body that grows may overlap another by this share of the thinner one's thickness: both may yet give way.
const GROWING_OVERLAP: f64 = 0.25;

/// A body that reaches into scenery by more than this share of its thickness passes to the other side.
const PASSES: f64 = 0.5;

/// Rounds in a row after which a pair that overlaps too deeply is jammed: the next round may still ease a squeezed
/// pair.
const JAMMED: u32 = 3;

/// If at most the first share of a round's seeds finds room to grow, they take it from each other: the next round has
/// half as many, but at least the second share of a full round.
const CROWDED: f64 = 0.5;
const LEAST_ROUND: f64 = 0.25;
/// A round makes up for the losses of the last one: it asks for more than is missing, but counts on no smaller share of
/// its seeds than this.
const LEAST_KEPT: f64 = 0.25;
/// A round of fewer seeds than this does not show that the container is full: one may have been unlucky.
const LEAST_SEEDS: usize = 20;
/// Where every seed of a round finds a place, a draft is not full yet, unless the round adds less than this share. (The
/// seeds of a large round take the room from each other; the next one is smaller.)
const ROOM_BELOW: f64 = 0.05;

pub struct Insert;

impl Method for Insert {
    fn gravity(&self, height: f64) -> f64 {
        (TALL / height).min(1.0)
    }

    /// Runs rounds until they add next to nothing.
    fn run(&mut self, filling: &mut Filling, pass: &Pass, observer: &mut dyn Observer) -> Result<bool, Error> {
        let (fill, expected) = (&filling.task.params.fill, filling.task.expected as f64);
        let deep = fill.overlap.max(GROWING_OVERLAP);
        let inside = filling.task.inside();
        // Share of the expected bodies that a round asks for.
        let mut share = fill.round;
        // Share of the last round's seeds that were kept.
        let mut keeps: f64 = 1.0;
        // Bodies asked for so far, and bodies there, before each round.
        let mut history = vec![(0, filling.world.loose().count())];
        // Pairs that overlap too deeply, and for how many rounds in a row.
        let mut squeezed = BTreeMap::<(BodyId, BodyId), u32>::new();
        let mut quota = Quota::new(filling, pass);
        for _ in 0..MAX_ROUNDS {
            let before = filling.world.loose().count();
            if before >= pass.limit {
                return Ok(false);
            }
            let missing = ((pass.limit - before) as f64 / keeps.max(LEAST_KEPT)).ceil();
            let wanted = (share * expected).ceil().min(missing) as usize;
            let first = filling.world.next_id();
            let seeds = plant(filling, pass, wanted, &inside, &mut quota)?;
            if seeds.is_empty() {
                return Ok(true);
            }
            grow(filling, &seeds, observer)?;
            filling.remove_escaped();
            let overlapping = filling.world.overlapping(deep).into_iter();
            let (new, old): (Vec<_>, Vec<_>) = overlapping.partition(|&(_, b)| b >= first);
            filling.remove_overlapping(new, first);
            let rounds = |pair| squeezed.get(&pair).map_or(1, |rounds| rounds + 1);
            squeezed = old.into_iter().map(|pair| (pair, rounds(pair))).collect();
            let jammed = squeezed.iter().filter(|(_, rounds)| **rounds >= JAMMED).map(|(pair, _)| *pair);
            filling.remove_overlapping(jammed.collect(), 0);
            filling.remove_cutting(PASSES);
            filling.cut_to(pass.limit, first);
            filling.world.validate(pass.limit);
            let kept = filling.world.loose().filter(|&id| id >= first).count();
            let after = filling.world.loose().count();
            keeps = kept as f64 / seeds.len() as f64;
            if keeps < CROWDED && after < pass.limit {
                share = (share / 2.0).max(LEAST_ROUND * fill.round);
            }
            let asked = wanted + history.last().map_or(0, |&(asked, _)| asked);
            history.push((asked, after));
            // Jammed props trade places: a small round adds some and squeezes others out. So as many seeds count as a
            // full round asks for.
            let full_round = ((fill.round * expected).ceil() as usize).max(LEAST_SEEDS);
            let below = if seeds.len() == wanted { fill.full_below.min(ROOM_BELOW) } else { fill.full_below };
            let least = (below * after as f64).max(1.0);
            let then = history.iter().rev().find(|(earlier, _)| earlier + full_round <= asked);
            if then.is_some_and(|&(_, then)| (after as f64) < then as f64 + least) {
                return Ok(true);
            }
        }
        Ok(false)
    }
}

/// How many of each of several props there are to be, by their weights.
struct Quota {
    /// Props that find room at all, with their weights.
    weights: Vec<(usize, f64)>,
    /// What each lacks of its share of the bodies at the end of the round.
    lacking: Vec<(usize, f64)>,
}

impl Quota {
    fn new(filling: &Filling, pass: &Pass) -> Quota {
        let weights: Vec<_> = pass.props.iter().map(|&i| (i, filling.task.scene.props[i].weight)).collect();
        Quota { lacking: weights.clone(), weights }
    }

    /// A round begins that adds `wanted` bodies.
    fn begin(&mut self, filling: &Filling, wanted: usize) {
        let mut there: BTreeMap<usize, usize> = BTreeMap::new();
        for id in filling.world.loose() {
            *there.entry(filling.world.body(id).prop).or_default() += 1;
        }
        // An earlier pile has its part of the shares.
        let kept = filling.task.kept.map_or(&[][..], |kept| &kept.instances);
        kept.iter().for_each(|body| *there.entry(body.prop).or_default() += 1);
        let here = |i: usize| there.get(&i).copied().unwrap_or(0) as f64;
        let sum: f64 = self.weights.iter().map(|(_, weight)| weight).sum();
        let all = self.weights.iter().map(|&(i, _)| here(i)).sum::<f64>() + wanted as f64;
        self.lacking = self.weights.iter().map(|&(i, weight)| (i, (weight / sum * all - here(i)).max(0.0))).collect();
    }

    /// A seed of this prop found a place.
    fn take(&mut self, prop: usize) {
        for (i, lacks) in &mut self.lacking {
            if *i == prop {
                *lacks = (*lacks - 1.0).max(0.0);
            }
        }
    }

    fn is_met(&self) -> bool {
        self.lacking.iter().all(|(_, lacks)| *lacks <= 0.0)
    }
}

/// Puts up to `wanted` seeds at free places. Each comes with its full scale.
fn plant(
    filling: &mut Filling,
    pass: &Pass,
    wanted: usize,
    inside: &[DVec3],
    quota: &mut Quota,
) -> Result<Vec<(BodyId, f64)>, Error> {
    quota.begin(filling, wanted);
    filling.world.update_contacts();
    let (task, container) = (filling.task, filling.task.container);
    // Each with the distance by which it may be outside the container.
    let mut seeds: Vec<(Instance, f64)> = Vec::new();
    let (standing_out, outside) = (task.params.fill.standing_out(), task.params.fill.outside());
    let mut outside_count = 0;
    let mut reserved = ReservedPlaces::default();
    for _ in 0..(wanted * TRIES_PER_PROP).max(LEAST_TRIES) {
        if seeds.len() == wanted {
            break;
        }
        if quota.is_met() {
            break;
        }
        let (prop, scale, rotation) = filling.draw_by(&quota.lacking);
        let (shape, size) = (&task.shapes[prop], SEED_SCALE * scale / task.units.length);
        // Outside there is room where there is none inside: no more than their share come from there.
        let is_outside =
            (outside_count as f64) < standing_out * seeds.len() as f64 && filling.rng.random_bool(standing_out);
        let outside = if is_outside { outside } else { 0.0 };
        let Some(pose) = place(filling, (prop, size), rotation, inside, outside) else { continue };
        if !pass.allows(prop, pose.translation, &mut filling.rng) {
            continue;
        }
        let slack = 0.1 * shape.thickness() * size + outside;
        if container.contains(corners(shape, size, &pose), slack)
            && !container.is_solid_at(pose.translation)
            && container.pierced(shape, size, &pose).is_none()
            && filling.world.reserve(shape, SEED_SCALE * scale, &pose, &mut reserved)
        {
            outside_count += usize::from(is_outside);
            quota.take(prop);
            seeds.push((Instance { prop, scale, pose }, outside));
        }
    }
    // What finds no room at all has no share.
    let present: Vec<usize> = filling.world.loose().map(|id| filling.world.body(id).prop).collect();
    let fits = |i: usize| present.contains(&i) || seeds.iter().any(|(seed, _)| seed.prop == i);
    if !seeds.is_empty() {
        quota.weights.retain(|&(i, _)| fits(i));
    }
    // Bodies that are near in space are near in memory: large piles spend their time waiting for that.
    let (low, extent) = (container.low, container.high - container.low);
    seeds.sort_by_cached_key(|(seed, _)| morton((seed.pose.translation - low) / extent));
    let overgrowth = if task.params.fill.residual_overlap < 1.0 { OVERGROWTH } else { 0.0 };
    let insert = |(seed, outside): (Instance, f64)| {
        let id = filling.insert(Instance { scale: SEED_SCALE * seed.scale, ..seed })?;
        if outside > 0.0 {
            filling.world.allow_outside(id);
        }
        if overgrowth > 0.0 {
            filling.overgrown.push((id, seed.scale));
        }
        Ok((id, seed.scale * (1.0 + overgrowth)))
    };
    seeds.into_iter().map(insert).collect()
}

/// Position of a point of the unit cube on its Z-order curve (Morton 1966), on which near points are mostly near.
fn morton(p: DVec3) -> u64 {
    let spread = |x: f64| {
        let cell = (x.clamp(0.0, 1.0) * MORTON_CELLS) as u64;
        (0..MORTON_BITS).map(|bit| (cell >> bit & 1) << (3 * bit)).sum::<u64>()
    };
    spread(p.x) | spread(p.y) << 1 | spread(p.z) << 2
}

const MORTON_BITS: u32 = 10;
const MORTON_CELLS: f64 = ((1 << MORTON_BITS) - 1) as f64;

/// Lets these bodies grow at their places, as far as they find room there.
pub fn grow_at(filling: &mut Filling, bodies: &[Instance], observer: &mut dyn Observer) -> Result<(), Error> {
    if bodies.is_empty() {
        return Ok(());
    }
    filling.world.update_contacts();
    let (task, first) = (filling.task, filling.world.next_id());
    let mut reserved = ReservedPlaces::default();
    let mut seeds = Vec::new();
    for body in bodies.iter().take(task.wanted()) {
        let scale = SEED_SCALE * body.scale;
        if filling.world.reserve(&task.shapes[body.prop], scale, &body.pose, &mut reserved) {
            seeds.push((filling.insert(Instance { scale, ..*body })?, body.scale));
        }
    }
    grow(filling, &seeds, observer)?;
    filling.remove_escaped();
    let overlapping = filling.world.overlapping(task.params.fill.overlap.max(GROWING_OVERLAP));
    filling.remove_overlapping(overlapping, first);
    Ok(())
}

/// A random place inside. Of a cast surface, half of the props are laid flat against the container, where gaps show and
/// where others would not fit; the rest are pushed inward until they clear it. `outside`: the container is larger by
/// that.
fn place(
    filling: &mut Filling,
    (prop, size): (usize, f64),
    rotation: DQuat,
    inside: &[DVec3],
    outside: f64,
) -> Option<Pose> {
    let node = *inside.get(filling.rng.random_range(0..inside.len().max(1)))?;
    let (task, distance) = (filling.task, &filling.task.container.distance);
    let share = DVec3::new(filling.rng.random(), filling.rng.random(), filling.rng.random());
    // A prop that must stand upright cannot be laid against a side.
    let is_free = task.scene.props[prop].tilt_max >= 180.0;
    let flat = filling.rng.random_bool(task.params.fill.at_wall()) && is_free;
    let mut p = node + (share - 0.5) * distance.spacing();
    if distance.signed_distance(p) > 0.0 {
        return None;
    }
    let shape = &task.shapes[prop];
    let least = shape.thickness() * size / 2.0;
    let wanted = if flat { least } else { shape.radius * size };
    for _ in 0..3 {
        let short = distance.signed_distance(p) - outside + wanted;
        if !flat && short <= 0.0 {
            break;
        }
        p -= distance.gradient(p).normalize_or_zero() * short;
    }
    if distance.signed_distance(p) - outside > -0.9 * least || p.y < task.container.base + 0.9 * least {
        return None;
    }
    let out = distance.gradient(p).try_normalize();
    let rotation = match out {
        Some(out) if flat => DQuat::from_rotation_arc(rotation * shape.thin_axis, out) * rotation,
        _ => rotation,
    };
    Some(Pose { translation: p, rotation })
}

/// Lets the seeds grow to their full scale while everything moves.
fn grow(filling: &mut Filling, seeds: &[(BodyId, f64)], observer: &mut dyn Observer) -> Result<(), Error> {
    let time = filling.task.params.fill.growth;
    let stages = (time / GROWTH_STAGE).round().max(1.0);
    for stage in 1..=stages as usize {
        let share = SEED_SCALE + (1.0 - SEED_SCALE) * stage as f64 / stages;
        for &(id, scale) in seeds {
            if filling.world.is_present(id) {
                let shape = &filling.task.shapes[filling.world.body(id).prop];
                filling.world.rescale(id, shape, share * scale);
            }
        }
        filling.settle(time / stages, observer)?;
    }
    Ok(())
}
