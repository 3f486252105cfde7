//! Two convex polyhedra: the points of their contact.

use super::gap::{GapScratch, corners};
use super::polyhedron::polyhedron;
use super::separation::{ConvexPair, Search};
use super::{Constraints, ContactFrame, Few, widest};
use rapier3d::parry::query::details::NormalConstraintsPair;
use rapier3d::parry::query::{ContactManifold, TrackedContact};
use rapier3d::parry::shape::Shape;
use rapier3d::prelude::*;
use std::cell::Cell;

/// Where a mesh's edges bend the normal of a contact, points deeper than this many times the depth along the true one
/// are no contacts of this pair.
const BENT_DEPTH: f32 = 5.0;

thread_local! {
    static SCRATCH: Cell<Option<Box<(Search, GapScratch)>>> = const { Cell::new(None) };
}

/// Points of the contact of two shapes of which one is a hull. `pos12`: of the second shape, in the frame of the first.
/// Returns a distance that they are apart at least; `None` where one is no polyhedron.
pub(super) fn update_manifold<M, C: Default + Copy>(
    pos12: &Pose,
    shapes: [&dyn Shape; 2],
    constraints: Constraints,
    prediction: f32,
    most: usize,
    manifold: &mut ContactManifold<M, C>,
) -> Option<f32> {
    let (mut room_a, mut room_b) = (None, None);
    let (a, b) = (polyhedron(shapes[0], &mut room_a)?, polyhedron(shapes[1], &mut room_b)?);
    if manifold.try_update_contacts(pos12) {
        return Some(f32::NEG_INFINITY);
    }
    let pair = ConvexPair::new(pos12, [a, b]);
    let mut scratch = SCRATCH.take().unwrap_or_default();
    let (search, gap) = &mut *scratch;
    let found = pair.separation(prediction, manifold.local_n1.try_normalize(), search);
    let before: Few<TrackedContact<C>> = manifold.points.drain(..).collect();
    let (mut normal, mut back) = (found.direction, -pair.turned_to_second(found.direction));
    let touches = found.distance <= prediction && constraints.project_local_normals(pos12, &mut normal, &mut back);
    if touches {
        let frame = ContactFrame::along(normal);
        let all = corners(&frame, &pair, prediction, gap);
        if normal != found.direction {
            all.retain(|m| found.distance >= 0.0 || m.gap() >= BENT_DEPTH * found.distance);
        }
        manifold.points.extend(widest(all, most, &before).iter().map(|m| frame.tracked(m, pos12, false)));
    }
    SCRATCH.set(Some(scratch));
    if touches || found.distance > prediction {
        (manifold.local_n1, manifold.local_n2) = (normal, back);
    }
    manifold.match_contacts(&before);
    Some(found.distance)
}
