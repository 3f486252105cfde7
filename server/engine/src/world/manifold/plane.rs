//! A polyhedron on a plane: all of its corners near the plane are candidates, of whatever face they are.

use super::{CANDIDATES, ContactCandidate, ContactFrame, Few, widest};
use crate::shape::{Hull, top};
use rapier3d::parry::query::{ContactManifold, TrackedContact};
use rapier3d::parry::shape::{HalfSpace, PackedFeatureId};
use rapier3d::prelude::*;
use smallvec::SmallVec;

/// Points of the contact of a polyhedron with a plane. `pose`: of the body, in the frame of the plane. `flipped`: the
/// body is the first of the manifold's shapes. Returns their distance.
pub(super) fn update_manifold<M, C: Default + Copy>(
    plane: &HalfSpace,
    body: &Hull,
    pose: &Pose,
    prediction: f32,
    most: usize,
    manifold: &mut ContactManifold<M, C>,
    flipped: bool,
) -> f32 {
    let before: Few<TrackedContact<C>> = manifold.points.drain(..).collect();
    let (up, down) = (plane.normal, pose.rotation.inverse() * -plane.normal);
    (manifold.local_n1, manifold.local_n2) = if flipped { (down, up) } else { (up, down) };
    let lowest = pose.translation.dot(up) - top(body.unit_lanes(), down * body.scale());
    if lowest > prediction {
        return lowest;
    }
    let frame = ContactFrame::along(up);
    let corner = |(index, place): (usize, Vector)| ContactCandidate {
        at: [place.with_z(0.0), place],
        features: [PackedFeatureId::face(0), PackedFeatureId::vertex(index as u32)],
    };
    let places = frame.of(body.unit_points(), body.scale(), pose).enumerate();
    let near: SmallVec<[ContactCandidate; CANDIDATES]> =
        places.filter(|(_, place)| place.z <= prediction).map(corner).collect();
    manifold.points.extend(widest(&near, most, &before).iter().map(|m| frame.tracked(m, pose, flipped)));
    manifold.match_contacts(&before);
    lowest
}
