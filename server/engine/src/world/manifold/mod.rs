//! Contact manifolds of convex polyhedra: the points at which they touch planes, boxes, triangles and each other.
//!
//! The engine knows a face by its first four corners, and a plane by one face at a time. So a disc would stand on a
//! sliver of its rim, and a tilted stone would sink in by one corner until its face is the one most parallel to the
//! ground, be pushed back, and rock forever. Here every corner counts; everything else is the engine's.

mod boxes;
mod convex;
mod gap;
mod parts;
mod plane;
mod polyhedron;
mod separation;
#[cfg(test)]
mod tests;

pub(super) use polyhedron::{Polyhedron, Small, polyhedron};

use crate::shape::Hull;
use rapier3d::parry::query::details::{
    NonlinearRigidMotion, NormalConstraints, ShapeCastOptions, contact_manifolds_trimesh_shape_shapes,
};
use rapier3d::parry::query::{
    ClosestPoints, Contact, ContactManifold, ContactManifoldsWorkspace, DefaultQueryDispatcher,
    PersistentQueryDispatcher, QueryDispatcher, ShapeCastHit, ShapeDistance, ShapeIntersection, TrackedContact,
    Unsupported,
};
use rapier3d::parry::shape::{Cuboid, PackedFeatureId, Shape};
use rapier3d::prelude::*;
use smallvec::SmallVec;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// A point whose gap exceeds that of the nearest one by this share of its distance from it is no better than the
/// nearest: the bodies meet there only after one has turned by as much.
const SLOPE: f32 = 0.02;
/// Points nearer to each other than this, engine units, are one; gaps that differ by less are the same.
const APART: f32 = 1e-5;

/// Points of one patch that are solved. Among more, the engine's solver chooses with less care.
pub const SOLVED: usize = 4;
/// Points of one manifold that a contact pair reports: more add next to nothing to the polygon that they span.
pub const REPORTED: usize = 8;

/// Candidates for these points that are not on the heap.
const CANDIDATES: usize = 64;

/// As many as a manifold has points; not on the heap.
type Few<T> = SmallVec<[T; REPORTED]>;

/// The engine's queries, with its own manifolds replaced where a convex polyhedron takes part.
pub struct Manifolds {
    /// Points of a manifold, at most.
    most: usize,
    looks: Arc<ContactLooks>,
}

/// Counts of what was looked at.
#[derive(Debug, Default)]
pub struct ContactLooks {
    /// Pairs of convex parts.
    looks: AtomicU64,
    /// Pairs of bodies that cannot have met since the last look.
    skips: AtomicU64,
}

impl ContactLooks {
    pub fn looks(&self) -> u64 {
        self.looks.load(Relaxed)
    }

    pub fn skips(&self) -> u64 {
        self.skips.load(Relaxed)
    }
}

impl Manifolds {
    /// `most`: points of a manifold.
    pub fn new(most: usize) -> Manifolds {
        Manifolds { most, looks: Arc::default() }
    }

    /// They go on counting.
    pub fn looks(&self) -> Arc<ContactLooks> {
        self.looks.clone()
    }
}

impl<M, C> PersistentQueryDispatcher<M, C> for Manifolds
where
    M: Default + Clone + Send + Sync,
    C: Default + Copy + Send + Sync,
{
    /// As the engine's, down to pairs of convex shapes.
    fn contact_manifolds(
        &self,
        pos12: &Pose,
        a: &dyn Shape,
        b: &dyn Shape,
        prediction: f32,
        manifolds: &mut Vec<ContactManifold<M, C>>,
        workspace: &mut Option<ContactManifoldsWorkspace>,
    ) -> Result<(), Unsupported> {
        let is_mesh = [a, b].iter().any(|shape| shape.as_trimesh().is_some());
        let is_ours = [a, b].iter().any(|shape| shape.as_compound().is_some() || shape.as_shape::<Hull>().is_some());
        if is_mesh && !is_ours {
            contact_manifolds_trimesh_shape_shapes(self, pos12, a, b, prediction, manifolds, workspace);
        } else if is_mesh || [a, b].iter().any(|shape| shape.as_compound().is_some()) {
            parts::update_manifolds(self, pos12, [a, b], prediction, manifolds, workspace);
        } else {
            if manifolds.is_empty() {
                manifolds.push(ContactManifold::new());
            }
            self.update_convex(pos12, [a, b], (None, None), prediction, &mut manifolds[0]);
        }
        Ok(())
    }

    fn contact_manifold_convex_convex(
        &self,
        pos12: &Pose,
        a: &dyn Shape,
        b: &dyn Shape,
        constraints_a: Option<&dyn NormalConstraints>,
        constraints_b: Option<&dyn NormalConstraints>,
        prediction: f32,
        manifold: &mut ContactManifold<M, C>,
    ) -> Result<(), Unsupported> {
        self.update_convex(pos12, [a, b], (constraints_a, constraints_b), prediction, manifold);
        Ok(())
    }
}

/// What keeps the normals of a contact between those of a mesh's triangles, of both shapes.
type Constraints<'a> = (Option<&'a dyn NormalConstraints>, Option<&'a dyn NormalConstraints>);

impl Manifolds {
    /// Two convex shapes. Returns a distance that they are apart at least, where it is known.
    fn update_convex<M, C>(
        &self,
        pos12: &Pose,
        [a, b]: [&dyn Shape; 2],
        constraints: Constraints,
        prediction: f32,
        manifold: &mut ContactManifold<M, C>,
    ) -> Option<f32>
    where
        M: Default + Clone + Send + Sync,
        C: Default + Copy + Send + Sync,
    {
        self.looks.looks.fetch_add(1, Relaxed);
        let hulls = (a.as_shape::<Hull>(), b.as_shape::<Hull>());
        if let (Some(plane), Some(body)) = (a.as_halfspace(), hulls.1) {
            return Some(plane::update_manifold(plane, body, pos12, prediction, self.most, manifold, false));
        }
        if let (Some(body), Some(plane)) = (hulls.0, b.as_halfspace()) {
            return Some(plane::update_manifold(plane, body, &pos12.inverse(), prediction, self.most, manifold, true));
        }
        if hulls.0.is_some() || hulls.1.is_some() {
            let distance = convex::update_manifold(pos12, [a, b], constraints, prediction, self.most, manifold);
            if distance.is_some() {
                return distance;
            }
        }
        if let (Some(first), Some(second)) = (a.as_shape::<Cuboid>(), b.as_shape::<Cuboid>()) {
            let distance = boxes::distance(pos12, first, second);
            if distance > prediction && manifold.points.is_empty() {
                return Some(distance);
            }
        }
        let (of_a, of_b) = constraints;
        let _ = DefaultQueryDispatcher.contact_manifold_convex_convex(pos12, a, b, of_a, of_b, prediction, manifold);
        None
    }
}

/// The frame of a contact: that of the first shape, turned so that its third axis is the normal.
struct ContactFrame {
    axes: Mat3,
}

impl ContactFrame {
    fn along(normal: Vector) -> ContactFrame {
        let (right, up) = normal.any_orthonormal_pair();
        ContactFrame { axes: Mat3::from_cols(right, up, normal) }
    }

    fn normal(&self) -> Vector {
        self.axes.z_axis
    }

    /// Points of a shape at `pose`, `scale` times as far out.
    fn of<'a>(&self, points: &'a [Vector], scale: f32, pose: &Pose) -> impl Iterator<Item = Vector> + use<'a> {
        let to_frame = self.axes.transpose();
        let turned = to_frame * Mat3::from_quat(pose.rotation) * scale;
        let origin = to_frame * pose.translation;
        points.iter().map(move |&p| turned * p + origin)
    }

    fn tracked<C: Default + Copy>(
        &self,
        candidate: &ContactCandidate,
        pos12: &Pose,
        flipped: bool,
    ) -> TrackedContact<C> {
        let [first, second] = candidate.at.map(|p| self.axes * p);
        let [f1, f2] = candidate.features;
        TrackedContact::flipped(first, pos12.inverse_transform_point(second), f1, f2, candidate.gap(), flipped)
    }
}

/// A candidate for a contact: a point on the first shape and one on the second, in the contact's frame.
#[derive(Clone, Copy)]
struct ContactCandidate {
    at: [Vector; 2],
    features: [PackedFeatureId; 2],
}

impl ContactCandidate {
    fn gap(&self) -> f32 {
        self.at[1].z - self.at[0].z
    }

    fn across(&self) -> Vec2 {
        self.at[0].truncate()
    }
}

/// Distances that differ by less than this, engine units, are about the same. Between faces this near, the direction
/// between the closest points is all rounding. A point that was among the chosen ones in the last step counts as nearer
/// by this: where many are about as good, points that change from step to step would keep bodies trembling.
const NEAR: f32 = 1e-3;

/// At most `most` of the points: the nearest one, the one farthest from it, those farthest to both sides of the line
/// through the two, each weighed against its gap; then those farthest from all of these.
fn widest<C>(all: &[ContactCandidate], most: usize, before: &[TrackedContact<C>]) -> Few<ContactCandidate> {
    // With its bonus.
    let rated = |m: &ContactCandidate| {
        let [one, other] = m.features;
        let is_kept = |c: &TrackedContact<C>| {
            (one.0 == c.fid1.0 && other.0 == c.fid2.0) || (one.0 == c.fid2.0 && other.0 == c.fid1.0)
        };
        (*m, if before.iter().any(is_kept) { NEAR } else { 0.0 })
    };
    let all: SmallVec<[(ContactCandidate, f32); CANDIDATES]> = all.iter().map(rated).collect();
    let nearness = |(m, bonus): &(ContactCandidate, f32)| bonus - m.gap();
    let Some(&(first, _)) = all.iter().max_by(|a, b| nearness(a).total_cmp(&nearness(b))) else { return Few::new() };
    let (origin, least) = (first.across(), first.gap().max(0.0));
    let farthest = |offset: &dyn Fn(Vec2) -> f32| {
        let rate = |(m, bonus): &(ContactCandidate, f32)| {
            let reach = offset(m.across() - origin);
            (reach > APART).then(|| (reach + (bonus - (m.gap() - least).max(0.0)) / SLOPE, *m))
        };
        all.iter().filter_map(rate).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, m)| m)
    };
    let second = farthest(&|offset| offset.length());
    let along = second.map_or(Vec2::ZERO, |m| (m.across() - origin).normalize_or_zero());
    let sides = [farthest(&|offset| along.perp_dot(offset)), farthest(&|offset| offset.perp_dot(along))];
    let mut chosen: Few<ContactCandidate> = [Some(first), second].into_iter().chain(sides).flatten().collect();
    // Squares of the distances to the nearest chosen one.
    let mut apart: SmallVec<[f32; CANDIDATES]> = SmallVec::from_elem(f32::INFINITY, all.len());
    let mut looked = 0;
    while chosen.len() < most {
        for c in &chosen[looked..] {
            let distances = all.iter().map(|(m, _)| c.across().distance_squared(m.across()));
            apart.iter_mut().zip(distances).for_each(|(least, distance)| *least = least.min(distance));
        }
        looked = chosen.len();
        match apart.iter().zip(&all).max_by(|a, b| a.0.total_cmp(b.0)) {
            Some((&distance, &(m, _))) if distance > APART * APART => chosen.push(m),
            _ => break,
        }
    }
    chosen
}

impl QueryDispatcher for Manifolds {
    fn intersection_test(&self, pos12: &Pose, a: &dyn Shape, b: &dyn Shape) -> Result<ShapeIntersection, Unsupported> {
        DefaultQueryDispatcher.intersection_test(pos12, a, b)
    }

    fn distance(&self, pos12: &Pose, a: &dyn Shape, b: &dyn Shape) -> Result<ShapeDistance, Unsupported> {
        DefaultQueryDispatcher.distance(pos12, a, b)
    }

    fn contact(&self, pos12: &Pose, a: &dyn Shape, b: &dyn Shape, reach: f32) -> Result<Option<Contact>, Unsupported> {
        DefaultQueryDispatcher.contact(pos12, a, b, reach)
    }

    fn closest_points(
        &self,
        pos12: &Pose,
        a: &dyn Shape,
        b: &dyn Shape,
        reach: f32,
    ) -> Result<ClosestPoints, Unsupported> {
        DefaultQueryDispatcher.closest_points(pos12, a, b, reach)
    }

    fn cast_shapes(
        &self,
        pos12: &Pose,
        velocity: Vector,
        a: &dyn Shape,
        b: &dyn Shape,
        options: ShapeCastOptions,
    ) -> Result<Option<ShapeCastHit>, Unsupported> {
        DefaultQueryDispatcher.cast_shapes(pos12, velocity, a, b, options)
    }

    fn cast_shapes_nonlinear(
        &self,
        motion_a: &NonlinearRigidMotion,
        a: &dyn Shape,
        motion_b: &NonlinearRigidMotion,
        b: &dyn Shape,
        start: f32,
        end: f32,
        stop_at_penetration: bool,
    ) -> Result<Option<ShapeCastHit>, Unsupported> {
        DefaultQueryDispatcher.cast_shapes_nonlinear(motion_a, a, motion_b, b, start, end, stop_at_penetration)
    }
}
