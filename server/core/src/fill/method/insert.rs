//! The `insert` fill: props are put at free places inside the closed container at a fraction of their size and grow
//! there, while upward gravity packs them. Denser and more even than a pour, and it reaches under overhangs.
//!
//! Seeds are planted at each stage of growth, not once a growth: near the end, few places are free at any time, and all
//! bodies move in each step, so that what counts is how many places each step offers.

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
use std::collections::{BTreeMap, VecDeque};

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
/// Places tried for each prop that a stage asks for. A place costs a thousandth of a prop that grows there.
const TRIES_PER_PROP: usize = 60;
/// Places tried at least in a stage.
const LEAST_TRIES: usize = 1000;
/// Bound on the growths, one after the other; a fill takes about 8.
const MAX_ROUNDS: usize = 200;
/// A body that grows may overlap another by this share of the thinner one's thickness: both may yet give way.
const GROWING_OVERLAP: f64 = 0.25;

/// A body that reaches into scenery by more than this share of its thickness passes to the other side.
const PASSES: f64 = 0.5;

/// Growths in a row after which a pair that overlaps too deeply is jammed: the next one may still ease a squeezed pair.
const JAMMED: u32 = 3;

/// How many times as many seeds as grow at once show that the container is full: the latest ones came to a pile that
/// has settled for less time.
const SHOWN: f64 = 1.5;
/// Fewer seeds than this do not show that the container is full: one may have been unlucky.
const LEAST_SEEDS: usize = 20;
/// Where every seed of a stage finds a place, a draft is not full yet, unless a full round of seeds adds less than this
/// share.
const ROOM_BELOW: f64 = 0.05;

pub struct Insert;

impl Method for Insert {
    fn gravity(&self, height: f64) -> f64 {
        (TALL / height).min(1.0)
    }

    /// Plants seeds at each stage of growth, until that adds next to nothing.
    fn run(&mut self, filling: &mut Filling, pass: &Pass, observer: &mut dyn Observer) -> Result<bool, Error> {
        let (fill, expected) = (&filling.task.params.fill, filling.task.expected as f64);
        let deep = fill.overlap.max(GROWING_OVERLAP);
        let inside = filling.task.inside();
        let stages = (fill.growth / GROWTH_STAGE).round().max(1.0) as usize;
        let stage_length = fill.growth / stages as f64;
        // Seeds that a stage asks for, and that show that the container is full.
        let share = (fill.round * expected / stages as f64).ceil() as usize;
        let full_round = ((SHOWN * fill.round * expected).ceil() as usize).max(LEAST_SEEDS);
        let mut growing = VecDeque::<Cohort>::new();
        // Seeds asked for so far, and grown bodies there, after each cohort.
        let mut history = vec![(0, filling.world.loose().count())];
        let (mut asked, mut is_full) = (0, false);
        let mut squeezed = Squeezed::default();
        let mut quota = Quota::new(filling, pass);
        for stage in 1..=MAX_ROUNDS * stages {
            let seeds = growing.iter().map(|cohort| cohort.present(filling)).sum::<usize>();
            let bodies = filling.world.loose().count();
            if seeds == 0 && (is_full || bodies >= pass.limit) {
                return Ok(is_full);
            }
            if !is_full {
                let wanted = share.min(pass.limit.saturating_sub(bodies));
                asked += wanted;
                let cohort =
                    Cohort { seeds: plant(filling, pass, wanted, &inside, &mut quota)?, wanted, asked, age: 0 };
                if seeds == 0 && cohort.seeds.is_empty() {
                    return Ok(true);
                }
                growing.push_back(cohort);
            }
            growing.iter_mut().for_each(|cohort| cohort.grow(filling, stages));
            filling.settle(stage_length, observer)?;
            filling.remove_escaped();
            if stage.is_multiple_of(stages) {
                let jammed = squeezed.look(filling, deep);
                filling.remove_overlapping(jammed, 0);
                filling.remove_cutting(PASSES);
            }
            let Some(cohort) = growing.pop_front_if(|cohort| cohort.age == stages) else { continue };
            if let Some(&(first, _)) = cohort.seeds.first() {
                let new = filling.world.overlapping_with(first..first + cohort.seeds.len(), deep);
                filling.remove_overlapping(new, first);
            }
            filling.world.validate(pass.limit);
            let seeds = growing.iter().map(|cohort| cohort.present(filling)).sum::<usize>();
            let grown = filling.world.loose().count() - seeds;
            history.push((cohort.asked, grown));
            // Jammed props trade places: a stage adds some and squeezes others out. So as many seeds count as a full
            // round asks for.
            let all_found_room = cohort.seeds.len() == cohort.wanted;
            let below = if all_found_room { fill.full_below.min(ROOM_BELOW) } else { fill.full_below };
            let least = (below * grown as f64).max(1.0);
            let then = history.iter().rev().find(|(earlier, _)| earlier + full_round <= cohort.asked);
            is_full |= then.is_some_and(|&(_, then)| (grown as f64) < then as f64 + least);
        }
        Ok(false)
    }
}

/// Seeds that were planted at one stage, and grow together.
struct Cohort {
    /// Of consecutive ids, each with its full scale.
    seeds: Vec<(BodyId, f64)>,
    /// Seeds that were asked for, and all that were up to this cohort.
    wanted: usize,
    asked: usize,
    /// Stages of growth so far.
    age: usize,
}

impl Cohort {
    fn present(&self, filling: &Filling) -> usize {
        self.seeds.iter().filter(|(id, _)| filling.world.is_present(*id)).count()
    }

    /// One of `stages` stages.
    fn grow(&mut self, filling: &mut Filling, stages: usize) {
        self.age += 1;
        let share = SEED_SCALE + (1.0 - SEED_SCALE) * self.age as f64 / stages as f64;
        for &(id, scale) in &self.seeds {
            if filling.world.is_present(id) {
                let shape = &filling.task.shapes[filling.world.body(id).prop];
                filling.world.rescale(id, shape, share * scale);
            }
        }
    }
}

/// Pairs that overlap too deeply, and for how many looks in a row.
#[derive(Default)]
struct Squeezed(BTreeMap<(BodyId, BodyId), u32>);

impl Squeezed {
    /// Looks once a growth. Returns the pairs that are jammed by now.
    fn look(&mut self, filling: &mut Filling, deep: f64) -> Vec<(BodyId, BodyId)> {
        let looks = |pair| self.0.get(&pair).map_or(1, |looks| looks + 1);
        self.0 = filling.world.overlapping(deep).into_iter().map(|pair| (pair, looks(pair))).collect();
        self.0.iter().filter(|(_, looks)| **looks >= JAMMED).map(|(pair, _)| *pair).collect()
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
