//! The winding number of a closed mesh by the signed crossings of a ray: exact, and as fast on the long thin triangles
//! of CAD models, where the far-field series finds nothing to be far.
//!
//! Edges are judged as in Woop et al., "Watertight ray/triangle intersection" (2013): the two triangles at an edge
//! compute the same number with opposite signs, so that a ray never slips between them.

use super::bvh::Bvh;
use crate::mesh::TriMesh;
use crate::weld::merged;
use crate::{ROUNDING, SINGLE_PRECISION};
use glam::DVec3;
use std::collections::HashMap;

/// Rays toward +Z, as (x, y) slopes: no modeller's plane runs along one of them. A ray that meets an edge or a corner
/// exactly gives way to the next.
pub(super) const SLOPES: [(f64, f64); 4] =
    [(0.41134, 0.23371), (-0.29177, 0.37143), (0.13391, -0.45317), (-0.36971, -0.17389)];

/// The mesh with points that are the same merged, and whether it is then closed: every edge is used as often in one
/// direction as in the other. Then, and only then, is the winding number a whole number everywhere. Points are the same
/// when their coordinates are; if that leaves holes, also when an exporter may have rounded one point twice.
pub(super) fn welded(mesh: &TriMesh, diagonal: f64) -> (TriMesh, bool) {
    let welded = |mesh: &TriMesh, reach: f64| {
        let (numbers, points) = merged(&mesh.points, reach);
        TriMesh { points, triangles: mesh.triangles.iter().map(|t| t.map(|v| numbers[v as usize])).collect() }
    };
    let exact = welded(mesh, 0.0);
    if is_closed(&exact) {
        return (exact, true);
    }
    let near = welded(&exact, SINGLE_PRECISION * diagonal);
    if is_closed(&near) { (near, true) } else { (exact, false) }
}

fn is_closed(mesh: &TriMesh) -> bool {
    let mut balance: HashMap<(u32, u32), i64> = HashMap::new();
    for &[a, b, c] in &mesh.triangles {
        for (p, q) in [(a, b), (b, c), (c, a)].into_iter().filter(|(p, q)| p != q) {
            *balance.entry((p.min(q), p.max(q))).or_default() += if p < q { 1 } else { -1 };
        }
    }
    balance.values().all(|&b| b == 0)
}

/// Winding number of the mesh around a point. `None` if every ray meets an edge exactly, or the point is on a triangle.
pub(super) fn crossings(tree: &Bvh, p: DVec3) -> Option<i32> {
    SLOPES.iter().find_map(|&slope| cast(tree, p, slope))
}

fn cast(tree: &Bvh, p: DVec3, (x, y): (f64, f64)) -> Option<i32> {
    let mut winding = 0;
    let slopes = DVec3::new(x, y, 1.0);
    let clean = tree.visit(
        |lo, hi| {
            let (a, b) = ((lo - p) / slopes, (hi - p) / slopes);
            let enter = a.min(b).max_element().max(0.0);
            let leave = a.max(b).min_element();
            enter <= leave + ROUNDING * (enter.abs() + leave.abs())
        },
        |triangle| {
            let crossing = cross(triangle.map(|v| v - p), x, y);
            winding += crossing.unwrap_or(0);
            crossing.is_some()
        },
    );
    clean.then_some(winding)
}

/// 1 if the ray from the origin leaves through the triangle's front, -1 if it enters there, 0 if it misses; `None` if
/// it meets an edge or starts on the triangle.
fn cross(triangle: [DVec3; 3], x: f64, y: f64) -> Option<i32> {
    let [a, b, c] = triangle.map(|v| DVec3::new(v.x - x * v.z, v.y - y * v.z, v.z));
    let (u, v, w) = (c.x * b.y - c.y * b.x, a.x * c.y - a.y * c.x, b.x * a.y - b.y * a.x);
    let (low, high) = (u.min(v).min(w), u.max(v).max(w));
    // All zero: a triangle without area as the ray sees it; its neighbours meet the ray too.
    if low < 0.0 && high > 0.0 || low == 0.0 && high == 0.0 {
        return Some(0);
    }
    if u == 0.0 || v == 0.0 || w == 0.0 {
        return None;
    }
    let along = (u * a.z + v * b.z + w * c.z) / (u + v + w);
    let size = a.abs().max(b.abs()).max(c.abs()).max_element();
    // Where two parts touch, rounding must not count one of the two faces alone.
    if along.abs() <= ROUNDING * size {
        return None;
    }
    Some(if along < 0.0 {
        0
    } else if high < 0.0 {
        1
    } else {
        -1
    })
}
