//! The points on which a convex polyhedron stands on a plane.
//!
//! The engine takes those of one face, the one most parallel to the plane. A tilted body also stands on corners of other
//! faces: they sink in until their face is the most parallel one, push the body back, and it rocks for ever. Here all
//! corners count; everything else is the engine's.

use rapier3d::parry::query::details::{
    NonlinearRigidMotion, NormalConstraints, ShapeCastOptions, contact_manifolds_composite_shape_shape,
};
use rapier3d::parry::query::{
    ClosestPoints, Contact, ContactManifold, ContactManifoldsWorkspace, DefaultQueryDispatcher,
    PersistentQueryDispatcher, QueryDispatcher, ShapeCastHit, ShapeDistance, ShapeIntersection, TrackedContact,
    Unsupported,
};
use rapier3d::parry::shape::{ConvexPolyhedron, HalfSpace, PackedFeatureId, Shape};
use rapier3d::prelude::*;

/// A corner that hangs higher than another by this much of their distance is no better than it: a body stands on it only
/// after it has turned by as much. Less than the slope of domed faces.
const SLOPE: f32 = 0.02;
/// Corners nearer to each other than this, engine units, are one.
const APART: f32 = 1e-5;

/// The engine's queries, with all corners of convex polyhedra considered where they meet a plane.
pub struct Footing;

impl<M, C> PersistentQueryDispatcher<M, C> for Footing
where
    M: Default + Clone + Send + Sync,
    C: Default + Copy + Send + Sync,
{
    fn contact_manifolds(
        &self,
        pos12: &Pose,
        a: &dyn Shape,
        b: &dyn Shape,
        prediction: f32,
        manifolds: &mut Vec<ContactManifold<M, C>>,
        workspace: &mut Option<ContactManifoldsWorkspace>,
    ) -> Result<(), Unsupported> {
        if let (Some(parts), Some(_)) = (a.as_compound(), b.as_halfspace()) {
            contact_manifolds_composite_shape_shape(self, pos12, parts, b, prediction, manifolds, workspace, false);
        } else if let (Some(_), Some(parts)) = (a.as_halfspace(), b.as_compound()) {
            let pos21 = &pos12.inverse();
            contact_manifolds_composite_shape_shape(self, pos21, parts, a, prediction, manifolds, workspace, true);
        } else if stands(a, b) || stands(b, a) {
            if manifolds.is_empty() {
                manifolds.push(ContactManifold::new());
            }
            return self.contact_manifold_convex_convex(pos12, a, b, None, None, prediction, &mut manifolds[0]);
        } else {
            return DefaultQueryDispatcher.contact_manifolds(pos12, a, b, prediction, manifolds, workspace);
        }
        Ok(())
    }

    fn contact_manifold_convex_convex(
        &self,
        pos12: &Pose,
        a: &dyn Shape,
        b: &dyn Shape,
        of_a: Option<&dyn NormalConstraints>,
        of_b: Option<&dyn NormalConstraints>,
        prediction: f32,
        manifold: &mut ContactManifold<M, C>,
    ) -> Result<(), Unsupported> {
        if let (Some(plane), Some(body)) = (a.as_halfspace(), b.as_convex_polyhedron()) {
            stand(plane, body, pos12, prediction, manifold, false);
        } else if let (Some(body), Some(plane)) = (a.as_convex_polyhedron(), b.as_halfspace()) {
            stand(plane, body, &pos12.inverse(), prediction, manifold, true);
        } else {
            return DefaultQueryDispatcher
                .contact_manifold_convex_convex(pos12, a, b, of_a, of_b, prediction, manifold);
        }
        Ok(())
    }
}

fn stands(body: &dyn Shape, plane: &dyn Shape) -> bool {
    body.as_convex_polyhedron().is_some() && plane.as_halfspace().is_some()
}

/// A corner near the plane.
#[derive(Clone, Copy)]
struct Corner {
    index: u32,
    /// Frame of the body.
    own: Vector,
    /// Its foot on the plane, in the frame of that.
    foot: Vector,
    gap: f32,
}

/// Fills the manifold with at most four corners that the body stands on. `pose`: of the body, in the frame of the plane.
/// `flipped`: the body is the first of the manifold's shapes.
fn stand<M, C: Default + Copy>(
    plane: &HalfSpace,
    body: &ConvexPolyhedron,
    pose: &Pose,
    prediction: f32,
    manifold: &mut ContactManifold<M, C>,
    flipped: bool,
) {
    let before = std::mem::take(&mut manifold.points);
    let corner = |(index, &own): (usize, &Vector)| {
        let place = pose.transform_point(own);
        let gap = place.dot(plane.normal);
        Corner { index: index as u32, own, foot: place - plane.normal * gap, gap }
    };
    let near: Vec<Corner> = body.points().iter().enumerate().map(corner).filter(|c| c.gap <= prediction).collect();
    let point = |c: Corner| {
        let (plane, corner) = (PackedFeatureId::face(0), PackedFeatureId::vertex(c.index));
        TrackedContact::flipped(c.foot, c.own, plane, corner, c.gap, flipped)
    };
    manifold.points.extend(widest(&near, plane.normal).map(point));
    let (up, down) = (plane.normal, pose.rotation.inverse() * -plane.normal);
    (manifold.local_n1, manifold.local_n2) = if flipped { (down, up) } else { (up, down) };
    manifold.match_contacts(&before);
}

/// The lowest corner, the one farthest from it, and those farthest to both sides of the line through the two; each held
/// against its height.
fn widest(near: &[Corner], normal: Vector) -> impl Iterator<Item = Corner> {
    let first = near.iter().copied().min_by(|a, b| a.gap.total_cmp(&b.gap));
    let farthest = |way: &dyn Fn(Vector) -> f32| {
        let first = first?;
        let reach = |c: &Corner| way(c.foot - first.foot);
        let worth = |c: &Corner| reach(c) - (c.gap - first.gap) / SLOPE;
        near.iter().copied().filter(|c| reach(c) > APART).max_by(|a, b| worth(a).total_cmp(&worth(b)))
    };
    let second = farthest(&|way| way.length());
    let across = first.zip(second).and_then(|(a, b)| normal.cross(b.foot - a.foot).try_normalize());
    let aside = |sign: f32| across.and_then(|across| farthest(&|way| sign * way.dot(across)));
    let sides = [aside(1.0), aside(-1.0)];
    [first, second].into_iter().chain(sides).flatten()
}

impl QueryDispatcher for Footing {
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
