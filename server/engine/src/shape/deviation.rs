//! The distance of a mesh from the convex parts that stand for it.

use super::convex::Part;
use super::hull::Hull;
use cairn_geometry::hull::convex_hull;
use rapier3d::math::Vector;
use rapier3d::parry::partitioning::BvhNode;
use rapier3d::parry::query::PointQuery;
use rapier3d::parry::shape::TriMesh as EngineMesh;

/// A ray passes a triangle of a mesh of size 1 no farther outside of its box, by rounding.
const BOX_ROUNDING: f32 = 1e-5;
/// Points sampled on each surface to measure the deviation.
const DEVIATION_SAMPLES: usize = 600;

/// Largest distance between sampled points of the mesh and the parts, and of the parts' outer surface and the mesh;
/// both in the unit frame.
pub(super) fn deviation(mesh: &EngineMesh, is_inside: impl Fn(Vector) -> bool, parts: &[Part]) -> f64 {
    let hulls: Vec<(Hull, EngineMesh)> = parts
        .iter()
        .filter_map(|Part { coarse, .. }| {
            let hull = Hull::new(coarse)?;
            let (points, triangles) = convex_hull(coarse)?;
            Some((hull, EngineMesh::new(points, triangles).ok()?))
        })
        .collect();
    if hulls.is_empty() {
        return f64::INFINITY;
    }
    let to_parts = surface_samples(mesh).into_iter().map(|p| {
        let near = |h: &(Hull, EngineMesh)| h.0.distance_to_local_point(p, true);
        hulls.iter().map(near).fold(f32::INFINITY, f32::min)
    });
    let mut worst = to_parts.fold(0.0, f32::max);
    for (i, (_, surface)) in hulls.iter().enumerate() {
        for p in surface_samples(surface) {
            let buried = hulls.iter().enumerate().any(|(j, h)| j != i && h.0.contains_local_point(p));
            if !buried {
                // Outside the mesh only: inside, a part takes no space but the prop's.
                let inside = is_inside(p);
                worst = worst.max(if inside { 0.0 } else { mesh.distance_to_local_point(p, false) });
            }
        }
    }
    worst as f64
}

/// Even-odd test along one fixed skew direction.
pub(super) fn mesh_contains(mesh: &EngineMesh, p: Vector) -> bool {
    let direction = Vector::new(0.5377, 0.7314, 0.4196);
    let inverse = direction.recip();
    // The box, and a little more than rounding takes.
    let may_cross = |node: &BvhNode| {
        let (near, far) = ((node.mins() - p - BOX_ROUNDING) * inverse, (node.maxs() - p + BOX_ROUNDING) * inverse);
        let (enters, leaves) = (near.max_element(), far.min_element());
        leaves >= 0.0 && enters <= leaves
    };
    let crossings = mesh.bvh().leaves(may_cross).filter(|&i| {
        let t = mesh.triangle(i);
        let (e1, e2, s) = (t.b - t.a, t.c - t.a, p - t.a);
        let h = direction.cross(e2);
        let det = e1.dot(h);
        if det == 0.0 {
            return false;
        }
        let u = s.dot(h) / det;
        let q = s.cross(e1);
        let v = direction.dot(q) / det;
        u >= 0.0 && v >= 0.0 && u + v <= 1.0 && e2.dot(q) / det > 0.0
    });
    crossings.count() % 2 == 1
}

/// Points spread over a surface in proportion to area, deterministic.
pub(super) fn surface_samples(mesh: &EngineMesh) -> Vec<Vector> {
    let areas: Vec<f32> = mesh.triangles().map(|t| (t.b - t.a).cross(t.c - t.a).length()).collect();
    let total: f32 = areas.iter().sum();
    let step = total / DEVIATION_SAMPLES as f32;
    let (mut carried, mut out) =
        (0.0, mesh.vertices().iter().step_by(1 + mesh.vertices().len() / 400).copied().collect::<Vec<_>>());
    for (t, area) in mesh.triangles().zip(areas) {
        carried += area;
        let n = if step > 0.0 { (carried / step) as usize } else { 0 };
        carried -= n as f32 * step;
        for k in 0..n {
            // The R2 sequence, folded into the triangle.
            let (mut u, mut v) = ((0.7548777 * (k + 1) as f32).fract(), (0.5698403 * (k + 1) as f32).fract());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            out.push(t.a + (t.b - t.a) * u + (t.c - t.a) * v);
        }
    }
    out
}
