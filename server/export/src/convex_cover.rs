//! A triangle mesh as convex solids, for engines that know no other: each part of it that is convex is one; the other
//! triangles become thin plates, whose outer faces are the triangles.

use cairn_engine::shape::hull_mesh;
use cairn_geometry::mesh::{TriMesh, boxes_meet};
use cairn_geometry::topology::{DisjointSets, inspect, parts, weld};
use glam::DVec3;
use std::collections::BTreeMap;

/// A part is convex if its hull is larger by this share at most.
const CONVEX: f64 = 1e-4;
/// How much smaller the inner face of a plate is, so that plates of an edge do not stick out of each other's faces.
const TAPER: f64 = 0.25;

/// Triangles lower than this share of their longest edge carry nothing.
const SLIVER: f64 = 1e-4;

/// What a cover is made for.
pub struct CoverLimits {
    /// Only what is within this box matters.
    pub bounds: (DVec3, DVec3),
    /// Thickness of plates, m; smaller triangles have thinner ones.
    pub thickness: f64,
    /// Solids at most.
    pub most: usize,
}

/// Convex solids, each the hull of its points.
pub struct ConvexCover {
    pub solids: Vec<Vec<DVec3>>,
    /// How many of them are plates; the last ones.
    pub plates: usize,
    /// Triangles that none of them has.
    pub left_out: usize,
}

impl ConvexCover {
    pub fn new(mesh: &TriMesh, limits: &CoverLimits) -> ConvexCover {
        let mesh = weld(mesh, 0.0);
        let (mut solids, mut left_out) = (Vec::new(), 0);
        // With their distances from the middle.
        let mut plates: Vec<(f64, Vec<DVec3>)> = Vec::new();
        let middle = (limits.bounds.0 + limits.bounds.1) / 2.0;
        for part in parts(&mesh).into_iter().flat_map(|triangles| pieces(&mesh, triangles)) {
            if !meets(part.bounds(), limits.bounds) {
                left_out += part.triangles.len();
                continue;
            }
            let (is_closed, volume) = (is_closed(&part), part.signed_volume());
            let hull = if is_closed { hull_mesh(&part.points) } else { TriMesh::default() };
            if !hull.points.is_empty() && hull.signed_volume() <= volume.abs() * (1.0 + CONVEX) {
                solids.push(hull.points);
                continue;
            }
            let inward = if is_closed { -volume.signum() } else { 0.0 };
            for number in 0..part.triangles.len() {
                let corners = part.corners(number);
                let (low, high) = corners.iter().fold((corners[0], corners[0]), |(l, h), &p| (l.min(p), h.max(p)));
                if !meets((low, high), limits.bounds) {
                    left_out += 1;
                } else if let Some(points) = plate(corners, inward, limits.thickness) {
                    plates.push((corners.iter().sum::<DVec3>().distance_squared(3.0 * middle), points));
                }
            }
        }
        plates.sort_by(|a, b| a.0.total_cmp(&b.0));
        let room = limits.most.saturating_sub(solids.len());
        left_out += plates.len().saturating_sub(room);
        let count = plates.len().min(room);
        solids.extend(plates.into_iter().take(room).map(|(_, points)| points));
        ConvexCover { solids, plates: count, left_out }
    }
}

fn meets(a: (DVec3, DVec3), b: (DVec3, DVec3)) -> bool {
    boxes_meet(a, b, DVec3::ZERO)
}

/// A part, or what it is made of where solids only meet along edges, as the boxes of a crate do.
fn pieces(mesh: &TriMesh, triangles: Vec<[u32; 3]>) -> Vec<TriMesh> {
    let piece = |triangles: Vec<[u32; 3]>| weld(&TriMesh { points: mesh.points.clone(), triangles }, 0.0);
    let mut edges: BTreeMap<[u32; 2], Vec<usize>> = BTreeMap::new();
    for (number, &[a, b, c]) in triangles.iter().enumerate() {
        for [a, b] in [[a, b], [b, c], [c, a]] {
            edges.entry([a.min(b), a.max(b)]).or_default().push(number);
        }
    }
    let mut sets = DisjointSets::new(triangles.len());
    edges.values().filter(|sides| sides.len() == 2).for_each(|sides| sets.join(sides[0], sides[1]));
    let mut apart: BTreeMap<usize, Vec<[u32; 3]>> = BTreeMap::new();
    triangles.iter().enumerate().for_each(|(number, t)| apart.entry(sets.find(number)).or_default().push(*t));
    let apart: Vec<TriMesh> = apart.into_values().map(piece).collect();
    if apart.iter().all(is_closed) { apart } else { vec![piece(triangles)] }
}

/// Whether it bounds a solid.
fn is_closed(mesh: &TriMesh) -> bool {
    inspect(mesh).bounds_a_solid()
}

/// A triangle with a thickness: on the side that `inward` says (1: where its normal points), or half on each side.
/// `None`: it has no area.
fn plate(corners: [DVec3; 3], inward: f64, thickness: f64) -> Option<Vec<DVec3>> {
    let [a, b, c] = corners;
    let area = (b - a).cross(c - a);
    let normal = area.try_normalize()?;
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let height = area.length() / longest;
    if height < SLIVER * longest {
        return None;
    }
    let thickness = thickness.min(height);
    if inward == 0.0 {
        return Some(
            corners.iter().flat_map(|&p| [p - normal * thickness / 2.0, p + normal * thickness / 2.0]).collect(),
        );
    }
    let center = (a + b + c) / 3.0;
    let inner = |p: DVec3| p.lerp(center, TAPER) + normal * inward * thickness;
    Some(corners.iter().flat_map(|&p| [p, inner(p)]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits(most: usize) -> CoverLimits {
        CoverLimits { bounds: (DVec3::splat(-10.0), DVec3::splat(10.0)), thickness: 0.1, most }
    }

    /// An L of height 1: closed, and not convex.
    fn corner() -> TriMesh {
        let outline = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        let at = |y: f64| outline.map(|[x, z]| DVec3::new(x, y, -z));
        let points = [at(0.0), at(1.0)].concat();
        let caps = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]];
        let mut triangles: Vec<[u32; 3]> = caps.iter().map(|t| t.map(|v| v + 6)).collect();
        triangles.extend(caps.map(|[a, b, c]| [a, c, b]));
        for i in 0..6 {
            let next = (i + 1) % 6;
            triangles.extend([[i, next, next + 6], [i, next + 6, i + 6]]);
        }
        TriMesh { points, triangles }
    }

    #[test]
    fn what_is_convex_is_one_solid_and_the_rest_is_plates() {
        let corner = corner();
        assert!((corner.signed_volume() - 3.0).abs() < 1e-9);
        let cube = hull_mesh(
            &[0.0, 1.0].map(|x| [0.0, 1.0].map(|y| [5.0, 6.0].map(|z| DVec3::new(x, y, z)))).concat().concat(),
        );
        let mut both = corner.clone();
        both.append(&cube);
        let cover = ConvexCover::new(&both, &limits(100));
        assert_eq!((cover.solids.len(), cover.left_out), (1 + corner.triangles.len(), 0));
        // All of the corner's plates are within it, but for what tapers: nothing lies in the open quarter.
        let is_open = |p: &DVec3| p.x > 1.001 && -p.z > 1.001 && -p.z < 4.0;
        assert!(!cover.solids.iter().flatten().any(is_open));
        let volume: f64 = cover.solids.iter().map(|points| hull_mesh(points).signed_volume()).sum();
        assert!(volume > 1.2 && volume < 1.0 + corner.area() * 0.1, "{volume}");
    }

    #[test]
    fn what_is_far_or_too_much_is_counted() {
        let corner = corner();
        let cover = ConvexCover::new(&corner, &limits(5));
        assert_eq!((cover.solids.len(), cover.left_out), (5, corner.triangles.len() - 5));
        let far = CoverLimits { bounds: (DVec3::splat(5.0), DVec3::splat(6.0)), ..limits(100) };
        let cover = ConvexCover::new(&corner, &far);
        assert_eq!((cover.solids.len(), cover.left_out), (0, corner.triangles.len()));
    }

    #[test]
    fn boxes_that_share_an_edge_are_solids_of_their_own() {
        let cube = |at: [f64; 3]| {
            let corner = |i: usize| DVec3::from(at) + DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64);
            hull_mesh(&(0..8).map(corner).collect::<Vec<_>>())
        };
        let mut stairs = cube([0.0; 3]);
        stairs.append(&cube([1.0, 1.0, 0.0]));
        let cover = ConvexCover::new(&stairs, &limits(9));
        assert_eq!((cover.solids.len(), cover.left_out), (2, 0));
    }

    #[test]
    fn a_sheet_has_both_sides() {
        let sheet = TriMesh { points: vec![DVec3::ZERO, DVec3::X, DVec3::Y], triangles: vec![[0, 1, 2]] };
        let cover = ConvexCover::new(&sheet, &limits(9));
        let heights: Vec<f64> = cover.solids[0].iter().map(|p| p.z).collect();
        assert_eq!(heights, [-0.05, 0.05, -0.05, 0.05, -0.05, 0.05]);
    }
}
