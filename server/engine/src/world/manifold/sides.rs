//! The sides that two convex shapes turn to each other, seen along the normal of the contact.
//!
//! The gap between two such sides is a convex function over the plane across the normal, linear between its corners:
//! those of either side above a facet of the other, and the crossings of their edges. All of these that are near enough
//! are candidates for points of the contact.

use super::{ContactCandidate, ContactFrame};
use crate::shape::Hull;
use cairn_geometry::SINGLE_ROUNDING;
use rapier3d::parry::shape::{PackedFeatureId, PolygonalFeature, Shape};
use rapier3d::prelude::*;

/// What is farther beside a side than this, engine units, is not above one of its facets.
const RIM: f32 = 1e-4;

/// Facets steeper than this, cosine, take no part: a shape that touches one touches its edges as well.
const STEEP: f32 = 0.1;

/// The face of one of the engine's own shapes that looks most along `direction`.
pub(super) fn engine_face(shape: &dyn Shape, direction: Vector) -> PolygonalFeature {
    let mut face = PolygonalFeature::default();
    if let Some((map, _)) = shape.as_polygonal_feature_map() {
        map.local_support_feature(direction, &mut face);
    }
    face
}

/// The side that a shape turns to the other one.
struct ContactSide<'a> {
    face: SideFace<'a>,
    parts: SideParts,
}

/// The parts of a side.
#[derive(Default)]
struct SideParts {
    /// All corners of the shape, in the contact's frame.
    seen: Vec<Vector>,
    /// Depth of each below the topmost one.
    drops: Vec<f32>,
    edges: Vec<SideEdge>,
    /// Their numbers.
    facets: Vec<u32>,
}

/// Memory of [`corners`], kept from pair to pair.
#[derive(Default)]
pub(super) struct SideScratch {
    sides: [SideParts; 2],
    lanes: Lanes,
    candidates: Vec<ContactCandidate>,
}

enum SideFace<'a> {
    Hull(&'a Hull),
    /// Of the engine's own shapes: the face that looks most towards the other shape.
    Engine(PolygonalFeature),
}

/// The corners of a face of the engine's own shapes.
const FACE_CORNERS: [u32; 4] = [0, 1, 2, 3];

impl<'a> ContactSide<'a> {
    /// `sign`: of the normal, in the direction of the other shape. `parts`: memory for its parts.
    fn new(
        frame: &ContactFrame,
        shape: &'a dyn Shape,
        pose: &Pose,
        sign: f32,
        mut parts: SideParts,
    ) -> ContactSide<'a> {
        let face = match shape.as_shape::<Hull>() {
            Some(hull) => SideFace::Hull(hull),
            None => SideFace::Engine(engine_face(shape, pose.rotation.inverse() * (frame.normal() * sign))),
        };
        parts.clear();
        match &face {
            SideFace::Hull(hull) => parts.seen.extend(frame.of(hull.points(), pose)),
            SideFace::Engine(face) => parts.seen.extend(frame.of(&face.vertices[..face.num_vertices], pose)),
        }
        let top = parts.seen.iter().map(|p| sign * p.z).fold(f32::NEG_INFINITY, f32::max);
        parts.drops.extend(parts.seen.iter().map(|p| top - sign * p.z));
        ContactSide { face, parts }
    }

    /// The height of its topmost corner, along the normal.
    fn top(&self) -> f32 {
        let top = self.parts.drops.iter().position(|&drop| drop <= 0.0);
        top.map_or(0.0, |i| self.parts.seen[i].z)
    }

    /// Finds facets and edges that drop no more than `reach`. `direction`: to the other shape, in the frame of this
    /// one.
    fn find_parts(&mut self, direction: Vector, reach: f32) {
        let SideParts { seen, drops, edges, facets } = &mut self.parts;
        let edge = |ends: [u32; 2], name| {
            let [i, j] = ends.map(|i| i as usize);
            SideEdge { from: seen[i], along: seen[j] - seen[i], drop: drops[i].min(drops[j]), name }
        };
        match &self.face {
            SideFace::Hull(hull) => {
                let near = near(drops, reach);
                let faces_it = |k: u32| hull.facets()[k as usize].normal.dot(direction) >= STEEP;
                let all = 0..hull.facets().len() as u32;
                facets.extend(all.filter(|&k| hull.facets()[k as usize].mask & near != 0 && faces_it(k)));
                let all = hull.edges().iter();
                let facing = all.filter(|e| e.mask & near != 0 && e.facets.iter().any(|&k| faces_it(k)));
                edges.extend(facing.map(|e| edge(e.corners, e.name)));
            }
            SideFace::Engine(face) => {
                let n = face.num_vertices;
                facets.push(0);
                edges.extend((0..n).map(|i| edge([i as u32, ((i + 1) % n) as u32], face.eids[i])));
            }
        }
    }

    /// The corners of a facet, and its name.
    fn facet(&self, number: u32) -> (&[u32], PackedFeatureId) {
        match &self.face {
            SideFace::Hull(hull) => (&hull.facets()[number as usize].corners, hull.facets()[number as usize].name),
            SideFace::Engine(face) => (&FACE_CORNERS[..face.num_vertices], face.fid),
        }
    }

    /// Corners that drop no more than `reach`, with their names.
    fn corners(&self, reach: f32) -> impl Iterator<Item = (Vector, PackedFeatureId)> {
        let SideParts { seen, drops, .. } = &self.parts;
        let name = |i: usize| match &self.face {
            SideFace::Hull(_) => PackedFeatureId::vertex(i as u32),
            SideFace::Engine(face) => face.vids[i],
        };
        let near = (0..seen.len()).filter(move |&i| drops[i] <= reach);
        near.map(move |i| (seen[i], name(i)))
    }

    /// The box around its edges, across the normal.
    fn bounds(&self) -> (Vec2, Vec2) {
        box_around(self.parts.edges.iter().flat_map(|e| [e.from.truncate(), (e.from + e.along).truncate()]))
    }

    /// The box around its facets, across the normal, up to rounding.
    fn facet_bounds(&self) -> (Vec2, Vec2) {
        let corners = self.parts.facets.iter().flat_map(|&number| self.facet(number).0);
        let (low, high) = box_around(corners.map(|&i| self.parts.seen[i as usize].truncate()));
        (low - RIM, high + RIM)
    }

    /// The point of the side over or under `p`, if there is one, and its facet.
    fn opposite(&self, p: Vector) -> Option<(Vector, PackedFeatureId)> {
        self.parts.facets.iter().find_map(|&number| {
            let (corners, name) = self.facet(number);
            Some((self.on_facet(corners, p)?, name))
        })
    }

    /// By the triangles that fan out from the facet's first corner.
    fn on_facet(&self, corners: &[u32], p: Vector) -> Option<Vector> {
        let seen = &self.parts.seen;
        let (&first, others) = corners.split_first()?;
        let origin = seen[first as usize];
        let w = (p - origin).truncate();
        others.windows(2).find_map(|pair| {
            let (u, v) = (seen[pair[0] as usize] - origin, seen[pair[1] as usize] - origin);
            let area = u.truncate().perp_dot(v.truncate());
            // Times the square of the area: most are outside, and need no division.
            let whole = area * area;
            let (s, t) = (w.perp_dot(v.truncate()) * area, u.truncate().perp_dot(w) * area);
            // On the rim, up to rounding.
            let least = -SINGLE_ROUNDING * whole;
            let inside = s >= least && t >= least && s + t <= whole - least && whole > 0.0;
            inside.then(|| Vector::new(p.x, p.y, origin.z + (u.z * s + v.z * t) / whole))
        })
    }
}

fn box_around(points: impl Iterator<Item = Vec2>) -> (Vec2, Vec2) {
    points.fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
}

impl SideParts {
    fn clear(&mut self) {
        self.seen.clear();
        self.drops.clear();
        self.edges.clear();
        self.facets.clear();
    }
}

/// A bit for each corner that drops no more than `reach`.
fn near(drops: &[f32], reach: f32) -> u128 {
    match drops.len() {
        0..=128 => drops.iter().rev().fold(0, |mask, &drop| mask << 1 | u128::from(drop <= reach)),
        _ => u128::MAX,
    }
}

/// In the contact's frame.
struct SideEdge {
    from: Vector,
    along: Vector,
    /// Of its upper end.
    drop: f32,
    name: PackedFeatureId,
}

impl SideEdge {
    fn overlaps(&self, (low, high): (Vec2, Vec2)) -> bool {
        let (a, b) = (self.from.truncate(), (self.from + self.along).truncate());
        a.min(b).cmple(high).all() && a.max(b).cmpge(low).all()
    }

    /// The crossing with an edge that this one crosses: the point on each.
    fn crossing(&self, other: &SideEdge) -> [Vector; 2] {
        let (u, v, w) = (self.along.truncate(), other.along.truncate(), (self.from - other.from).truncate());
        let area = u.perp_dot(v);
        [self.from + self.along * (v.perp_dot(w) / area), other.from + other.along * (u.perp_dot(w) / area)]
    }
}

/// Edges number by number across the normal, so that the processor tests several of them at once.
#[derive(Default)]
struct Lanes {
    from: [Vec<f32>; 2],
    along: [Vec<f32>; 2],
    drop: Vec<f32>,
    crossed: Vec<bool>,
}

impl Lanes {
    fn fill(&mut self, edges: &[SideEdge]) {
        let Lanes { from: [x, y], along: [u, v], drop, crossed } = self;
        let of = |lane: &mut Vec<f32>, number: &dyn Fn(&SideEdge) -> f32| {
            lane.clear();
            lane.extend(edges.iter().map(number));
        };
        of(x, &|e| e.from.x);
        of(y, &|e| e.from.y);
        of(u, &|e| e.along.x);
        of(v, &|e| e.along.y);
        of(drop, &|e| e.drop);
        crossed.clear();
        crossed.resize(edges.len(), false);
    }

    /// The edges that cross `edge` and are within `reach` of it.
    fn crossed_by(&mut self, edge: &SideEdge, reach: f32) -> &[bool] {
        let Lanes { from: [x, y], along: [u, v], drop, crossed } = self;
        let n = crossed.len();
        let (x, y, u, v, drop) = (&x[..n], &y[..n], &u[..n], &v[..n], &drop[..n]);
        let (from, along) = (edge.from, edge.along);
        for k in 0..n {
            let (wx, wy) = (from.x - x[k], from.y - y[k]);
            let area = along.x * v[k] - along.y * u[k];
            // Times the square of the area: most do not cross, and need no division.
            let whole = area * area;
            let s = (u[k] * wy - v[k] * wx) * area;
            let t = (along.x * wy - along.y * wx) * area;
            let within = (s >= 0.0) & (t >= 0.0) & (s <= whole) & (t <= whole) & (whole > 0.0);
            crossed[k] = within & (edge.drop + drop[k] <= reach);
        }
        crossed
    }
}

/// The corners of the gap between two shapes, as far as it is no wider than `prediction`.
pub(super) fn corners<'a>(
    frame: &ContactFrame,
    [(a, pose_a), (b, pose_b)]: [(&dyn Shape, &Pose); 2],
    prediction: f32,
    scratch: &'a mut SideScratch,
) -> &'a mut Vec<ContactCandidate> {
    let [parts_a, parts_b] = std::mem::take(&mut scratch.sides);
    let mut first = ContactSide::new(frame, a, pose_a, 1.0, parts_a);
    let mut second = ContactSide::new(frame, b, pose_b, -1.0, parts_b);
    let reach = prediction - (second.top() - first.top());
    first.find_parts(pose_a.rotation.inverse() * frame.normal(), reach);
    second.find_parts(pose_b.rotation.inverse() * -frame.normal(), reach);
    let all = &mut scratch.candidates;
    all.clear();
    let mut add = |at: [Vector; 2], features| {
        let candidate = ContactCandidate { at, features };
        if candidate.gap() <= prediction {
            all.push(candidate);
        }
    };
    let is_in = |(low, high): (Vec2, Vec2), p: &Vector| {
        let p = p.truncate();
        p.cmpge(low).all() && p.cmple(high).all()
    };
    let (of_first, of_second) = (first.facet_bounds(), second.facet_bounds());
    for (p, name) in first.corners(reach).filter(|(p, _)| is_in(of_second, p)) {
        if let Some((q, facet)) = second.opposite(p) {
            add([p, q], [name, facet]);
        }
    }
    for (q, name) in second.corners(reach).filter(|(q, _)| is_in(of_first, q)) {
        if let Some((p, facet)) = first.opposite(q) {
            add([p, q], [facet, name]);
        }
    }
    let (of_first, of_second) = (second.bounds(), first.bounds());
    second.parts.edges.retain(|e| e.overlaps(of_second));
    scratch.lanes.fill(&second.parts.edges);
    for e in first.parts.edges.iter().filter(|e| e.overlaps(of_first)) {
        let crossed = scratch.lanes.crossed_by(e, reach);
        for (other, _) in second.parts.edges.iter().zip(crossed).filter(|(_, crossed)| **crossed) {
            add(e.crossing(other), [e.name, other.name]);
        }
    }
    scratch.sides = [first.parts, second.parts];
    all
}
