//! Where the bodies of a layout begin: above a surface of its place, apart from each other, as low as they find room,
//! so that they fall a little and not far. SI.
//!
//! Each body counts as what is below its outline: a body goes on the highest one below it.

use crate::Library;
use crate::catalogue::{Arrangement, StartPose};
use crate::draw::Drawn;
use crate::height_map::{HeightMap, Spot};
use crate::pile::Pile;
use crate::surfaces::Surfaces;
use cairn_engine::shape::{Shape, Solid, corners};
use cairn_geometry::mesh::bounds;
use cairn_geometry::pose::Pose;
use glam::{DQuat, DVec3};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// Spots at which a stacked body is tried; it takes the lowest. More spots make lower, wider layouts.
const STACKED_SPOTS: usize = 12;
/// Spots of a body of a heap: with one it may begin high, with many the heap is none.
const HEAPED_SPOTS: usize = 2;
/// Spots of a heaped or stacked body that are drawn at most, before all are looked at.
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

/// A body that was put down: its surface, and where it is on it.
#[derive(Clone, Copy)]
struct Taken {
    surface: usize,
    /// x, z.
    place: [f64; 2],
}

/// Where all bodies begin; those for which no room was found are left out.
pub fn arrange(library: &Library, drawn: &Drawn, rng: &mut Pcg64Mcg) -> Vec<Start> {
    Room::new(library, drawn).put(drawn.bodies.iter().copied().enumerate(), rng)
}

/// Where more bodies begin, among those that are there.
pub fn add(pile: &Pile, bodies: &[(usize, f64)], rng: &mut Pcg64Mcg) -> Vec<Start> {
    let mut room = Room::new(pile.library, pile.drawn);
    pile.world.present().for_each(|id| room.keep(&pile.start_now(id)));
    room.put((pile.starts.len()..).zip(bodies.iter().copied()), rng)
}

/// The room of a place, and the bodies in it.
struct Room<'a> {
    library: &'a Library,
    drawn: &'a Drawn,
    surfaces: &'a Surfaces,
    map: HeightMap,
    taken: Vec<Taken>,
}

impl Room<'_> {
    fn new<'a>(library: &'a Library, drawn: &'a Drawn) -> Room<'a> {
        let surfaces = &library.places[drawn.place].surfaces;
        let aside = if surfaces.has_walls { 0.0 } else { FROM_EDGE * library.units.length };
        let map = HeightMap::new(surfaces, library.units.length, aside);
        Room { library, drawn, surfaces, map, taken: Vec::new() }
    }

    /// Keeps the room of a body that is there.
    fn keep(&mut self, body: &Start) {
        let Pose { translation, rotation } = body.pose;
        let shape = &self.library.shapes[body.prop];
        let about = Pose { translation: DVec3::ZERO, rotation };
        let corners: Vec<DVec3> = outer_corners(shape, body.scale, &about);
        if let Some(surface) = self.surfaces.surface_below(translation) {
            self.map.keep(&corners, surface, translation);
            self.taken.push(Taken { surface, place: [translation.x, translation.z] });
        }
    }

    /// Puts bodies down, each a number, a prop and a scale.
    fn put(&mut self, bodies: impl Iterator<Item = (usize, (usize, f64))>, rng: &mut Pcg64Mcg) -> Vec<Start> {
        bodies.filter_map(|(number, (prop, scale))| self.put_one(number, prop, scale, rng)).collect()
    }

    fn put_one(&mut self, number: usize, prop: usize, scale: f64, rng: &mut Pcg64Mcg) -> Option<Start> {
        let Room { library, drawn, surfaces, map, taken } = self;
        let gap = GAP * library.units.length;
        let shape = &library.shapes[prop];
        let pose = if drawn.arrangement == Arrangement::Stacked { StartPose::Flat } else { drawn.pose };
        let rotation = rotation(shape, pose, rng);
        let about = Pose { translation: DVec3::ZERO, rotation };
        let all = outer_corners(shape, scale, &about);
        let (low, high) = bounds(all.iter().copied());
        let outline = map.outline(&all, [rng.random::<f64>(), rng.random::<f64>()]);
        let wanted = match drawn.arrangement {
            Arrangement::Scattered => 0,
            Arrangement::Heaped => HEAPED_SPOTS,
            Arrangement::Stacked => STACKED_SPOTS,
        };
        let mut best: Option<Spot> = None;
        let mut found = 0;
        for draw in 0..if wanted > 0 { DRAWS } else { 0 } {
            let (surface, point) = spot(surfaces, drawn.arrangement, taken, high - low, draw, rng);
            let Some(spot) = map.at(&outline, surface, point, gap, f64::INFINITY) else { continue };
            if best.is_none_or(|best| spot.above < best.above) {
                best = Some(spot);
            }
            found += 1;
            if found == wanted {
                break;
            }
        }
        let [first, stride] = [rng.random::<u32>(), rng.random::<u32>()].map(|n| n as usize);
        let spot = best.or_else(|| map.search(&outline, gap, first, stride))?;
        let place = map.put(&outline, &spot);
        taken.push(Taken { surface: spot.surface, place });
        let translation = DVec3::new(place[0], spot.bottom - low.y, place[1]);
        Some(Start { drawn: number, prop, scale, pose: Pose { translation, rotation } })
    }
}

/// Points around which a body's outline is that of their hull.
fn outer_corners(shape: &Shape, scale: f64, about: &Pose) -> Vec<DVec3> {
    let all: Vec<DVec3> = corners(shape, scale, about).collect();
    if !matches!(shape.solid, Solid::Ball { .. }) {
        return all;
    }
    // These six points leave out most of its outline.
    let (low, high) = bounds(all.iter().copied());
    let mut all: Vec<DVec3> =
        [low, high].iter().flat_map(|one| [low, high].map(|other| DVec3::new(one.x, other.y, other.z))).collect();
    all.extend([DVec3::new(low.x, low.y, high.z), DVec3::new(high.x, high.y, low.z)]);
    all
}

/// A surface, and a point on it: x, z.
fn spot(
    surfaces: &Surfaces,
    arrangement: Arrangement,
    taken: &[Taken],
    size: DVec3,
    draw: usize,
    rng: &mut Pcg64Mcg,
) -> (usize, [f64; 2]) {
    // Late draws are anywhere: a large body may have no room where it should go.
    let is_early = draw < DRAWS / 2;
    if arrangement == Arrangement::Stacked && is_early && !taken.is_empty() && rng.random::<f64>() < STACKED {
        let below = taken[rng.random_range(0..taken.len())];
        let [x, z] = below.place;
        let mut off = |side: f64| side * ASIDE * (2.0 * rng.random::<f64>() - 1.0);
        return (below.surface, [x + off(size.x), z + off(size.z)]);
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
