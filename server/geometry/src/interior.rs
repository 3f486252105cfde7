//! The inside of a mesh: tests of points, and the distance to its surface.
//!
//! The solid of a mesh is where its generalised winding number exceeds one half (Jacobson et al. 2013). This gives
//! overlapping parts their union, a hole its natural cap, and needs no repair. A mesh that is inside out as a whole
//! counts as its outward twin. Faces that lie inside the solid (or wholly outside, such as the two sides of a flap)
//! are no surface: distances ignore them. A face that lies inside only in part still counts, so that a distance
//! inside may be understated near such a face, never overstated.

pub mod bvh;
pub mod crowding;
mod grid;
mod ray;
#[cfg(test)]
mod tests;

use crate::mesh::{TriMesh, bounds};
pub use bvh::Bvh;
use glam::{DMat3, DVec3};
pub use grid::DistanceGrid;
use rand::{Rng, RngExt};
use rayon::prelude::*;
use std::sync::OnceLock;

/// Winding number above which a point belongs to the solid.
const INSIDE: f64 = 0.5;
/// Far nodes are those beyond this many of their radii (Barill et al.'s beta). With the second term of the series
/// the winding number is then right to some hundredths, far from mattering at [`INSIDE`].
const WINDING_ACCURACY: f64 = 2.0;
/// Offset from a face at which its two sides are judged, as a share of the mesh's box diagonal: well above f64's
/// noise, and thinner than any wall that a modeller means.
const SIDE_OFFSET: f64 = 1e-7;
/// A face is judged at points no farther apart than about this share of the box diagonal.
const SIDE_SPACING: f64 = 1.0 / 64.0;
/// An edge of a face is cut into at most this many intervals, which bounds the work on a huge face.
const SIDE_INTERVALS: usize = 8;
/// Draws until a random point inside is given up on: the solid is then below about a thousandth of its box.
const SAMPLE_TRIES: usize = 10_000;
/// The volume is sampled in this many blocks along each axis of the mesh's box.
const VOLUME_BLOCKS: usize = 10;
/// A block that the surface runs through is sampled at this many places along each axis.
const VOLUME_SAMPLES: usize = 4;

/// Where a mesh winds more than once, or less than not at all, around the points of its solid: volume (m^3), and the
/// integrals of x and x x^T over it, times how often too much.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surplus {
    pub volume: f64,
    pub first: DVec3,
    pub second: DMat3,
}

impl Surplus {
    /// That of a closed mesh, about `origin`. Sampled: 0 where parts are apart, whatever the mesh.
    pub fn of(mesh: &TriMesh, origin: DVec3) -> Surplus {
        let bounds = mesh.bounds();
        let (mesh, closed) = ray::welded(mesh, bounds.0.distance(bounds.1));
        let triangles = (0..mesh.triangles.len()).map(|i| (i as u32, mesh.corners(i))).collect();
        let all = Winding { tree: Bvh::new(triangles), closed };
        let mut sum = Surplus { volume: 0.0, first: DVec3::ZERO, second: DMat3::ZERO };
        for (place, edge, times) in samples(&all, bounds).into_iter().flatten() {
            let (volume, p) = (times * edge.element_product(), place - origin);
            // A cell has a moment of its own.
            let own = DMat3::from_diagonal(edge * edge / 12.0);
            sum.volume += volume;
            sum.first += volume * p;
            sum.second += (DMat3::from_cols(p * p.x, p * p.y, p * p.z) + own) * volume;
        }
        sum
    }
}

/// The solid of a mesh, prepared for queries. SI metres, in the frame of the mesh.
pub struct MeshInterior {
    all: Winding,
    /// The triangles that bound the solid, unless those are all.
    surface: Option<Bvh>,
    bounds: (DVec3, DVec3),
    /// As often as the mesh winds around each point.
    enclosed: f64,
    /// Of the solid, once somebody asks: it is sampled.
    volume: OnceLock<f64>,
    inside_out: bool,
}

/// All triangles, turned outward.
struct Winding {
    tree: Bvh,
    /// Whether every winding number is whole.
    closed: bool,
}

impl MeshInterior {
    /// The mesh must have a triangle.
    pub fn new(mesh: &TriMesh) -> MeshInterior {
        assert!(!mesh.triangles.is_empty(), "a region needs a triangle");
        let used = mesh.triangles.iter().flatten().map(|&v| mesh.points[v as usize]);
        let bounds = bounds(used);
        let (mesh, closed) = ray::welded(mesh, bounds.0.distance(bounds.1));
        let enclosed = enclosed_volume(&mesh);
        let inside_out = enclosed < 0.0;
        let turn = |[a, b, c]: [DVec3; 3]| if inside_out { [a, c, b] } else { [a, b, c] };
        let triangles: Vec<_> = (0..mesh.triangles.len()).map(|i| (i as u32, turn(mesh.corners(i)))).collect();
        let all = Winding { tree: Bvh::new(triangles.clone()), closed };
        let surface = surface_triangles(&all, &triangles, bounds.0.distance(bounds.1));
        MeshInterior { all, surface, bounds, enclosed: enclosed.abs(), volume: OnceLock::new(), inside_out }
    }

    /// Generalised winding number: 1 inside a closed outward mesh, 0 outside, 2 where two parts overlap.
    pub fn winding_number(&self, p: DVec3) -> f64 {
        self.all.tree.winding_number(p, WINDING_ACCURACY)
    }

    /// Whether the point belongs to the solid.
    pub fn contains(&self, p: DVec3) -> bool {
        // Outside the box no winding number of a closed mesh exceeds one half, and an open one's caps stay inside it.
        let (lo, hi) = self.bounds;
        p.cmpge(lo).all() && p.cmple(hi).all() && self.all.at(p) > INSIDE
    }

    /// The closest point of the solid's surface, its distance in metres, and the mesh's triangle that it lies on.
    pub fn nearest(&self, p: DVec3) -> (DVec3, f64, usize) {
        let surface = self.surface();
        let hit = surface.nearest(p, 0).expect("a region has a triangle");
        (hit.point, hit.squared.sqrt(), surface.name(hit.place) as usize)
    }

    /// The closest point of the solid's surface, where that is nearer than `reach`, metres.
    pub fn nearest_within(&self, p: DVec3, reach: f64) -> Option<DVec3> {
        self.surface().nearest_within(p, reach).map(|hit| hit.point)
    }

    /// Distance to the solid's surface, metres: negative inside.
    pub fn signed_distance(&self, p: DVec3) -> f64 {
        let (_, distance, _) = self.nearest(p);
        if self.contains(p) { -distance } else { distance }
    }

    /// Volume of the solid, m^3. Exact for a closed mesh without overlaps; otherwise overlaps (or, for an open mesh,
    /// all of it) are sampled on a grid of 40 points along each axis of the box.
    pub fn volume(&self) -> f64 {
        *self.volume.get_or_init(|| solid_volume(&self.all, self.bounds, self.enclosed))
    }

    /// Smallest and largest corner of the axis-aligned box around the triangles.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.bounds
    }

    /// Whether the mesh's triangles face inward, and were turned.
    pub fn was_inside_out(&self) -> bool {
        self.inside_out
    }

    /// Whether the mesh has holes: some edge is not shared by triangles on both sides, as often in one direction as in
    /// the other. The solid is then capped where its winding number passes one half, and a signed distance jumps there.
    pub fn is_open(&self) -> bool {
        !self.all.closed
    }

    /// Whether two parts of the mesh overlap: somewhere `depth` below a face, the mesh winds more than once. Parts that
    /// only touch do not.
    pub fn overlaps(&self, depth: f64) -> bool {
        let (lo, hi) = self.bounds;
        let overlapped = |triangle: [DVec3; 3]| {
            let mut points = face_points(triangle, lo.distance(hi));
            unit_normal(triangle).is_some_and(|normal| points.any(|p| self.all.at(p - normal * depth) > 1.0 + INSIDE))
        };
        self.all.tree.triangles().par_iter().any(|&triangle| overlapped(triangle))
    }

    /// A point drawn uniformly from the solid. `None` when it fills next to nothing of its box.
    pub fn sample_inside(&self, rng: &mut impl Rng) -> Option<DVec3> {
        let (lo, hi) = self.bounds;
        (0..SAMPLE_TRIES)
            .map(|_| lo + (hi - lo) * DVec3::new(rng.random(), rng.random(), rng.random()))
            .find(|&p| self.contains(p))
    }

    /// Distance to the surface and the place of its triangle, from the guess of a place nearby.
    fn distance_near(&self, p: DVec3, guess: u32) -> (f64, u32) {
        let hit = self.surface().nearest(p, guess).expect("a region has a triangle");
        (hit.squared.sqrt(), hit.place)
    }

    /// Sets `row[i]` to whether `start + i step X` is inside. Points within the distance to the surface share one
    /// answer, and so do two such balls that meet: winding numbers are only needed where the surface is passed.
    pub fn mark_row(&self, start: DVec3, step: f64, row: &mut [u8]) {
        let (mut i, mut guess) = (0, 0);
        let mut last: Option<u8> = None;
        while i < row.len() {
            let p = start + DVec3::X * (i as f64 * step);
            let (distance, place) = self.distance_near(p, guess);
            guess = place;
            let inside = last.filter(|_| distance > step && self.all.closed).unwrap_or_else(|| self.contains(p) as u8);
            let same = if self.all.closed { (distance / step).ceil().max(1.0) } else { 1.0 };
            let same = same.min((row.len() - i) as f64) as usize;
            row[i..i + same].fill(inside);
            last = Some(inside);
            i += same;
        }
    }

    fn surface(&self) -> &Bvh {
        self.surface.as_ref().unwrap_or(&self.all.tree)
    }
}

impl Winding {
    /// The winding number: exact for a closed mesh, approximated for an open one.
    fn at(&self, p: DVec3) -> f64 {
        let exact = if self.closed { ray::crossings(&self.tree, p) } else { None };
        exact.map_or_else(|| self.tree.winding_number(p, WINDING_ACCURACY), f64::from)
    }
}

/// As [`TriMesh::signed_volume`], about the middle of the area: the sign then also holds for most open meshes.
fn enclosed_volume(mesh: &TriMesh) -> f64 {
    let triangles = || (0..mesh.triangles.len()).map(|i| mesh.corners(i));
    let area = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).length();
    let total: f64 = triangles().map(area).sum();
    let weighted: DVec3 = triangles().map(|t| (t[0] + t[1] + t[2]) / 3.0 * area(t)).sum();
    let origin = if total > 0.0 { weighted / total } else { mesh.bounds().0 };
    mesh.volume_about(origin, 0..mesh.triangles.len())
}

/// The tree of the triangles with the solid on exactly one side, or `None` when those are all
/// (or none: then nothing is solid, and any distance is better than no answer).
fn surface_triangles(all: &Winding, triangles: &[(u32, [DVec3; 3])], diagonal: f64) -> Option<Bvh> {
    let bounding: Vec<bool> = triangles.par_iter().map(|(_, t)| bounds_solid(all, t, diagonal)).collect();
    let kept = bounding.iter().filter(|&&b| b).count();
    if kept == 0 || kept == triangles.len() {
        return None;
    }
    Some(Bvh::new(triangles.iter().zip(bounding).filter(|(_, b)| *b).map(|(t, _)| *t).collect()))
}

/// Whether the two sides of a triangle differ anywhere. A flat triangle (without a normal) bounds nothing.
fn bounds_solid(all: &Winding, &triangle: &[DVec3; 3], diagonal: f64) -> bool {
    let Some(normal) = unit_normal(triangle) else { return false };
    let offset = normal * (diagonal * SIDE_OFFSET);
    let inside = |p: DVec3| all.at(p) > INSIDE;
    face_points(triangle, diagonal).any(|p| inside(p + offset) != inside(p - offset))
}

fn unit_normal([a, b, c]: [DVec3; 3]) -> Option<DVec3> {
    (b - a).cross(c - a).try_normalize()
}

/// The points at which a face is judged: its centroid, then a lattice.
fn face_points([a, b, c]: [DVec3; 3], diagonal: f64) -> impl Iterator<Item = DVec3> {
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let n = ((longest / (diagonal * SIDE_SPACING)).ceil() as usize).clamp(1, SIDE_INTERVALS);
    // Centroids of the n^2 upright sub-triangles and so never on an edge, where sides are undefined.
    let part = move |i: usize| (i as f64 + 1.0 / 3.0) / n as f64;
    let lattice = (0..n).flat_map(move |i| (0..n - i).map(move |j| a + (b - a) * part(i) + (c - a) * part(j)));
    std::iter::once((a + b + c) / 3.0).chain(lattice)
}

/// The largest distance of any of the points from the mesh's triangles; 0 without points.
pub fn farthest(mesh: &TriMesh, points: &[DVec3]) -> f64 {
    let triangles = (0..mesh.triangles.len()).map(|i| (i as u32, mesh.corners(i))).collect();
    let tree = Bvh::new(triangles);
    let distances = points.par_iter().filter_map(|&p| tree.nearest(p, 0));
    distances.map(|hit| hit.squared).reduce(|| 0.0, f64::max).sqrt()
}

/// Volume of the solid. The enclosed volume of a closed mesh counts each point as often as the mesh winds around it:
/// the excess (or the wrong sign) at the points of a sampled grid is subtracted, and a simple mesh keeps its exact
/// volume. The volume of an open mesh is sampled as a whole.
fn solid_volume(all: &Winding, bounds: (DVec3, DVec3), enclosed: f64) -> f64 {
    let tally = |block: Vec<Sample>| -> f64 {
        let cell = block.first().map_or(0.0, |(_, edge, _)| edge.element_product());
        block.iter().map(|(.., times)| times).sum::<f64>() * cell
    };
    let tallied: f64 = samples(all, bounds).into_iter().map(tally).sum();
    if all.closed { (enclosed - tallied).max(0.0) } else { tallied }
}

/// The middle of a cell, its edges, and how often a closed mesh winds around it too often; of an open one, whether it
/// is inside.
type Sample = (DVec3, DVec3, f64);

/// The samples of a grid over a mesh's box, in blocks of equal cells.
fn samples(all: &Winding, (lo, hi): (DVec3, DVec3)) -> Vec<Vec<Sample>> {
    let block = (hi - lo) / VOLUME_BLOCKS as f64;
    let blocks = (0..VOLUME_BLOCKS.pow(3)).into_par_iter().map(|i| {
        let corner = lo + block * DVec3::from_array(lattice(i, VOLUME_BLOCKS));
        let centre = corner + block / 2.0;
        let distance = all.tree.nearest(centre, 0).map_or(f64::INFINITY, |h| h.squared.sqrt());
        let uniform = all.closed && distance > block.length() / 2.0;
        let n = if uniform { 1 } else { VOLUME_SAMPLES };
        let cell = block / n as f64;
        let sample = |s: usize| {
            let p = corner + cell * (DVec3::from_array(lattice(s, n)) + 0.5);
            let w = all.at(p);
            let inside = if w > INSIDE { 1.0 } else { 0.0 };
            (p, cell, if all.closed { w - inside } else { inside })
        };
        (0..n.pow(3)).map(sample).collect()
    });
    blocks.collect()
}

fn lattice(i: usize, n: usize) -> [f64; 3] {
    [i % n, i / n % n, i / (n * n)].map(|x| x as f64)
}
