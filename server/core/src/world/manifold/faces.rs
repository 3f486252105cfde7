//! Two convex shapes with faces: the polygon in which the faces that look at each other overlap, seen along the normal of
//! the contact, and the closest points.

use super::{Meeting, Points};
use rapier3d::parry::query::ContactManifold;
use rapier3d::parry::query::details::{
    NormalConstraints, NormalConstraintsPair, contact_support_map_support_map_with_params,
};
use rapier3d::parry::query::gjk::{GJKResult, VoronoiSimplex};
use rapier3d::parry::shape::{PackedFeatureId, PolygonalFeature, Shape};
use rapier3d::prelude::*;

/// Manifolds are kept while the shapes have turned and moved by less than this: cosine of a degree, and square of a
/// thousandth of an engine unit. The engine's own bounds.
const SAME_TURN: f32 = 0.999_847_7;
const SAME_PLACE: f32 = 1e-6;
/// The closest points are one of the polygon's corners if they are no closer than those by more than this, engine units.
const CLOSER: f32 = 1e-4;
/// Where a mesh's edges bend the normal of a contact, points deeper than this many times the depth along the true one are
/// no contacts of this pair.
const BENT_DEPTH: f32 = 5.0;

/// Whether a shape has faces with corners, and no rounding.
pub(super) fn has_faces(shape: &dyn Shape) -> bool {
    shape.as_polygonal_feature_map().is_some_and(|(_, border)| border == 0.0)
}

/// Both shapes have faces. `pos12`: of the second shape, in the frame of the first.
pub(super) fn meet<M, C: Default + Copy>(
    pos12: &Pose,
    a: &dyn Shape,
    b: &dyn Shape,
    constraints: (Option<&dyn NormalConstraints>, Option<&dyn NormalConstraints>),
    prediction: f32,
    points: Points,
    manifold: &mut ContactManifold<M, C>,
) {
    let (Some(solid_a), Some(solid_b)) = (a.as_support_map(), b.as_support_map()) else { return };
    if manifold.try_update_contacts_eps(pos12, SAME_TURN, SAME_PLACE) {
        return;
    }
    let guess = manifold.local_n1.try_normalize();
    let mut simplex = VoronoiSimplex::new();
    let found = contact_support_map_support_map_with_params(pos12, solid_a, solid_b, prediction, &mut simplex, guess);
    let before = std::mem::take(&mut manifold.points);
    match found {
        GJKResult::ClosestPoints(on_a, on_b, direction) => {
            let (mut normal, mut back) = (direction, pos12.rotation.inverse() * -direction);
            if !constraints.project_local_normals(pos12, &mut normal, &mut back) {
                return;
            }
            let depth = (on_b - on_a).dot(normal);
            let faces = [face(a, normal), face(b, back).moved(pos12)];
            let mut all = overlap(&faces, normal);
            if normal != direction {
                all.retain(|m| depth >= 0.0 || m.gap >= BENT_DEPTH * depth);
            } else if !all.iter().any(|m| m.gap <= depth + CLOSER) {
                all.push(Meeting { at: [on_a, on_b], features: [PackedFeatureId::UNKNOWN; 2], gap: depth });
            }
            all.retain(|m| m.gap <= prediction);
            manifold.points.extend(points.of(all, normal).into_iter().map(|m| m.tracked(pos12, false)));
            (manifold.local_n1, manifold.local_n2) = (normal, back);
        }
        GJKResult::NoIntersection(direction) => manifold.local_n1 = direction,
        _ => manifold.local_n1 = Vector::ZERO,
    }
    manifold.match_contacts(&before);
}

/// A face as its corners, in order around it. Its corners need not lie in one plane: the engine takes faces for one whose
/// normals differ by a degree and a half.
struct Face {
    corners: Vec<Vector>,
    corner_names: Vec<PackedFeatureId>,
    edge_names: Vec<PackedFeatureId>,
    name: PackedFeatureId,
}

impl Face {
    fn moved(mut self, by: &Pose) -> Face {
        self.corners.iter_mut().for_each(|p| *p = by.transform_point(*p));
        self
    }
}

/// The face of a shape that looks most along `direction`.
fn face(shape: &dyn Shape, direction: Vector) -> Face {
    if let Some(hull) = shape.as_convex_polyhedron() {
        let faces = hull.faces().iter().enumerate();
        let best = faces.max_by(|(_, f), (_, g)| f.normal.dot(direction).total_cmp(&g.normal.dot(direction)));
        let Some((index, face)) = best else { return Face::from(&PolygonalFeature::default()) };
        let from = face.first_vertex_or_edge as usize;
        let around = from..from + face.num_vertices_or_edges as usize;
        let (corners, edges) = (&hull.vertices_adj_to_face()[around.clone()], &hull.edges_adj_to_face()[around]);
        return Face {
            corners: corners.iter().map(|&v| hull.points()[v as usize]).collect(),
            corner_names: corners.iter().map(|&v| PackedFeatureId::vertex(v)).collect(),
            edge_names: edges.iter().map(|&e| PackedFeatureId::edge(e)).collect(),
            name: PackedFeatureId::face(index as u32),
        };
    }
    let mut found = PolygonalFeature::default();
    if let Some((map, _)) = shape.as_polygonal_feature_map() {
        map.local_support_feature(direction, &mut found);
    }
    Face::from(&found)
}

impl From<&PolygonalFeature> for Face {
    fn from(feature: &PolygonalFeature) -> Face {
        let n = feature.num_vertices;
        Face {
            corners: feature.vertices[..n].to_vec(),
            corner_names: feature.vids[..n].to_vec(),
            edge_names: feature.eids[..n].to_vec(),
            name: feature.fid,
        }
    }
}

/// The corners of the polygon in which two faces overlap, seen along `normal`: corners of one within the other, and
/// crossings of their edges.
fn overlap(faces: &[Face; 2], normal: Vector) -> Vec<Meeting> {
    let (right, up) = normal.any_orthonormal_pair();
    let flat = |face: &Face| -> Vec<Vec2> { face.corners.iter().map(|p| Vec2::new(p.dot(right), p.dot(up))).collect() };
    let [a, b] = faces;
    let (flat_a, flat_b) = (flat(a), flat(b));
    let mut all = Vec::new();
    let mut add = |at: [Vector; 2], features| all.push(Meeting { at, features, gap: (at[1] - at[0]).dot(normal) });
    for (i, &p) in flat_a.iter().enumerate() {
        if let Some(below) = within(p, &flat_b, &b.corners) {
            add([a.corners[i], below], [a.corner_names[i], b.name]);
        }
    }
    for (i, &p) in flat_b.iter().enumerate() {
        if let Some(below) = within(p, &flat_a, &a.corners) {
            add([below, b.corners[i]], [a.name, b.corner_names[i]]);
        }
    }
    let next = |i: usize, n: usize| if i + 1 == n { 0 } else { i + 1 };
    for i in 0..flat_a.len() {
        let i2 = next(i, flat_a.len());
        for j in 0..flat_b.len() {
            let j2 = next(j, flat_b.len());
            if let Some((s, t)) = crossing([flat_a[i], flat_a[i2]], [flat_b[j], flat_b[j2]]) {
                let at = [a.corners[i].lerp(a.corners[i2], s), b.corners[j].lerp(b.corners[j2], t)];
                add(at, [a.edge_names[i], b.edge_names[j]]);
            }
        }
    }
    all
}

/// The point of a polygon above `p`, if there is one: by the triangles that fan out from its first corner.
fn within(p: Vec2, flat: &[Vec2], corners: &[Vector]) -> Option<Vector> {
    let first = *flat.first()?;
    (1..flat.len().saturating_sub(1)).find_map(|i| {
        let (u, v) = (flat[i] - first, flat[i + 1] - first);
        let area = u.perp_dot(v);
        let (s, t) = ((p - first).perp_dot(v) / area, u.perp_dot(p - first) / area);
        let inside = area != 0.0 && s >= 0.0 && t >= 0.0 && s + t <= 1.0;
        inside.then(|| corners[0] + (corners[i] - corners[0]) * s + (corners[i + 1] - corners[0]) * t)
    })
}

/// How far along two segments they cross, 0 to 1.
fn crossing([a, b]: [Vec2; 2], [c, d]: [Vec2; 2]) -> Option<(f32, f32)> {
    let (u, v) = (b - a, d - c);
    let area = u.perp_dot(v);
    let (s, t) = ((c - a).perp_dot(v) / area, (c - a).perp_dot(u) / area);
    let crosses = area != 0.0 && (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t);
    crosses.then_some((s, t))
}
