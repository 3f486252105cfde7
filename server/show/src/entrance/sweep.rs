//! Whether planned motions cut anything: steps as long as nothing can be reached in, and no longer than a share of the
//! thinner body near to what it touches.

use super::path::Path;
use cairn_engine::world::{BodyId, Obstacle, PairSide, World};
use cairn_geometry::pose::Pose;
use glam::DVec3;

/// The largest step, characteristic times, and the smallest, thicknesses.
const LONGEST: f64 = 0.5;
const SHORTEST: f64 = 0.05;
/// The smallest step of a first look, which most motions do not survive.
const COARSE: f64 = 0.3;
/// Bound on the steps of a motion.
const MOST_STEPS: usize = 40_000;
/// Farther away than this, in d, distances are not computed.
const REACH: f64 = 0.5;
/// How exactly the time of a touch is found: halvings of a step.
const HALVINGS: u32 = 8;
/// A body may sink in deeper on its way than where it ends by this share of the thinner body's thickness: rounding.
pub const ALLOWED: f64 = 0.01;

/// How a motion passes what is there.
#[derive(Clone, Debug, Default)]
pub struct Passage {
    /// By how much it cuts in deeper than at its end, in the thickness of the thinner one.
    pub cut: f64,
    /// Bodies that it cuts by more than is allowed, ascending.
    pub blockers: Vec<BodyId>,
}

impl Passage {
    pub fn is_clear(&self) -> bool {
        self.cut <= ALLOWED
    }
}

/// An obstacle of a motion, and how deep the body is in it at the end.
struct Near {
    obstacle: Obstacle,
    thickness: f64,
    depth: f64,
}

/// A motion followed back from its end, past all that stands where it does in the world.
struct Walk<'a> {
    world: &'a World,
    id: BodyId,
    path: &'a Path,
    near: Vec<Near>,
    radius: f64,
    turning: f64,
    /// The smallest step, thicknesses.
    shortest: f64,
}

impl<'a> Walk<'a> {
    /// `is_there`: bodies that count.
    fn new(world: &'a World, id: BodyId, path: &'a Path, is_there: &dyn Fn(BodyId) -> bool) -> Walk<'a> {
        let (radius, own) = (world.bodies()[id].radius, world.bodies()[id].thickness);
        let (low, high) = path.bounds(radius);
        let near = |obstacle: Obstacle| {
            let thickness = match obstacle.side {
                PairSide::Body(other) if !is_there(other) => return None,
                PairSide::Body(other) => own.min(world.bodies()[other].thickness),
                _ => own,
            };
            let depth = world.gap_at(id, path.end(), &obstacle, 0.0).map_or(0.0, |gap| (-gap).max(0.0));
            Some(Near { obstacle, thickness, depth })
        };
        let near = world.obstacles(id, low, high).into_iter().filter_map(near).collect();
        Walk { world, id, path, near, radius, turning: path.turning(radius), shortest: SHORTEST }
    }

    /// At a time before the end: the deepest cut, in the thickness of the thinner one, what is cut by more than is
    /// allowed, and how long nothing else can be reached. Ends at the first cut beyond `most`.
    fn look(&self, before: f64, most: f64) -> (f64, Vec<PairSide>, f64) {
        let pose = self.path.pose(before);
        let speed = self.path.velocity(before).length() + self.turning + LONGEST;
        let (mut free, mut deepest, mut met) = (LONGEST * speed, 0.0f64, Vec::new());
        for Near { obstacle, thickness, depth } in &self.near {
            let apart = obstacle.distance(pose.translation) - self.radius;
            if apart >= free.min(REACH) {
                free = free.min(apart);
                continue;
            }
            let Some(gap) = self.world.gap_at(self.id, &pose, obstacle, free.min(REACH)) else {
                free = free.min(REACH);
                continue;
            };
            let cut = (-gap - depth) / thickness;
            deepest = deepest.max(cut);
            if cut > ALLOWED {
                met.push(obstacle.side);
            }
            if cut > most {
                break;
            }
            free = free.min(gap.max(self.shortest * thickness));
        }
        (deepest, met, free / speed)
    }

    /// From the end to the beginning, or to the first cut beyond `most`.
    fn pass(&self, most: f64) -> Passage {
        let (mut passage, mut before, duration) = (Passage::default(), 0.0, self.path.duration());
        for _ in 0..MOST_STEPS {
            let (cut, met, free) = self.look(before, most);
            passage.cut = passage.cut.max(cut);
            passage.blockers.extend(met.into_iter().filter_map(|side| match side {
                PairSide::Body(other) => Some(other),
                _ => None,
            }));
            if passage.cut > most || before >= duration {
                break;
            }
            before = (before + free).min(duration);
        }
        passage.blockers.sort_unstable();
        passage.blockers.dedup();
        passage
    }
}

/// Follows the motion of a body to its beginning. Ends at the first cut beyond `most`.
pub fn pass(world: &World, id: BodyId, path: &Path, is_there: &dyn Fn(BodyId) -> bool, most: f64) -> Passage {
    let mut walk = Walk::new(world, id, path, is_there);
    walk.shortest = COARSE;
    let coarse = walk.pass(most);
    if coarse.cut > most {
        return coarse;
    }
    walk.shortest = SHORTEST;
    walk.pass(most)
}

/// The latest time before its end at which a motion touches something that it would cut before, within a small gap.
pub fn first_cut(world: &World, id: BodyId, path: &Path, is_there: &dyn Fn(BodyId) -> bool) -> Option<f64> {
    let walk = Walk::new(world, id, path, is_there);
    let (mut before, mut clear) = (0.0, 0.0);
    for _ in 0..MOST_STEPS {
        let (cut, _, free) = walk.look(before, ALLOWED / 2.0);
        if cut > ALLOWED / 2.0 {
            let mut cuts = before;
            for _ in 0..HALVINGS {
                let middle = (clear + cuts) / 2.0;
                if walk.look(middle, ALLOWED / 2.0).0 > ALLOWED / 2.0 { cuts = middle } else { clear = middle }
            }
            return Some(clear);
        }
        if before >= path.duration() {
            break;
        }
        clear = before;
        before += free;
    }
    None
}

/// A body in flight, and when it lands.
#[derive(Clone, Copy)]
pub struct Flyer<'a> {
    pub id: BodyId,
    pub path: &'a Path,
    pub lands: f64,
}

impl Flyer<'_> {
    fn pose(&self, time: f64) -> Pose {
        self.path.pose(self.lands - time)
    }

    fn velocity(&self, time: f64) -> DVec3 {
        self.path.velocity(self.lands - time)
    }

    pub fn begins(&self) -> f64 {
        self.lands - self.path.duration()
    }
}

/// By how much two flying bodies cut each other while both fly, in the thickness of the thinner one.
pub fn meet(world: &World, first: Flyer, second: Flyer) -> f64 {
    let from = first.begins().max(second.begins());
    let to = first.lands.min(second.lands);
    let bodies = world.bodies();
    let (a, b) = (&bodies[first.id], &bodies[second.id]);
    let both = a.radius + b.radius;
    if from >= to {
        return 0.0;
    }
    let apart = |time: f64| first.pose(time).translation - second.pose(time).translation;
    let is_straight = first.path.flights.len() == 1 && second.path.flights.len() == 1;
    // Where both fall, one moves past the other on a straight line.
    let passing = first.velocity(to) - second.velocity(to);
    let nearest = match passing.length_squared() {
        0.0 => from,
        square => (to - apart(to).dot(passing) / square).clamp(from, to),
    };
    if is_straight && apart(nearest).length() > both {
        return 0.0;
    }
    let thickness = a.thickness.min(b.thickness);
    let moving = match is_straight {
        true => passing.length(),
        false => first.path.fastest() + second.path.fastest(),
    };
    let speed = moving + first.path.turning(a.radius) + second.path.turning(b.radius) + 1e-3;
    let (mut time, mut cut) = (from, 0.0f64);
    for _ in 0..MOST_STEPS {
        if time > to {
            break;
        }
        let (own, other) = (first.pose(time), second.pose(time));
        let far = own.translation.distance(other.translation) - both;
        let gap = match far < REACH {
            true => world.gap_between((first.id, &own), (second.id, &other), REACH).unwrap_or(REACH),
            false => far,
        };
        cut = cut.max(-gap / thickness);
        time += (gap.max(SHORTEST * thickness) / speed).min(LONGEST);
    }
    cut
}
