//! Two convex shapes with faces: where the sides that they turn to each other meet, seen along the normal of the contact.
//!
//! The gap between two such sides is a convex function over the plane across the normal, linear between its corners: those of
//! either side above a facet of the other, and the crossings of their edges. All of these that are near enough are points of
//! the contact.

use super::{Meeting, widest};
use crate::shape::Hull;
use rapier3d::parry::query::ContactManifold;
use rapier3d::parry::query::details::{
    NormalConstraints, NormalConstraintsPair, contact_support_map_support_map_with_params,
};
use rapier3d::parry::query::gjk::{GJKResult, VoronoiSimplex};
use rapier3d::parry::shape::{PackedFeatureId, PolygonalFeature, Shape, SupportMap};
use rapier3d::prelude::*;

/// Manifolds are kept while the shapes have turned and moved by less than this: cosine of a degree, and square of a
/// thousandth of an engine unit. The engine's own bounds.
const SAME_TURN: f32 = 0.999_847_7;
const SAME_PLACE: f32 = 1e-6;
/// The closest points are one of the others if they are no closer than those by more than this, engine units.
const CLOSER: f32 = 1e-4;
/// Where a mesh's edges bend the normal of a contact, points deeper than this many times the depth along the true one are
/// no contacts of this pair.
const BENT_DEPTH: f32 = 5.0;
/// Facets steeper than this, cosine, take no part: what touches them touches their edges as well.
const STEEP: f32 = 0.1;
/// How far outside a triangle a point may be, as a share of it: rounding.
const RIM: f32 = 1e-4;
/// The normal of a face is as good as the direction between the closest points if it tells the shapes no closer than those by
/// more than this, engine units: between faces nearer than [`NEAR`], that direction is all rounding.
const SEPARATION_NOISE: f32 = 1e-5;
const NEAR: f32 = 1e-3;

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
    most: usize,
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
            let depth = (on_b - on_a).dot(direction);
            let pair = Pair { pos12, solids: [solid_a, solid_b] };
            let direction = if depth.abs() < NEAR { pair.steadied(direction, depth, a, b) } else { direction };
            let (mut normal, mut back) = (direction, pos12.rotation.inverse() * -direction);
            if !constraints.project_local_normals(pos12, &mut normal, &mut back) {
                return;
            }
            let reach = prediction - pair.separation(normal);
            let view = View::along(normal);
            let first = view.side(a, &Pose::IDENTITY, Looks::AlongNormal, reach);
            let second = view.side(b, pos12, Looks::Against, reach);
            let mut all = corners(&view, &first, &second, reach);
            if normal != direction {
                all.retain(|m| depth >= 0.0 || m.gap >= BENT_DEPTH * depth);
            } else if !all.iter().any(|m| m.gap <= depth + CLOSER) {
                all.push(Meeting { at: [on_a, on_b], features: [PackedFeatureId::UNKNOWN; 2], gap: depth });
            }
            all.retain(|m| m.gap <= prediction);
            manifold.points.extend(widest(&all, normal, most).into_iter().map(|m| m.tracked(pos12, false)));
            (manifold.local_n1, manifold.local_n2) = (normal, back);
        }
        GJKResult::NoIntersection(direction) => manifold.local_n1 = direction,
        _ => manifold.local_n1 = Vector::ZERO,
    }
    manifold.match_contacts(&before);
}

/// `pos12`: of the second shape, in the frame of the first.
struct Pair<'a> {
    pos12: &'a Pose,
    solids: [&'a dyn SupportMap; 2],
}

impl Pair<'_> {
    /// How far apart the shapes are along a direction from the first to the second.
    fn separation(&self, direction: Vector) -> f32 {
        let [a, b] = self.solids;
        let far = b.local_support_point(self.pos12.rotation.inverse() * -direction);
        self.pos12.transform_point(far).dot(direction) - a.local_support_point(direction).dot(direction)
    }

    /// The direction of a contact, or the normal of a face that is as good.
    fn steadied(&self, direction: Vector, depth: f32, a: &dyn Shape, b: &dyn Shape) -> Vector {
        let back = self.pos12.rotation.inverse() * -direction;
        let of_b = face_normal(b, back).map(|n| -(self.pos12.rotation * n));
        let faces = [face_normal(a, direction), of_b].into_iter().flatten();
        let separate = faces.map(|n| (self.separation(n), n));
        let best = separate.max_by(|(s, _), (t, _)| s.total_cmp(t));
        best.filter(|&(s, _)| s >= depth - SEPARATION_NOISE).map_or(direction, |(_, n)| n)
    }
}

/// The normal of the face of a shape that looks most along `direction`.
fn face_normal(shape: &dyn Shape, direction: Vector) -> Option<Vector> {
    if let Some(hull) = shape.as_shape::<Hull>() {
        let normals = hull.facets().iter().map(|f| f.normal);
        return normals.max_by(|n, m| n.dot(direction).total_cmp(&m.dot(direction)));
    }
    let face = engine_face(shape, direction);
    let [a, b, c] = *face.vertices.first_chunk::<3>().filter(|_| face.num_vertices > 2)?;
    let normal = (b - a).cross(c - a).try_normalize()?;
    Some(if normal.dot(direction) < 0.0 { -normal } else { normal })
}

fn engine_face(shape: &dyn Shape, direction: Vector) -> PolygonalFeature {
    let mut face = PolygonalFeature::default();
    if let Some((map, _)) = shape.as_polygonal_feature_map() {
        map.local_support_feature(direction, &mut face);
    }
    face
}

/// The frame in which both sides are seen: its third axis is the normal of the contact.
struct View {
    axes: Mat3,
}

impl View {
    fn along(normal: Vector) -> View {
        let (right, up) = normal.any_orthonormal_pair();
        View { axes: Mat3::from_cols(right, up, normal) }
    }

    /// A side of a shape. `reach`: how far below its topmost corner it may touch.
    fn side<'a>(&self, shape: &'a dyn Shape, pose: &Pose, looks: Looks, reach: f32) -> Side<'a> {
        let to_view = self.axes.transpose();
        let direction = pose.rotation.inverse() * (self.axes.z_axis * looks.sign());
        let turned = to_view * Mat3::from_quat(pose.rotation);
        let origin = to_view * pose.translation;
        let see = |points: &[Vector]| -> Vec<Vector> { points.iter().map(|&p| turned * p + origin).collect() };
        match shape.as_shape::<Hull>() {
            Some(hull) => {
                let seen = see(hull.points());
                let drops = drops(&seen, looks);
                hull_side(hull, direction, reach, seen, drops)
            }
            None => {
                let face = engine_face(shape, direction);
                let seen = see(&face.vertices[..face.num_vertices]);
                let drops = drops(&seen, looks);
                face_side(&face, seen, drops)
            }
        }
    }

    fn meeting(&self, first: Vector, second: Vector, features: [PackedFeatureId; 2]) -> Meeting {
        Meeting { at: [self.axes * first, self.axes * second], features, gap: second.z - first.z }
    }
}

#[derive(Clone, Copy)]
enum Looks {
    AlongNormal,
    Against,
}

impl Looks {
    fn sign(self) -> f32 {
        match self {
            Looks::AlongNormal => 1.0,
            Looks::Against => -1.0,
        }
    }
}

/// How far each corner is below the topmost one.
fn drops(seen: &[Vector], looks: Looks) -> Vec<f32> {
    let height = |p: &Vector| p.z * looks.sign();
    let top = seen.iter().map(height).fold(f32::NEG_INFINITY, f32::max);
    seen.iter().map(|p| top - height(p)).collect()
}

/// What a shape turns to the other one.
struct Side<'a> {
    /// All corners of the shape, in the view.
    seen: Vec<Vector>,
    drops: Vec<f32>,
    corner_names: Option<[PackedFeatureId; 4]>,
    edges: Vec<Edge>,
    facets: Vec<(&'a [u32], PackedFeatureId)>,
}

/// In the view.
struct Edge {
    from: Vector,
    along: Vector,
    /// Of its upper end.
    drop: f32,
    name: PackedFeatureId,
}

impl Edge {
    fn new(ends: [u32; 2], name: PackedFeatureId, seen: &[Vector], drops: &[f32]) -> Edge {
        let [i, j] = ends.map(|i| i as usize);
        Edge { from: seen[i], along: seen[j] - seen[i], drop: drops[i].min(drops[j]), name }
    }

    fn overlaps(&self, (low, high): (Vec2, Vec2)) -> bool {
        let (a, b) = (self.from.truncate(), (self.from + self.along).truncate());
        a.min(b).cmple(high).all() && a.max(b).cmpge(low).all()
    }

    /// Where this edge crosses another one, on both.
    fn crossing(&self, other: &Edge) -> Option<(Vector, Vector)> {
        let (u, v, w) =
            (self.along.truncate(), other.along.truncate(), self.from.truncate() - other.from.truncate());
        let area = u.perp_dot(v);
        let (s, t) = (v.perp_dot(w) * area, u.perp_dot(w) * area);
        let whole = area * area;
        // Before a division: most do not cross.
        let crosses = s >= 0.0 && t >= 0.0 && s <= whole && t <= whole && whole > 0.0;
        crosses.then(|| (self.from + self.along * (s / whole), other.from + other.along * (t / whole)))
    }
}

/// Facets and edges of a hull that look along `direction` and drop no more than `reach`.
fn hull_side(hull: &Hull, direction: Vector, reach: f32, seen: Vec<Vector>, drops: Vec<f32>) -> Side<'_> {
    let near = |&i: &u32| drops[i as usize] <= reach;
    let faces_it = |k: u32| hull.facets()[k as usize].normal.dot(direction) >= STEEP;
    let facets = hull.facets().iter().enumerate();
    let facets = facets.filter(|(k, facet)| facet.corners.iter().any(near) && faces_it(*k as u32));
    let facets = facets.map(|(k, facet)| (&facet.corners[..], PackedFeatureId::face(k as u32))).collect();
    let edges = hull.edges().iter().enumerate();
    let edges = edges.filter(|(_, e)| e.corners.iter().any(near) && e.facets.iter().any(|&k| faces_it(k)));
    let edges = edges.map(|(k, e)| Edge::new(e.corners, PackedFeatureId::edge(k as u32), &seen, &drops)).collect();
    Side { seen, drops, corner_names: None, edges, facets }
}

/// The corners of a face of the engine's own shapes.
const FACE_CORNERS: [u32; 4] = [0, 1, 2, 3];

fn face_side(face: &PolygonalFeature, seen: Vec<Vector>, drops: Vec<f32>) -> Side<'static> {
    let n = face.num_vertices;
    let edge = |i: usize| Edge::new([i as u32, ((i + 1) % n) as u32], face.eids[i], &seen, &drops);
    let edges = (0..n).map(edge).collect();
    Side { seen, drops, corner_names: Some(face.vids), edges, facets: vec![(&FACE_CORNERS[..n], face.fid)] }
}

impl Side<'_> {
    /// Corners that drop no more than `reach`, with their names.
    fn corners(&self, reach: f32) -> impl Iterator<Item = (Vector, PackedFeatureId)> {
        let name = |i: usize| self.corner_names.map_or(PackedFeatureId::vertex(i as u32), |names| names[i]);
        let near = (0..self.seen.len()).filter(move |&i| self.drops[i] <= reach);
        near.map(move |i| (self.seen[i], name(i)))
    }

    /// The box around its edges, across the normal.
    fn bounds(&self) -> (Vec2, Vec2) {
        let ends = self.edges.iter().flat_map(|e| [e.from.truncate(), (e.from + e.along).truncate()]);
        ends.fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
    }

    /// The point of the side over or under `p`, if there is one, and its facet.
    fn opposite(&self, p: Vector) -> Option<(Vector, PackedFeatureId)> {
        self.facets.iter().find_map(|&(corners, name)| Some((self.on_facet(corners, p)?, name)))
    }

    /// By the triangles that fan out from the facet's first corner.
    fn on_facet(&self, corners: &[u32], p: Vector) -> Option<Vector> {
        let (&first, others) = corners.split_first()?;
        let origin = self.seen[first as usize];
        let w = (p - origin).truncate();
        others.windows(2).find_map(|pair| {
            let (u, v) = (self.seen[pair[0] as usize] - origin, self.seen[pair[1] as usize] - origin);
            let area = u.truncate().perp_dot(v.truncate());
            let (s, t) = (w.perp_dot(v.truncate()) / area, u.truncate().perp_dot(w) / area);
            let inside = area != 0.0 && s >= -RIM && t >= -RIM && s + t <= 1.0 + RIM;
            inside.then(|| Vector::new(p.x, p.y, origin.z + u.z * s + v.z * t))
        })
    }
}

/// The corners of the gap between two sides that drop no more than `reach` together.
fn corners(view: &View, a: &Side, b: &Side, reach: f32) -> Vec<Meeting> {
    let above = a.corners(reach).filter_map(|(p, name)| {
        let (q, facet) = b.opposite(p)?;
        Some(view.meeting(p, q, [name, facet]))
    });
    let below = b.corners(reach).filter_map(|(q, name)| {
        let (p, facet) = a.opposite(q)?;
        Some(view.meeting(p, q, [facet, name]))
    });
    let (of_a, of_b) = (b.bounds(), a.bounds());
    let others: Vec<&Edge> = b.edges.iter().filter(|e| e.overlaps(of_b)).collect();
    let crossings = a.edges.iter().filter(|e| e.overlaps(of_a)).flat_map(|first| {
        let near = others.iter().filter(|second| first.drop + second.drop <= reach);
        near.filter_map(|second| {
            let (p, q) = first.crossing(second)?;
            Some(view.meeting(p, q, [first.name, second.name]))
        })
    });
    above.chain(below).chain(crossings).collect()
}
