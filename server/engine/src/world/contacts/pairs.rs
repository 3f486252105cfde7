//! Contact pairs of all bodies.

use super::meeting::{self, Piece};
use super::{ContactPair, ContactPoint, PairSide};
use crate::world::manifold::{Manifolds, REPORTED};
use crate::world::settings::PREDICTION;
use crate::world::{BodyId, World};
use rapier3d::math::Pose;
use rapier3d::parry::bounding_volume::BoundingVolume;
use rapier3d::parry::query::{ContactManifold, ContactManifoldsWorkspace, PersistentQueryDispatcher};
use rapier3d::parry::shape::Shape;
use rapier3d::prelude::{Collider, ColliderHandle};
use rayon::prelude::*;

/// Bodies that are worth another thread.
const LEAST_SHARE: usize = 64;

impl World {
    /// Pairs with a gap of at most `tolerance` times the thinner one's thickness, in order of `(a, b)`. Exact: from the
    /// poses, not from the engine's memory. Walls of a container are left out.
    pub fn contact_pairs(&self, tolerance: f64) -> Vec<ContactPair> {
        self.contact_pairs_since(tolerance, &[], &[])
    }

    /// The same, where `before` was the answer when the bodies marked in `still` (shape `[body]`) stood where they
    /// stand now, or near enough: pairs of which neither has moved are taken from there.
    pub fn contact_pairs_since(&self, tolerance: f64, before: &[ContactPair], still: &[bool]) -> Vec<ContactPair> {
        let is_still = |id: BodyId| still.get(id).copied().unwrap_or(false);
        // Whether the other side of a still body's contact is still, too.
        let stays = |side: PairSide| match side {
            PairSide::Body(b) => is_still(b) && self.is_present(b),
            PairSide::Ground => true,
            PairSide::Scenery => self.moving.is_empty(),
            PairSide::Moving => false,
        };
        let moved: Vec<BodyId> = self.present().filter(|&id| !is_still(id) || !self.moving.is_empty()).collect();
        let pairs_of = |&a: &BodyId| {
            let mut pairs = Vec::new();
            for (side, other) in self.near(a, tolerance) {
                match side {
                    // Found from the other one, if that has moved.
                    PairSide::Body(_) if is_still(a) => {}
                    _ if is_still(a) && stays(side) => {}
                    // A pair of two that have moved is found by the earlier one.
                    PairSide::Body(b) if b < a && !is_still(b) => {}
                    PairSide::Body(b) if b < a => {
                        pairs.extend(self.pair(b, PairSide::Body(a), self.bodies[a].collider, tolerance));
                    }
                    _ => pairs.extend(self.pair(a, side, other, tolerance)),
                }
            }
            pairs
        };
        let found: Vec<Vec<ContactPair>> = moved.par_iter().with_min_len(LEAST_SHARE).map(pairs_of).collect();
        let kept = before.iter().filter(|t| is_still(t.a) && self.is_present(t.a) && stays(t.b)).cloned();
        let mut pairs: Vec<ContactPair> = found.into_iter().flatten().chain(kept).collect();
        // In the order of the bodies, whichever of the two found the pair.
        pairs.sort_by_key(|t| (t.a, t.b));
        pairs
    }

    /// Those of one body, in order of what it touches.
    pub fn contact_pairs_of(&self, a: BodyId, tolerance: f64) -> Vec<ContactPair> {
        let pair = |(side, other): (PairSide, ColliderHandle)| match side {
            PairSide::Body(b) if b < a => self.pair(b, PairSide::Body(a), self.bodies[a].collider, tolerance),
            _ => self.pair(a, side, other, tolerance),
        };
        self.near(a, tolerance).into_iter().filter_map(pair).collect()
    }

    /// Bodies with a gap of at most `tolerance` times their thickness to the ground or to scenery that stands still, in
    /// order.
    pub fn static_contact_pairs(&self, tolerance: f64) -> Vec<ContactPair> {
        let mut pairs = Vec::new();
        for a in self.present() {
            let near = self.near(a, tolerance).into_iter();
            let fixed = near.filter(|(side, _)| matches!(side, PairSide::Ground | PairSide::Scenery));
            pairs.extend(fixed.filter_map(|(b, other)| self.pair(a, b, other, tolerance)));
        }
        pairs
    }

    /// The pieces of scenery that a body overlaps, each with the depth, engine units: whether it is one that moves, and
    /// its index among those, in the order in which they were added.
    pub fn scenery_overlaps(&self, a: BodyId) -> Vec<((bool, usize), f64)> {
        let pieces =
            self.near(a, 0.0).into_iter().filter_map(|(side, handle)| Some((side, handle, self.piece(handle)?)));
        let overlap = |(side, handle, piece): (PairSide, ColliderHandle, (bool, usize))| {
            let depth = self.pair(a, side, handle, 0.0)?.depth();
            (depth > 0.0).then_some((piece, depth))
        };
        pieces.filter_map(overlap).collect()
    }

    /// Other colliders that may be within `tolerance` times its thickness of body `a`, in order.
    pub(in crate::world) fn near(&self, a: BodyId, tolerance: f64) -> Vec<(PairSide, ColliderHandle)> {
        let collider = &self.engine.colliders[self.bodies[a].collider];
        let reach = tolerance * self.bodies[a].thickness + 2.0 * self.most_skin;
        let aabb = collider.compute_aabb().loosened((reach + PREDICTION) as f32);
        let other = |collider: &Collider| self.side_of(collider).filter(|&side| side != PairSide::Body(a));
        let mut near: Vec<(PairSide, ColliderHandle)> =
            self.query().intersect_aabb_conservative(aabb).filter_map(|(h, c)| Some((other(c)?, h))).collect();
        near.sort_unstable_by_key(|&(side, handle)| (side, handle.into_raw_parts()));
        near
    }

    /// The contact of body `a` with another collider; `None` where the gap is wider than `tolerance` times the thinner
    /// one's thickness.
    pub(in crate::world) fn pair(
        &self,
        a: BodyId,
        b: PairSide,
        other: ColliderHandle,
        tolerance: f64,
    ) -> Option<ContactPair> {
        let (first, second) = (&self.engine.colliders[self.bodies[a].collider], &self.engine.colliders[other]);
        let thickness = self.thinner(a, b);
        let limit = tolerance * thickness + self.skins(a, b);
        let placed = ((first.position(), first.shape()), (second.position(), second.shape()));
        let points = match self.judges_meshes {
            true => points_of(placed.0, placed.1, limit, Some(thickness)),
            false => points(placed.0, placed.1, limit),
        };
        if points.is_empty() {
            return None;
        }
        let theirs = match b {
            PairSide::Body(b) => self.bodies[b].friction,
            PairSide::Ground | PairSide::Scenery | PairSide::Moving => second.friction() as f64,
        };
        Some(ContactPair { a, b, friction: (self.bodies[a].friction + theirs) / 2.0, points })
    }
}

/// A shape at its place.
type Placed<'a> = (&'a Pose, &'a dyn Shape);

/// The points at which two shapes are no farther apart than `limit`, engine units; normals into the first.
pub(in crate::world) fn points(first: Placed, second: Placed, limit: f64) -> Vec<ContactPoint> {
    points_of(first, second, limit, None)
}

/// The same. Where the two meet in a line or in a point, the normal is that of their edges or corners, if the
/// `thickness` of the thinner body is given.
fn points_of((at1, first): Placed, (at2, second): Placed, limit: f64, thickness: Option<f64>) -> Vec<ContactPoint> {
    let pos12 = at1.inv_mul(at2);
    let mut manifolds: Vec<ContactManifold<(), ()>> = Vec::new();
    let mut workspace: Option<ContactManifoldsWorkspace> = None;
    let dispatcher = Manifolds::new(REPORTED);
    let found = dispatcher.contact_manifolds(&pos12, first, second, limit as f32, &mut manifolds, &mut workspace);
    let mut points = Vec::new();
    if found.is_err() {
        return points;
    }
    for m in &manifolds {
        let (pos1, pos2) = match &m.subshape_poses {
            Some(_) => (m.subshape_pos1().copied().unwrap_or_default(), m.subshape_pos2().copied().unwrap_or_default()),
            None => Default::default(),
        };
        let mut normal = -(at1.rotation * (pos1.rotation * m.local_n1));
        if let Some(thickness) = thickness {
            let near = || m.points.iter().filter(|c| f64::from(c.dist) <= limit);
            let pieces = (
                Piece {
                    shape: part(first, m.subshape1),
                    at: *at1 * pos1,
                    points: near().map(|c| c.local_p1.as_dvec3()).collect(),
                },
                Piece {
                    shape: part(second, m.subshape2),
                    at: *at2 * pos2,
                    points: near().map(|c| c.local_p2.as_dvec3()).collect(),
                },
            );
            if let Some(own) = meeting::normal(&pieces.0, &pieces.1, -normal.as_dvec3(), thickness) {
                normal = -own.as_vec3();
            }
        }
        for c in &m.points {
            let gap = c.dist as f64;
            let p1 = at1.transform_point(pos1.transform_point(c.local_p1));
            let p2 = at2.transform_point(pos2.transform_point(c.local_p2));
            let finite = p1.is_finite() && p2.is_finite() && normal.is_finite() && normal.length_squared() > 0.25;
            if gap <= limit && finite {
                let point = (p1.as_dvec3() + p2.as_dvec3()) / 2.0;
                points.push(ContactPoint { point, normal: normal.as_dvec3().normalize(), gap });
            }
        }
    }
    points
}

/// A convex part of a shape, by its number.
fn part(shape: &dyn Shape, number: u32) -> &dyn Shape {
    match shape.as_compound() {
        Some(compound) => &*compound.shapes()[number as usize].1,
        None => shape,
    }
}
