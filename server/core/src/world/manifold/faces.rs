//! Two convex shapes with faces: where the sides that they turn to each other meet, seen along the normal of the contact.
//!
//! The gap between two such sides is a convex function over the plane across the normal, linear between its corners: those of
//! either side above a facet of the other, and the crossings of their edges. All of these that are near enough are points of
//! the contact.

use super::{Meeting, View, widest};
use crate::prepare::shape::Hull;
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
    let (Some(first), Some(second)) = (a.as_support_map(), b.as_support_map()) else { return };
    if manifold.try_update_contacts_eps(pos12, SAME_TURN, SAME_PLACE) {
        return;
    }
    let pair = Pair { pos12, shapes: [a, b], solids: [first, second] };
    let found = pair.nearest(prediction, manifold.local_n1.try_normalize());
    let before = std::mem::take(&mut manifold.points);
    match found {
        Nearest::Within { direction, depth, at } => {
            let (mut normal, mut back) = (direction, pos12.rotation.inverse() * -direction);
            if !constraints.project_local_normals(pos12, &mut normal, &mut back) {
                return;
            }
            let view = View::along(normal);
            let mut all = corners(&view, [(a, &Pose::IDENTITY), (b, pos12)], prediction);
            if normal != direction {
                all.retain(|m| depth >= 0.0 || m.gap() >= BENT_DEPTH * depth);
            } else if let Some(at) = at.filter(|_| !all.iter().any(|m| m.gap() <= depth + CLOSER)) {
                let at = at.map(|p| view.axes.transpose() * p);
                all.push(Meeting { at, features: [PackedFeatureId::UNKNOWN; 2] });
            }
            manifold.points.extend(widest(&all, most, &before).iter().map(|m| view.tracked(m, pos12, false)));
            (manifold.local_n1, manifold.local_n2) = (normal, back);
        }
        Nearest::Apart(direction) => manifold.local_n1 = direction,
    }
    manifold.match_contacts(&before);
}

/// Two convex shapes. `pos12`: of the second one, in the frame of the first.
struct Pair<'a> {
    pos12: &'a Pose,
    shapes: [&'a dyn Shape; 2],
    solids: [&'a dyn SupportMap; 2],
}

enum Nearest {
    Within {
        /// From the first shape to the second, along which they are farthest apart or overlap least; unit.
        direction: Vector,
        /// How far apart they are along it.
        depth: f32,
        /// The nearest points, on the first and on the second, in the frame of the first.
        at: Option<[Vector; 2]>,
    },
    /// Farther apart than asked for, along this direction.
    Apart(Vector),
}

impl Pair<'_> {
    /// The engine's answer where the shapes' extents along its direction confirm it. Where they do not, as happens between
    /// shapes that just touch, the answer for shapes a little farther apart.
    fn nearest(&self, prediction: f32, guess: Option<Vector>) -> Nearest {
        let found = self.ask(self.pos12, prediction, guess);
        match found {
            GJKResult::ClosestPoints(p, q, direction) => {
                let depth = (q - p).dot(direction);
                if direction.is_normalized() && self.separation(direction) >= depth - CLOSER {
                    let steady = depth.abs() > NEAR;
                    let direction = if steady { direction } else { self.steadied(direction, depth) };
                    return Nearest::Within { direction, depth, at: Some([p, q]) };
                }
            }
            GJKResult::NoIntersection(direction) if self.separation(direction) >= prediction - CLOSER => {
                return Nearest::Apart(direction);
            }
            _ => {}
        }
        let face = self.farthest_face();
        let apart = Pose { translation: self.pos12.translation + face * NEAR, ..*self.pos12 };
        let edge = match self.ask(&apart, prediction + NEAR, Some(face)) {
            GJKResult::ClosestPoints(_, _, direction) => direction,
            _ => face,
        };
        let direction = if self.separation(edge) > self.separation(face) { edge } else { face };
        match self.separation(direction) {
            depth if depth > prediction => Nearest::Apart(direction),
            depth => Nearest::Within { direction, depth, at: None },
        }
    }

    fn ask(&self, pos12: &Pose, prediction: f32, guess: Option<Vector>) -> GJKResult {
        let [a, b] = self.solids;
        contact_support_map_support_map_with_params(pos12, a, b, prediction, &mut VoronoiSimplex::new(), guess)
    }

    /// How far apart the shapes are along a direction from the first to the second.
    fn separation(&self, direction: Vector) -> f32 {
        let [a, b] = self.solids;
        let far = b.local_support_point(self.pos12.rotation.inverse() * -direction);
        self.pos12.transform_point(far).dot(direction) - a.local_support_point(direction).dot(direction)
    }

    /// The direction of a contact, or the normal of a face that is as good.
    fn steadied(&self, direction: Vector, depth: f32) -> Vector {
        let back = self.pos12.rotation.inverse() * -direction;
        let of_second = face_normal(self.shapes[1], back).map(|n| -(self.pos12.rotation * n));
        let faces = [face_normal(self.shapes[0], direction), of_second].into_iter().flatten();
        let best = faces.map(|n| (self.separation(n), n)).max_by(|(s, _), (t, _)| s.total_cmp(t));
        best.filter(|&(s, _)| s >= depth - SEPARATION_NOISE).map_or(direction, |(_, n)| n)
    }

    /// Of all faces' normals, the one along which the shapes are farthest apart.
    fn farthest_face(&self) -> Vector {
        let of_second = face_normals(self.shapes[1]).into_iter().map(|n| -(self.pos12.rotation * n));
        let all = face_normals(self.shapes[0]).into_iter().chain(of_second);
        let best = all.map(|n| (self.separation(n), n)).max_by(|(s, _), (t, _)| s.total_cmp(t));
        best.map_or(Vector::Y, |(_, n)| n)
    }
}

fn face_normals(shape: &dyn Shape) -> Vec<Vector> {
    match shape.as_shape::<Hull>() {
        Some(hull) => hull.facets().iter().map(|f| f.normal).collect(),
        None => {
            let axes = [Vector::X, Vector::Y, Vector::Z];
            axes.iter().flat_map(|&axis| [axis, -axis]).filter_map(|axis| face_normal(shape, axis)).collect()
        }
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

/// What a shape turns to the other one.
struct Side<'a> {
    face: Face<'a>,
    /// All corners of the shape, in the view.
    seen: Vec<Vector>,
    /// How far each is below the topmost one.
    drops: Vec<f32>,
    edges: Vec<Edge>,
    facets: Vec<(&'a [u32], PackedFeatureId)>,
}

enum Face<'a> {
    Hull(&'a Hull),
    /// Of the engine's own shapes: the face that looks most towards the other shape.
    Engine(PolygonalFeature),
}

/// The corners of a face of the engine's own shapes.
const FACE_CORNERS: [u32; 4] = [0, 1, 2, 3];

impl<'a> Side<'a> {
    /// `sign`: of the normal, in the direction of the other shape.
    fn new(view: &View, shape: &'a dyn Shape, pose: &Pose, sign: f32) -> Side<'a> {
        let face = match shape.as_shape::<Hull>() {
            Some(hull) => Face::Hull(hull),
            None => Face::Engine(engine_face(shape, pose.rotation.inverse() * (view.normal() * sign))),
        };
        let seen = match &face {
            Face::Hull(hull) => view.of(hull.points(), pose),
            Face::Engine(face) => view.of(&face.vertices[..face.num_vertices], pose),
        };
        let top = seen.iter().map(|p| sign * p.z).fold(f32::NEG_INFINITY, f32::max);
        let drops = seen.iter().map(|p| top - sign * p.z).collect();
        Side { face, seen, drops, edges: Vec::new(), facets: Vec::new() }
    }

    /// The height of its topmost corner, along the normal.
    fn top(&self) -> f32 {
        let top = self.drops.iter().position(|&drop| drop <= 0.0);
        top.map_or(0.0, |i| self.seen[i].z)
    }

    /// Finds facets and edges that drop no more than `reach`. `direction`: to the other shape, in the frame of this one.
    fn find_parts(&mut self, direction: Vector, reach: f32) {
        match &self.face {
            Face::Hull(hull) => {
                let near = self.near(reach);
                let faces_it = |k: u32| hull.facets()[k as usize].normal.dot(direction) >= STEEP;
                let facets = hull.facets().iter().enumerate();
                let facets = facets.filter(|(k, facet)| facet.mask & near != 0 && faces_it(*k as u32));
                self.facets = facets.map(|(k, f)| (&f.corners[..], PackedFeatureId::face(k as u32))).collect();
                let edges = hull.edges().iter().enumerate();
                let edges = edges.filter(|(_, e)| e.mask & near != 0 && e.facets.iter().any(|&k| faces_it(k)));
                self.edges = edges.map(|(k, e)| self.edge(e.corners, PackedFeatureId::edge(k as u32))).collect();
            }
            Face::Engine(face) => {
                let n = face.num_vertices;
                self.facets = vec![(&FACE_CORNERS[..n], face.fid)];
                self.edges = (0..n).map(|i| self.edge([i as u32, ((i + 1) % n) as u32], face.eids[i])).collect();
            }
        }
    }

    /// A bit for each corner that drops no more than `reach`.
    fn near(&self, reach: f32) -> u64 {
        match self.drops.len() {
            0..=64 => self.drops.iter().rev().fold(0, |mask, &drop| mask << 1 | u64::from(drop <= reach)),
            _ => u64::MAX,
        }
    }

    fn edge(&self, ends: [u32; 2], name: PackedFeatureId) -> Edge {
        let [i, j] = ends.map(|i| i as usize);
        let from = self.seen[i];
        Edge { from, along: self.seen[j] - from, drop: self.drops[i].min(self.drops[j]), name }
    }

    /// Corners that drop no more than `reach`, with their names.
    fn corners(&self, reach: f32) -> impl Iterator<Item = (Vector, PackedFeatureId)> {
        let name = |i: usize| match &self.face {
            Face::Hull(_) => PackedFeatureId::vertex(i as u32),
            Face::Engine(face) => face.vids[i],
        };
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
            // Times the square of the area: most are outside, and need no division.
            let whole = area * area;
            let (s, t) = (w.perp_dot(v.truncate()) * area, u.truncate().perp_dot(w) * area);
            let least = -RIM * whole;
            let inside = s >= least && t >= least && s + t <= whole - least && whole > 0.0;
            inside.then(|| Vector::new(p.x, p.y, origin.z + (u.z * s + v.z * t) / whole))
        })
    }
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
    fn overlaps(&self, (low, high): (Vec2, Vec2)) -> bool {
        let (a, b) = (self.from.truncate(), (self.from + self.along).truncate());
        a.min(b).cmple(high).all() && a.max(b).cmpge(low).all()
    }

    /// Where this edge crosses another one, on both.
    fn crossing(&self, other: &Edge) -> Option<[Vector; 2]> {
        let (u, v, w) = (self.along.truncate(), other.along.truncate(), (self.from - other.from).truncate());
        let area = u.perp_dot(v);
        let whole = area * area;
        let (s, t) = (v.perp_dot(w) * area, u.perp_dot(w) * area);
        let crosses = s >= 0.0 && t >= 0.0 && s <= whole && t <= whole && whole > 0.0;
        crosses.then(|| [self.from + self.along * (s / whole), other.from + other.along * (t / whole)])
    }
}

/// The corners of the gap between two shapes, as far as it is no wider than `prediction`.
fn corners(view: &View, [(a, pose_a), (b, pose_b)]: [(&dyn Shape, &Pose); 2], prediction: f32) -> Vec<Meeting> {
    let (mut first, mut second) = (Side::new(view, a, pose_a, 1.0), Side::new(view, b, pose_b, -1.0));
    let reach = prediction - (second.top() - first.top());
    first.find_parts(pose_a.rotation.inverse() * view.normal(), reach);
    second.find_parts(pose_b.rotation.inverse() * -view.normal(), reach);
    let mut all = Vec::new();
    let mut add = |at: [Vector; 2], features| {
        let meeting = Meeting { at, features };
        if meeting.gap() <= prediction {
            all.push(meeting);
        }
    };
    for (p, name) in first.corners(reach) {
        if let Some((q, facet)) = second.opposite(p) {
            add([p, q], [name, facet]);
        }
    }
    for (q, name) in second.corners(reach) {
        if let Some((p, facet)) = first.opposite(q) {
            add([p, q], [facet, name]);
        }
    }
    let (of_first, of_second) = (second.bounds(), first.bounds());
    second.edges.retain(|e| e.overlaps(of_second));
    for e in first.edges.iter().filter(|e| e.overlaps(of_first)) {
        for other in second.edges.iter().filter(|other| e.drop + other.drop <= reach) {
            if let Some(at) = e.crossing(other) {
                add(at, [e.name, other.name]);
            }
        }
    }
    all
}
