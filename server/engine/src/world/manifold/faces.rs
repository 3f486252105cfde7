//! Two convex shapes with faces: where they are nearest, and the points of their contact.

use super::sides::{SideScratch, corners, engine_face};
use super::{APART, ContactCandidate, ContactFrame, Few, NEAR, widest};
use crate::shape::Hull;
use cairn_geometry::SINGLE_ROUNDING;
use rapier3d::parry::query::details::{
    NormalConstraints, NormalConstraintsPair, contact_support_map_support_map_with_params,
};
use rapier3d::parry::query::gjk::{GJKResult, VoronoiSimplex};
use rapier3d::parry::query::{ContactManifold, TrackedContact};
use rapier3d::parry::shape::{PackedFeatureId, Shape, SupportMap};
use rapier3d::prelude::*;
use std::cell::Cell;

/// Where a mesh's edges bend the normal of a contact, points deeper than this many times the depth along the true one
/// are no contacts of this pair.
const BENT_DEPTH: f32 = 5.0;

/// A shape has faces with corners, and no rounding.
pub(super) fn has_faces(shape: &dyn Shape) -> bool {
    shape.as_polygonal_feature_map().is_some_and(|(_, border)| border == 0.0)
}

thread_local! {
    static SCRATCH: Cell<SideScratch> = Cell::default();
}

/// Points of the contact of two shapes that have faces. `pos12`: of the second shape, in the frame of the first.
pub(super) fn update_manifold<M, C: Default + Copy>(
    pos12: &Pose,
    a: &dyn Shape,
    b: &dyn Shape,
    constraints: (Option<&dyn NormalConstraints>, Option<&dyn NormalConstraints>),
    prediction: f32,
    most: usize,
    manifold: &mut ContactManifold<M, C>,
) {
    let (Some(first), Some(second)) = (a.as_support_map(), b.as_support_map()) else { return };
    if manifold.try_update_contacts(pos12) {
        return;
    }
    let pair = ConvexPair { pos12, shapes: [a, b], solids: [first, second] };
    let found = pair.nearest(prediction, manifold.local_n1.try_normalize());
    let before: Few<TrackedContact<C>> = manifold.points.drain(..).collect();
    match found {
        Nearest::Within { direction, depth, at } => {
            let (mut normal, mut back) = (direction, pos12.rotation.inverse() * -direction);
            if !constraints.project_local_normals(pos12, &mut normal, &mut back) {
                return;
            }
            let frame = ContactFrame::along(normal);
            let mut scratch = SCRATCH.take();
            let all = corners(&frame, [(a, &Pose::IDENTITY), (b, pos12)], prediction, &mut scratch);
            if normal != direction {
                all.retain(|m| depth >= 0.0 || m.gap() >= BENT_DEPTH * depth);
            } else if let Some(at) = at.filter(|_| !all.iter().any(|m| m.gap() <= depth + SINGLE_ROUNDING)) {
                let at = at.map(|p| frame.axes.transpose() * p);
                all.push(ContactCandidate { at, features: [PackedFeatureId::UNKNOWN; 2] });
            }
            manifold.points.extend(widest(all, most, &before).iter().map(|m| frame.tracked(m, pos12, false)));
            SCRATCH.set(scratch);
            (manifold.local_n1, manifold.local_n2) = (normal, back);
        }
        Nearest::Apart(direction) => manifold.local_n1 = direction,
    }
    manifold.match_contacts(&before);
}

/// Two convex shapes. `pos12`: of the second one, in the frame of the first.
struct ConvexPair<'a> {
    pos12: &'a Pose,
    shapes: [&'a dyn Shape; 2],
    solids: [&'a dyn SupportMap; 2],
}

enum Nearest {
    Within {
        /// From the first shape to the second, along which they are farthest apart or overlap least; unit.
        direction: Vector,
        /// Distance between them along it.
        depth: f32,
        /// The nearest points, on the first and on the second, in the frame of the first.
        at: Option<[Vector; 2]>,
    },
    /// Farther apart than the prediction, along this direction.
    Apart(Vector),
}

impl ConvexPair<'_> {
    /// The engine's answer where the shapes' extents along its direction confirm it. Where they do not, as happens
    /// between shapes that just touch, the answer for shapes a little farther apart.
    fn nearest(&self, prediction: f32, guess: Option<Vector>) -> Nearest {
        let found = self.closest(self.pos12, prediction, guess);
        match found {
            GJKResult::ClosestPoints(p, q, direction) => {
                let depth = (q - p).dot(direction);
                if direction.is_normalized() && self.separation(direction) >= depth - SINGLE_ROUNDING {
                    let steady = depth.abs() > NEAR;
                    let direction = if steady { direction } else { self.steadied(direction, depth) };
                    return Nearest::Within { direction, depth, at: Some([p, q]) };
                }
            }
            GJKResult::NoIntersection(direction) if self.separation(direction) >= prediction - SINGLE_ROUNDING => {
                return Nearest::Apart(direction);
            }
            _ => {}
        }
        let face = self.farthest_face();
        let apart = Pose { translation: self.pos12.translation + face * NEAR, ..*self.pos12 };
        let edge = match self.closest(&apart, prediction + NEAR, Some(face)) {
            GJKResult::ClosestPoints(_, _, direction) => direction,
            _ => face,
        };
        let direction = if self.separation(edge) > self.separation(face) { edge } else { face };
        match self.separation(direction) {
            depth if depth > prediction => Nearest::Apart(direction),
            depth => Nearest::Within { direction, depth, at: None },
        }
    }

    fn closest(&self, pos12: &Pose, prediction: f32, guess: Option<Vector>) -> GJKResult {
        let [a, b] = self.solids;
        contact_support_map_support_map_with_params(pos12, a, b, prediction, &mut VoronoiSimplex::new(), guess)
    }

    /// Distance between the shapes along a direction from the first to the second.
    fn separation(&self, direction: Vector) -> f32 {
        let [a, b] = self.solids;
        let far = b.local_support_point(self.pos12.rotation.inverse() * -direction);
        self.pos12.transform_point(far).dot(direction) - a.local_support_point(direction).dot(direction)
    }

    /// The direction of a contact, or the normal of a face along which the gap is as large.
    fn steadied(&self, direction: Vector, depth: f32) -> Vector {
        let back = self.pos12.rotation.inverse() * -direction;
        let of_second = face_normal(self.shapes[1], back).map(|n| -(self.pos12.rotation * n));
        let faces = [face_normal(self.shapes[0], direction), of_second].into_iter().flatten();
        let best = faces.map(|n| (self.separation(n), n)).max_by(|(s, _), (t, _)| s.total_cmp(t));
        best.filter(|&(s, _)| s >= depth - APART).map_or(direction, |(_, n)| n)
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
