//! Where the bodies of a layout begin: above a surface of its place, apart from each other, as low as they find room,
//! so that they fall a little and not far. SI.
//!
//! Each body counts as the box around it: a body goes on the highest box below it.

use crate::Library;
use crate::catalogue::{Arrangement, StartPose};
use crate::draw::Drawn;
use crate::surfaces::Surfaces;
use cairn_engine::shape::{Shape, corners};
use cairn_geometry::pose::Pose;
use glam::{DQuat, DVec3};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// Spots at which a scattered body is tried; it takes the lowest. More spots make lower, wider layouts.
const SCATTERED_SPOTS: usize = 12;
/// Spots of a body of a heap: with one it may begin high, with many the heap is none.
const HEAPED_SPOTS: usize = 2;
/// Draws until a body's box is above a surface.
const DRAWS: usize = 60;
/// Half the width of a heap, in that of its surface.
const HEAP: f64 = 0.3;
/// Share of the bodies of a stacked layout that go on top of others.
const STACKED: f64 = 0.75;
/// How far a body is off the middle of its stack, in its size.
const ASIDE: f64 = 0.06;
/// Gap above what a body begins on, in the median prop's diameter: rounding must not make bodies overlap.
const GAP: f64 = 0.01;

/// Distance of bodies from an edge without a wall, in the median prop's diameter: what falls rolls and slides a little.
const FROM_EDGE: f64 = 0.2;

/// Where a body begins: from its own frame, with its origin in the center of mass, to the place's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Its place among the drawn bodies.
    pub drawn: usize,
    pub prop: usize,
    pub scale: f64,
    pub pose: Pose,
}

/// The box around a body that was put down.
#[derive(Clone, Copy)]
struct Taken {
    low: DVec3,
    high: DVec3,
    surface: usize,
}

/// Where all bodies begin; those for which no room was found are left out.
pub fn arrange(library: &Library, drawn: &Drawn, rng: &mut Pcg64Mcg) -> Vec<Start> {
    let surfaces = &library.places[drawn.place].surfaces;
    let gap = GAP * library.units.length;
    let aside = if surfaces.has_walls { 0.0 } else { FROM_EDGE * library.units.length };
    let mut taken: Vec<Taken> = Vec::new();
    let mut starts = Vec::new();
    for (number, &(prop, scale)) in drawn.bodies.iter().enumerate() {
        let shape = &library.shapes[prop];
        let pose = if drawn.arrangement == Arrangement::Stacked { StartPose::Flat } else { drawn.pose };
        let rotation = rotation(shape, pose, rng);
        let around = bounds(shape, scale, rotation);
        let wanted = if drawn.arrangement == Arrangement::Heaped { HEAPED_SPOTS } else { SCATTERED_SPOTS };
        let mut best: Option<(f64, DVec3, usize)> = None;
        let mut found = 0;
        for draw in 0..DRAWS {
            let (surface, [x, z]) = spot(surfaces, drawn.arrangement, &taken, around, draw, rng);
            let (low, high) = ([x + around.0.x, z + around.0.z], [x + around.1.x, z + around.1.z]);
            let outer = (low.map(|edge| edge - aside), high.map(|edge| edge + aside));
            let Some((floor, ceiling)) = surfaces.room(surface, outer.0, outer.1) else { continue };
            let below = taken.iter().filter(|other| other.surface == surface && other.is_under(low, high));
            let bottom = below.map(|other| other.high.y).fold(floor, f64::max) + gap;
            if bottom + around.1.y - around.0.y > ceiling {
                continue;
            }
            if best.is_none_or(|(lowest, ..)| bottom < lowest) {
                best = Some((bottom, DVec3::new(x, bottom - around.0.y, z), surface));
            }
            found += 1;
            if found == wanted {
                break;
            }
        }
        let Some((_, place, surface)) = best else { continue };
        taken.push(Taken { low: place + around.0, high: place + around.1, surface });
        starts.push(Start { drawn: number, prop, scale, pose: Pose { translation: place, rotation } });
    }
    starts
}

impl Taken {
    fn is_under(&self, low: [f64; 2], high: [f64; 2]) -> bool {
        self.low.x < high[0] && low[0] < self.high.x && self.low.z < high[1] && low[1] < self.high.z
    }
}

/// A surface, and a point on it: x, z.
fn spot(
    surfaces: &Surfaces,
    arrangement: Arrangement,
    taken: &[Taken],
    around: (DVec3, DVec3),
    draw: usize,
    rng: &mut Pcg64Mcg,
) -> (usize, [f64; 2]) {
    // Late draws are anywhere: a large body may have no room where it should go.
    let is_early = draw < DRAWS / 2;
    if arrangement == Arrangement::Stacked && is_early && !taken.is_empty() && rng.random::<f64>() < STACKED {
        let below = taken[rng.random_range(0..taken.len())];
        let middle = (below.low + below.high) / 2.0;
        let size = around.1 - around.0;
        let mut off = |side: f64| side * ASIDE * (2.0 * rng.random::<f64>() - 1.0);
        return (below.surface, [middle.x + off(size.x), middle.z + off(size.z)]);
    }
    // By area: each line of each surface alike.
    let count: usize = surfaces.cells.iter().map(Vec::len).sum();
    let mut number = rng.random_range(0..count);
    let surface = surfaces.cells.iter().position(|cells| {
        let is_here = number < cells.len();
        number -= if is_here { 0 } else { cells.len() };
        is_here
    });
    let surface = surface.unwrap_or(0);
    let (corner, edge) = surfaces.corner(surfaces.cells[surface][number]);
    let point = corner.map(|c| c + edge * rng.random::<f64>());
    if arrangement != Arrangement::Heaped || !is_early {
        return (surface, point);
    }
    let middle = surfaces.middle(surface);
    (surface, [0, 1].map(|axis| middle[axis] + HEAP * (point[axis] - middle[axis])))
}

/// The lowest and the highest corner of a body about its center of mass.
fn bounds(shape: &Shape, scale: f64, rotation: DQuat) -> (DVec3, DVec3) {
    let pose = Pose { translation: DVec3::ZERO, rotation };
    let all = corners(shape, scale, &pose);
    all.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
}

fn rotation(shape: &Shape, pose: StartPose, rng: &mut Pcg64Mcg) -> DQuat {
    let turn = TAU * rng.random::<f64>();
    match pose {
        StartPose::Any => any_rotation(turn, rng),
        StartPose::Upright => about_y(turn),
        StartPose::Flat => {
            let side = if rng.random::<bool>() { DVec3::Y } else { DVec3::NEG_Y };
            about_y(turn) * DQuat::from_rotation_arc(shape.thin_axis, side)
        }
    }
}

fn about_y(turn: f64) -> DQuat {
    let (sin, cos) = libm::sincos(turn / 2.0);
    DQuat::from_xyzw(0.0, sin, 0.0, cos)
}

/// Evenly from all rotations (Shoemake 1992).
fn any_rotation(turn: f64, rng: &mut Pcg64Mcg) -> DQuat {
    let (share, other) = (rng.random::<f64>(), TAU * rng.random::<f64>());
    let (low, high) = ((1.0 - share).sqrt(), share.sqrt());
    let ((sin, cos), (sine, cosine)) = (libm::sincos(turn), libm::sincos(other));
    DQuat::from_xyzw(low * sin, low * cos, high * sine, high * cosine).normalize()
}
