//! A polyhedron on a plane: all of its corners near the plane are candidates, of whatever face they are.

use super::{ContactCandidate, ContactFrame, widest};
use crate::shape::Hull;
use rapier3d::parry::query::ContactManifold;
use rapier3d::parry::shape::{HalfSpace, PackedFeatureId};
use rapier3d::prelude::*;

/// Points of the contact of a polyhedron with a plane. `pose`: of the body, in the frame of the plane. `flipped`: the
/// body is the first of the manifold's shapes.
pub(super) fn update_manifold<M, C: Default + Copy>(
    plane: &HalfSpace,
    body: &Hull,
    pose: &Pose,
    prediction: f32,
    most: usize,
    manifold: &mut ContactManifold<M, C>,
    flipped: bool,
) {
    let frame = ContactFrame::along(plane.normal);
    let corner = |(index, place): (usize, Vector)| ContactCandidate {
        at: [place.with_z(0.0), place],
        features: [PackedFeatureId::face(0), PackedFeatureId::vertex(index as u32)],
    };
    let places = frame.of(body.points(), pose).enumerate();
    let near: Vec<ContactCandidate> = places.filter(|(_, place)| place.z <= prediction).map(corner).collect();
    let before = std::mem::take(&mut manifold.points);
    manifold.points.extend(widest(&near, most, &before).iter().map(|m| frame.tracked(m, pose, flipped)));
    let (up, down) = (plane.normal, pose.rotation.inverse() * -plane.normal);
    (manifold.local_n1, manifold.local_n2) = if flipped { (down, up) } else { (up, down) };
    manifold.match_contacts(&before);
}
