//! A polyhedron on a plane: all of its corners near the plane are candidates, of whatever face they are.

use super::{Meeting, widest};
use crate::shape::Hull;
use rapier3d::parry::query::ContactManifold;
use rapier3d::parry::shape::{HalfSpace, PackedFeatureId};
use rapier3d::prelude::*;

/// `pose`: of the body, in the frame of the plane. `flipped`: the body is the first of the manifold's shapes.
pub(super) fn stand<M, C: Default + Copy>(
    plane: &HalfSpace,
    body: &Hull,
    pose: &Pose,
    prediction: f32,
    most: usize,
    manifold: &mut ContactManifold<M, C>,
    flipped: bool,
) {
    let normal = plane.normal;
    let corner = |(index, &own): (usize, &Vector)| {
        let place = pose.transform_point(own);
        let gap = place.dot(normal);
        let features = [PackedFeatureId::face(0), PackedFeatureId::vertex(index as u32)];
        Meeting { at: [place - normal * gap, place], features, gap }
    };
    let near: Vec<Meeting> = body.points().iter().enumerate().map(corner).filter(|m| m.gap <= prediction).collect();
    let before = std::mem::take(&mut manifold.points);
    manifold.points.extend(widest(&near, normal, most).into_iter().map(|m| m.tracked(pose, flipped)));
    let down = pose.rotation.inverse() * -normal;
    (manifold.local_n1, manifold.local_n2) = if flipped { (down, normal) } else { (normal, down) };
    manifold.match_contacts(&before);
}
