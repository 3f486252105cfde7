//! Small piles that need glue, from a seed.

use super::Pile;
use crate::generator::rng;
use glam::DVec3;
use rand::{Rng, RngExt};

/// An upright box.
#[derive(Clone, Copy, Debug)]
pub struct Block {
    pub center: DVec3,
    pub half: DVec3,
    pub mass: f64,
}

const NEAR: f64 = 1e-9;

/// Boxes with a touch wherever two faces meet, and with the ground y = 0; also with the wall x = 0 if there is one.
pub fn of_blocks(blocks: &[Block], has_wall: bool, friction: f64) -> Pile {
    let mut pile = Pile::new();
    for (i, a) in blocks.iter().enumerate() {
        pile.body(a.mass, a.center, a.half.length());
        let planes = [(1, true), (0, has_wall)].into_iter().filter(|(_, exists)| *exists);
        for (axis, _) in planes.filter(|(axis, _)| (a.center - a.half)[*axis].abs() < NEAR) {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let sides = |k: usize| [a.center[k] - a.half[k], a.center[k] + a.half[k]];
            pile.site(i, None, &corners(axis, 0.0, (u, sides(u)), (v, sides(v))), DVec3::AXES[axis], friction);
        }
        for (j, b) in blocks[..i].iter().enumerate() {
            let gap = (a.center - b.center).abs() - (a.half + b.half);
            let meets = (0..3).find(|&k| gap[k].abs() < NEAR && (0..3).all(|m| m == k || gap[m] < -NEAR));
            let Some(axis) = meets else { continue };
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let overlap = |k: usize| {
                let low = (a.center - a.half)[k].max((b.center - b.half)[k]);
                [low, (a.center + a.half)[k].min((b.center + b.half)[k])]
            };
            let sign = (a.center - b.center)[axis].signum();
            let at = a.center[axis] - sign * a.half[axis];
            let points = corners(axis, at, (u, overlap(u)), (v, overlap(v)));
            pile.site(i, Some(j), &points, sign * DVec3::AXES[axis], friction);
        }
    }
    pile
}

fn corners(axis: usize, at: f64, (u, us): (usize, [f64; 2]), (v, vs): (usize, [f64; 2])) -> [DVec3; 4] {
    [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(a, b)| {
        let mut point = DVec3::ZERO;
        point[axis] = at;
        point[u] = us[a];
        point[v] = vs[b];
        point
    })
}

/// A row of cubes of side 1 from a wall, over no ground.
pub fn cantilever(count: usize) -> Pile {
    let block = |k: usize| Block { center: DVec3::new(k as f64 + 0.5, 9.0, 0.0), half: DVec3::splat(0.5), mass: 2.0 };
    of_blocks(&(0..count).map(block).collect::<Vec<_>>(), true, 0.5)
}

pub const KINDS: u64 = 4;

/// Pile number `seed`, of 10 to 60 bodies; its kind by the seed.
pub fn random(seed: u64) -> Pile {
    let rng = &mut rng(1000 + seed);
    let count = rng.random_range(10..=60);
    let friction = rng.random_range(0.3..0.9);
    match seed % KINDS {
        0 => coral(rng, count, friction),
        1 => towers(rng, count, friction),
        2 => bridge(rng, count, friction),
        _ => arch(rng, count, friction),
    }
}

fn mass(rng: &mut impl Rng) -> f64 {
    10f64.powf(rng.random_range(-0.5..0.5))
}

/// Cubes of a grid that grow at random from the ground, at each other's sides too.
fn coral(rng: &mut impl Rng, count: usize, friction: f64) -> Pile {
    let mut cells: Vec<[i32; 3]> = vec![[0, 0, 0]];
    let steps = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1], [0, -1, 0]];
    while cells.len() < count {
        let from = cells[rng.random_range(0..cells.len())];
        let step = steps[rng.random_range(0..steps.len())];
        let cell = [0, 1, 2].map(|k| from[k] + step[k]);
        if cell[1] >= 0 && !cells.contains(&cell) {
            cells.push(cell);
        }
    }
    let half = DVec3::splat(0.5);
    let block = |cell: &[i32; 3]| Block {
        center: DVec3::from_array(cell.map(f64::from)).with_y(f64::from(cell[1]) + 0.5),
        half,
        mass: mass(rng),
    };
    of_blocks(&cells.iter().map(block).collect::<Vec<_>>(), false, friction)
}

/// Towers beside each other whose blocks lie out of line.
fn towers(rng: &mut impl Rng, count: usize, friction: f64) -> Pile {
    let mut blocks: Vec<Block> = Vec::new();
    let mut place = DVec3::ZERO;
    for k in 0..count {
        let half = DVec3::new(rng.random_range(0.4..0.8), rng.random_range(0.1..0.3), rng.random_range(0.4..0.8));
        if k % 12 == 0 {
            place = DVec3::new(9.0 * (k / 12) as f64, 0.0, 0.0);
        } else {
            place.x += rng.random_range(-0.38..0.38);
            place.z += rng.random_range(-0.38..0.38);
        }
        let center = place.with_y(place.y + half.y);
        place.y += 2.0 * half.y;
        blocks.push(Block { center, half, mass: mass(rng) });
    }
    of_blocks(&blocks, false, friction)
}

/// Two piers and a row of blocks between them.
fn bridge(rng: &mut impl Rng, count: usize, friction: f64) -> Pile {
    let span = rng.random_range(3..=8);
    let mut blocks: Vec<Block> = Vec::new();
    let half = DVec3::splat(0.5);
    let courses = (count - span).div_ceil(2);
    for k in 0..count {
        let (x, y) = match k {
            k if k < courses => (0.0, k),
            k if k < 2 * courses => ((span + 1) as f64, k - courses),
            k => ((k - 2 * courses + 1) as f64, courses - 1),
        };
        blocks.push(Block { center: DVec3::new(x, y as f64 + 0.5, 0.0), half, mass: mass(rng) });
    }
    of_blocks(&blocks, false, friction)
}

/// A half ring of voussoirs, most too thin to stand; some stones stand on its outer face.
fn arch(rng: &mut impl Rng, count: usize, friction: f64) -> Pile {
    let stones = count.min(31);
    let thickness = rng.random_range(0.05..0.2);
    let step = std::f64::consts::PI / stones as f64;
    let radial = |a: f64| DVec3::new(-a.cos(), a.sin(), 0.0);
    let mut pile = Pile::new();
    for k in 0..=stones {
        let a = k as f64 * step;
        if k < stones {
            pile.body(mass(rng), radial(a + step / 2.0), step.max(thickness));
        }
        let along = DVec3::new(a.sin(), a.cos(), 0.0);
        let (body, other, normal) = match k {
            0 => (0, None, along),
            k if k == stones => (k - 1, None, -along),
            k => (k, Some(k - 1), along),
        };
        let corner = |r: f64, z: f64| radial(a) * (1.0 + r * thickness / 2.0) + DVec3::new(0.0, 0.0, z);
        let points = [corner(-1.0, -0.1), corner(1.0, -0.1), corner(1.0, 0.1), corner(-1.0, 0.1)];
        pile.site(body, other, &points, normal, friction);
    }
    for k in 0..count - stones {
        let out = radial((k as f64 + 0.5) * step);
        let body = pile.body(mass(rng), out * (1.0 + thickness / 2.0 + 0.05), 0.06);
        let side = out.cross(DVec3::Z) * (0.3 * step);
        let foot = out * (1.0 + thickness / 2.0);
        let points = [foot - side, foot + side].map(|p| [p + DVec3::Z * 0.04, p - DVec3::Z * 0.04]);
        pile.site(body, Some(k), points.as_flattened(), out, friction);
    }
    pile
}
