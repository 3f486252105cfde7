//! Two meshes beside each other: the triangles that cross, how deep the meshes overlap there, and how far they are
//! apart.
//!
//! Whether two triangles cross is decided by exact predicates (Shewchuk 1997) on the coordinates as given. What only
//! touches does not cross.

use super::ROUNDING;
use super::interior::bvh::{Bvh, closest_on_triangle};
use super::mesh::{TriMesh, width};
use super::topology::DisjointSets;
use glam::{DAffine3, DVec3};
use robust::{Coord3D, orient3d};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;

/// Crossings of triangles of one pair that are gathered; the depth where more cross is a lower bound.
const MOST_CROSSINGS: usize = 4096;
/// Corners of one mesh that are looked for inside the other, per pair.
const MOST_CORNERS: usize = 2048;
/// A narrowest direction is sought from each of at most this many normals, of the triangles that cross.
const MOST_NORMALS: usize = 48;
/// Smallest step of that search, rad: the width found is then within a millionth of the least one around.
const FINEST_TURN: f64 = 1e-3;
/// Points that are nearer to a plane than this share of their spread lie in it.
const FLAT: f64 = 1e-9;

/// A mesh, prepared to be held against others. In its own frame.
pub struct Surface {
    tree: Bvh,
    mesh: TriMesh,
    /// The triangles around each point: those of point i are `around[first[i]..first[i + 1]]`.
    first: Vec<u32>,
    around: Vec<u32>,
    bounds: (DVec3, DVec3),
}

/// A crossing of two triangles: their names, and the points where an edge of one passes through the other.
struct Crossing {
    triangles: [u32; 2],
    points: Vec<DVec3>,
}

impl Surface {
    pub fn new(mesh: &TriMesh) -> Surface {
        let mesh = mesh.outward().into_owned();
        let tree = Bvh::new((0..mesh.triangles.len()).map(|i| (i as u32, mesh.corners(i))).collect());
        let mut first = vec![0u32; mesh.points.len() + 1];
        mesh.triangles.iter().flatten().for_each(|&v| first[v as usize + 1] += 1);
        for i in 1..first.len() {
            first[i] += first[i - 1];
        }
        let (mut next, mut around) = (first.clone(), vec![0; 3 * mesh.triangles.len()]);
        for (i, triangle) in mesh.triangles.iter().enumerate() {
            for &v in triangle {
                around[next[v as usize] as usize] = i as u32;
                next[v as usize] += 1;
            }
        }
        let bounds = mesh.bounds();
        Surface { tree, mesh, first, around, bounds }
    }

    /// The box around the mesh seen through `map`.
    pub fn bounds(&self, map: &DAffine3) -> (DVec3, DVec3) {
        let (lo, hi) = self.bounds;
        let corner = |i: usize| DVec3::new([lo.x, hi.x][i & 1], [lo.y, hi.y][i >> 1 & 1], [lo.z, hi.z][i >> 2]);
        super::mesh::bounds((0..8).map(|i| map.transform_point3(corner(i))))
    }

    /// The height of the mesh's lowest point, seen through `map`.
    pub fn lowest(&self, map: &DAffine3) -> f64 {
        self.mesh.points.iter().map(|p| map.transform_point3(*p).y).fold(f64::INFINITY, f64::min)
    }

    /// Whether a triangle of this mesh crosses one of the other. `map`: from the other's frame to this one's.
    pub fn crosses(&self, other: &Surface, map: &DAffine3) -> bool {
        let mut found = false;
        self.visit_crossings(other, map, |_| {
            found = true;
            ControlFlow::Break(())
        });
        found
    }

    fn visit_crossings(&self, other: &Surface, map: &DAffine3, mut found: impl FnMut(Crossing) -> ControlFlow<()>) {
        let (own, theirs) = (self.tree.triangles(), other.tree.triangles());
        self.tree.visit_pairs(&other.tree, map, 0.0, |[i, j], reach| {
            let placed = theirs[j as usize].map(|p| map.transform_point3(p));
            if boxes_apart(&own[i as usize], &placed) > 0.0 {
                return ControlFlow::Continue(reach);
            }
            let points = crossing(&own[i as usize], &placed);
            if points.is_empty() {
                return ControlFlow::Continue(reach);
            }
            let triangles = [self.tree.name(i), other.tree.name(j)];
            found(Crossing { triangles, points })?;
            ControlFlow::Continue(reach)
        });
    }

    /// Distance between the meshes, if it is less than `limit`; 0 where they cross or touch.
    pub fn distance(&self, other: &Surface, map: &DAffine3, limit: f64) -> Option<f64> {
        let (own, theirs) = (self.tree.triangles(), other.tree.triangles());
        let mut nearest = None;
        self.tree.visit_pairs(&other.tree, map, limit, |[i, j], reach| {
            let placed = theirs[j as usize].map(|p| map.transform_point3(p));
            if boxes_apart(&own[i as usize], &placed) > reach * reach {
                return ControlFlow::Continue(reach);
            }
            let found = triangle_distance(&own[i as usize], &placed);
            if found < reach {
                nearest = Some(found);
            }
            if found > 0.0 { ControlFlow::Continue(reach.min(found)) } else { ControlFlow::Break(()) }
        });
        nearest
    }

    /// How deep the meshes overlap: `None` where no two triangles cross. The parts of space that both enclose (as far
    /// as crossings and corners show them) are looked at one by one; the depth of one is its width in its narrowest
    /// direction, by which the meshes must be moved apart there. An open sheet's is that within its plane. Of several
    /// parts the deepest.
    pub fn overlap(&self, other: &Surface, map: &DAffine3) -> Option<Overlap> {
        let mut crossings = Vec::new();
        self.visit_crossings(other, map, |found| {
            crossings.push(found);
            if crossings.len() < MOST_CROSSINGS { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        });
        if crossings.is_empty() {
            return None;
        }
        let back = map.inverse();
        let names = |k: usize| crossings.iter().map(move |c| c.triangles[k]).collect::<BTreeSet<u32>>();
        let within = [
            (self.corners_within(names(0), |p| other.contains(back.transform_point3(p)))),
            (other.corners_within(names(1), |p| self.contains(map.transform_point3(p)))),
        ];
        // Crossings belong together where a triangle, or the surface between two corners inside, joins them.
        let mut numbers: BTreeMap<(usize, u32), usize> = BTreeMap::new();
        let own = |k: usize| if k == 0 { self } else { other };
        let crossed = crossings.iter().flat_map(|c| [(0, c.triangles[0]), (1, c.triangles[1])]);
        let inner =
            (0..2).flat_map(|k| within[k].iter().flat_map(move |&v| own(k).beside(v).iter().map(move |&t| (k, t))));
        for key in crossed.chain(inner) {
            let next = numbers.len();
            numbers.entry(key).or_insert(next);
        }
        let mut sets = DisjointSets::new(numbers.len());
        for c in &crossings {
            sets.join(numbers[&(0, c.triangles[0])], numbers[&(1, c.triangles[1])]);
        }
        for k in 0..2 {
            for &v in &within[k] {
                let beside = own(k).beside(v);
                beside.iter().for_each(|&t| sets.join(numbers[&(k, beside[0])], numbers[&(k, t)]));
            }
        }
        let mut regions: BTreeMap<usize, Region> = BTreeMap::new();
        for c in &crossings {
            let region = regions.entry(sets.find(numbers[&(0, c.triangles[0])])).or_default();
            region.points.extend(&c.points);
            let own = normal(self.mesh.corners(c.triangles[0] as usize));
            let theirs = normal(other.mesh.corners(c.triangles[1] as usize).map(|p| map.transform_point3(p)));
            region.normals.extend([own, theirs]);
            region.outward += own - theirs;
        }
        for k in 0..2 {
            for &v in &within[k] {
                let place = own(k).mesh.points[v as usize];
                let place = if k == 0 { place } else { map.transform_point3(place) };
                regions.entry(sets.find(numbers[&(k, own(k).beside(v)[0])])).or_default().points.push(place);
            }
        }
        let parts = regions.values().map(Region::overlap);
        parts.reduce(|a, b| if b.depth > a.depth { b } else { a })
    }

    fn beside(&self, point: u32) -> &[u32] {
        &self.around[self.first[point as usize] as usize..self.first[point as usize + 1] as usize]
    }

    fn contains(&self, p: DVec3) -> bool {
        let (lo, hi) = self.bounds;
        // A far node counts as its two first moments, as in `interior`.
        p.cmpge(lo).all() && p.cmple(hi).all() && self.tree.winding_number(p, 2.0) > 0.5
    }

    /// The corners of these triangles, and from there on of all their neighbours, that are inside.
    fn corners_within(&self, triangles: BTreeSet<u32>, is_inside: impl Fn(DVec3) -> bool) -> BTreeSet<u32> {
        let mut front: Vec<u32> = triangles.iter().flat_map(|&t| self.mesh.triangles[t as usize]).collect();
        let (mut seen, mut inside) = (BTreeSet::new(), BTreeSet::new());
        while let Some(v) = front.pop() {
            if seen.len() == MOST_CORNERS {
                break;
            }
            if seen.insert(v) && is_inside(self.mesh.points[v as usize]) {
                inside.insert(v);
                front.extend(self.beside(v).iter().flat_map(|&t| self.mesh.triangles[t as usize]));
            }
        }
        inside
    }
}

/// How two meshes overlap.
#[derive(Clone, Copy, Debug)]
pub struct Overlap {
    pub depth: f64,
    /// The other mesh leaves the overlap along this, by the depth; unit.
    pub way_out: DVec3,
}

/// A part of space that two meshes share, by points of its surface.
#[derive(Default)]
struct Region {
    points: Vec<DVec3>,
    /// Of the triangles that cross, unit.
    normals: Vec<DVec3>,
    /// The sum of those of the first mesh, less those of the other.
    outward: DVec3,
}

impl Region {
    fn overlap(&self) -> Overlap {
        let (depth, along) = self.width();
        Overlap { depth, way_out: if along.dot(self.outward) < 0.0 { -along } else { along } }
    }

    /// The width in the narrowest direction found, from the normals of the crossing triangles on, and that direction.
    fn width(&self) -> (f64, DVec3) {
        let extent = |direction: DVec3| width(&self.points, direction).max(0.0);
        let stride = self.normals.len().div_ceil(MOST_NORMALS).max(1);
        let starts = self.normals.iter().step_by(stride).copied().chain([DVec3::X, DVec3::Y, DVec3::Z]);
        let best = starts.filter(|n| *n != DVec3::ZERO).map(|n| (extent(n), n)).min_by(|a, b| a.0.total_cmp(&b.0));
        let Some(best) = best else { return (0.0, DVec3::Y) };
        let (width, direction) = refined(best, &extent, |n, k| {
            let (u, v) = n.any_orthonormal_pair();
            let angle = std::f64::consts::TAU * f64::from(k) / 8.0;
            u * libm::cos(angle) + v * libm::sin(angle)
        });
        let (u, v) = direction.any_orthonormal_pair();
        if width > FLAT * extent(u).max(extent(v)) {
            return (width, direction);
        }
        // Flat: one of the two is a sheet.
        let turned = |k: u32| {
            let angle = std::f64::consts::PI * f64::from(k) / 16.0;
            u * libm::cos(angle) + v * libm::sin(angle)
        };
        let best = (0..16).map(|k| (extent(turned(k)), turned(k))).min_by(|a, b| a.0.total_cmp(&b.0));
        let across = |n: DVec3, k: u32| direction.cross(n) * if k.is_multiple_of(2) { 1.0 } else { -1.0 };
        best.map_or((0.0, direction), |best| refined(best, &extent, across))
    }
}

/// Turns a direction towards others, by smaller and smaller angles, as long as the extent along it falls.
fn refined(
    mut best: (f64, DVec3),
    extent: &impl Fn(DVec3) -> f64,
    other: impl Fn(DVec3, u32) -> DVec3,
) -> (f64, DVec3) {
    let mut turn = 0.3;
    while turn > FINEST_TURN {
        let tried = (0..8).map(|k| (best.1 + other(best.1, k) * turn).normalize()).map(|n| (extent(n), n));
        match tried.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|found| found.0 < best.0) {
            Some(found) => best = found,
            None => turn /= 2.0,
        }
    }
    best
}

fn normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a).normalize_or_zero()
}

/// Positive where `p` is behind the triangle, whose corners are counterclockwise from its front; exact in sign.
fn side(p: DVec3, [a, b, c]: &[DVec3; 3]) -> f64 {
    let coord = |p: DVec3| Coord3D { x: p.x, y: p.y, z: p.z };
    orient3d(coord(*a), coord(*b), coord(*c), coord(p))
}

/// The points where an edge of one triangle passes through the other one; none where they do not cross.
fn crossing(t: &[DVec3; 3], u: &[DVec3; 3]) -> Vec<DVec3> {
    let of_u = u.map(|p| side(p, t));
    if of_u.iter().all(|&s| s >= 0.0) || of_u.iter().all(|&s| s <= 0.0) {
        return Vec::new();
    }
    let of_t = t.map(|p| side(p, u));
    if of_t.iter().all(|&s| s >= 0.0) || of_t.iter().all(|&s| s <= 0.0) {
        return Vec::new();
    }
    let (mut points, mut is_proper) = (Vec::new(), false);
    for (edges, sides, face) in [(u, of_u, t), (t, of_t, u)] {
        for i in 0..3 {
            let j = (i + 1) % 3;
            let (p, q, s, e) = (edges[i], edges[j], sides[i], sides[j]);
            if (s > 0.0) == (e > 0.0) || s == 0.0 || e == 0.0 {
                continue;
            }
            if let Some(inside) = passes_through(p, q, face) {
                points.push(p + (q - p) * (s / (s - e)));
                is_proper |= inside;
            }
        }
    }
    // Rim on rim at one place only, they touch.
    let size = t[0].distance(t[1]).max(t[0].distance(t[2]));
    if !is_proper && points.iter().all(|p: &DVec3| p.distance(points[0]) <= ROUNDING * size) {
        points.clear();
    }
    points
}

/// Whether the line through two points on either side of a triangle's plane passes through the inside of the triangle:
/// `Some(false)` on its rim, `None` beside it.
fn passes_through(p: DVec3, q: DVec3, [a, b, c]: &[DVec3; 3]) -> Option<bool> {
    let around = [side(*b, &[p, q, *a]), side(*c, &[p, q, *b]), side(*a, &[p, q, *c])];
    let hits = around.iter().all(|&s| s >= 0.0) || around.iter().all(|&s| s <= 0.0);
    hits.then(|| around.iter().all(|&s| s != 0.0))
}

/// Square of the distance between the boxes around two triangles.
fn boxes_apart(t: &[DVec3; 3], u: &[DVec3; 3]) -> f64 {
    let low = |[a, b, c]: &[DVec3; 3]| a.min(*b).min(*c);
    let high = |[a, b, c]: &[DVec3; 3]| a.max(*b).max(*c);
    (low(t) - high(u)).max(low(u) - high(t)).max(DVec3::ZERO).length_squared()
}

fn triangle_distance(t: &[DVec3; 3], u: &[DVec3; 3]) -> f64 {
    if !crossing(t, u).is_empty() {
        return 0.0;
    }
    let corners = |t: &[DVec3; 3], u: &[DVec3; 3]| {
        t.iter().map(|&p| p.distance_squared(closest_on_triangle(p, u))).fold(f64::INFINITY, f64::min)
    };
    let mut least = corners(t, u).min(corners(u, t));
    for i in 0..3 {
        for j in 0..3 {
            least = least.min(segment_distance_squared([t[i], t[(i + 1) % 3]], [u[j], u[(j + 1) % 3]]));
        }
    }
    least.sqrt()
}

/// Ericson, "Real-Time Collision Detection" (2005), 5.1.9.
fn segment_distance_squared([p, q]: [DVec3; 2], [r, s]: [DVec3; 2]) -> f64 {
    let (d, e, w) = (q - p, s - r, p - r);
    let (a, b, c, f, g) = (d.length_squared(), d.dot(e), d.dot(w), e.length_squared(), e.dot(w));
    if a <= 0.0 || f <= 0.0 {
        // The corners are looked at anyway.
        return f64::INFINITY;
    }
    let whole = a * f - b * b;
    let at = if whole > 0.0 { ((b * g - c * f) / whole).clamp(0.0, 1.0) } else { 0.0 };
    let beside = (b * at + g) / f;
    let (at, beside) = match beside {
        x if x < 0.0 => ((-c / a).clamp(0.0, 1.0), 0.0),
        x if x > 1.0 => (((b - c) / a).clamp(0.0, 1.0), 1.0),
        x => (at, x),
    };
    (p + d * at).distance_squared(r + e * beside)
}

#[cfg(test)]
mod tests;
