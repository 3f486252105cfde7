//! Contacts between bodies, computed afresh from the poses: the engine's own are recycled, clustered and predicted, and
//! may be gone between two bodies that it does not move.

use super::manifold::{Manifolds, TOLD};
use super::{BodyId, CONTAINER, FIRST_BODY, FIRST_MOVING, GROUND, Role, World, to_engine};
use crate::geometry::contact::{self, Bearing};
use crate::geometry::pose::Pose;
use crate::prepare::shape::Shape;
use glam::DVec3;
use rapier3d::math::Pose as EnginePose;
use rapier3d::parry::bounding_volume::BoundingVolume;
use rapier3d::parry::partitioning::Bvh;
use rapier3d::parry::query::{
    ContactManifold, ContactManifoldsWorkspace, DefaultQueryDispatcher, PersistentQueryDispatcher, intersection_test,
};
use rapier3d::prelude::*;
use rayon::prelude::*;

/// What a body touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PairSide {
    Body(BodyId),
    Ground,
    Scenery,
    /// Scenery that is on its way.
    Moving,
}

/// Places for bodies that the engine does not know of yet.
#[derive(Default)]
pub struct Claims {
    tree: Bvh,
    solids: Vec<(EnginePose, SharedShape)>,
}

impl Claims {
    fn add(&mut self, at: EnginePose, solid: SharedShape) {
        self.tree.insert(solid.compute_aabb(&at), self.solids.len() as u32);
        self.solids.push((at, solid));
    }
}

/// Two things that touch.
#[derive(Clone, Debug)]
pub struct ContactPair {
    pub a: BodyId,
    /// A body behind `a` in the order, or what stands still.
    pub b: PairSide,
    /// Friction coefficient of the pair: the mean of both.
    pub friction: f64,
    pub points: Vec<ContactPoint>,
}

/// One point of a contact, engine units.
#[derive(Clone, Copy, Debug)]
pub struct ContactPoint {
    /// Halfway between the two surfaces.
    pub point: DVec3,
    /// Unit, into `a`.
    pub normal: DVec3,
    /// Negative where they overlap.
    pub gap: f64,
}

impl ContactPair {
    /// Largest overlap of the pair, 0 where there is none.
    pub fn depth(&self) -> f64 {
        self.points.iter().map(|p| -p.gap).fold(0.0, f64::max)
    }

    /// Its points, as who bears on whom. What is pinned carries like scenery.
    pub fn bearings<'a>(&'a self, world: &World) -> impl Iterator<Item = Bearing> + 'a {
        let side = |id: BodyId| match world.bodies[id].role {
            role if role.stands() => contact::End::Fixed,
            _ => contact::End::Body(id),
        };
        let a = side(self.a);
        let b = match self.b {
            PairSide::Body(id) => side(id),
            PairSide::Ground | PairSide::Scenery | PairSide::Moving => contact::End::Fixed,
        };
        self.points.iter().map(move |p| Bearing { a, b, normal: p.normal, gap: p.gap })
    }
}

/// The spatial index holds the boxes of the beginning of the last step: a slow body has not moved farther since.
pub(super) const STALE_INDEX: f64 = 0.02;

/// Frequency of contact springs, per natural time, up to which loads are compared with kappa as they are.
const USUAL_FREQUENCY: f64 = 20.0;

/// Bodies that are worth another thread.
const LEAST_SHARE: usize = 64;

impl World {
    /// Pairs with a gap of at most `tolerance` times the thinner one's thickness, in order of `(a, b)`. Exact: from the
    /// poses, not from the engine's memory. Walls of a container are not told.
    pub fn contact_pairs(&self, tolerance: f64) -> Vec<ContactPair> {
        self.contact_pairs_since(tolerance, &[], &[])
    }

    /// The same, where `before` was the answer when the bodies marked in `still` (shape `[body]`) stood where they stand
    /// now, or near enough: pairs of which neither has moved are taken from there.
    pub fn contact_pairs_since(&self, tolerance: f64, before: &[ContactPair], still: &[bool]) -> Vec<ContactPair> {
        let is_still = |id: BodyId| still.get(id).copied().unwrap_or(false);
        // What a still body meets, where that is still, too.
        let stays = |side: PairSide| match side {
            PairSide::Body(b) => is_still(b) && self.is_present(b),
            PairSide::Ground => true,
            PairSide::Scenery => self.moving.is_empty(),
            PairSide::Moving => false,
        };
        let moved: Vec<BodyId> = self.present().filter(|&id| !is_still(id) || !self.moving.is_empty()).collect();
        let touches_of = |&a: &BodyId| {
            let mut touches = Vec::new();
            for (side, other) in self.near(a, tolerance) {
                match side {
                    // Found from the other one, if that has moved.
                    PairSide::Body(_) if is_still(a) => {}
                    _ if is_still(a) && stays(side) => {}
                    // A pair of two that have moved is found by the earlier one.
                    PairSide::Body(b) if b < a && !is_still(b) => {}
                    PairSide::Body(b) if b < a => {
                        self.touch(b, PairSide::Body(a), self.bodies[a].collider, tolerance, &mut touches);
                    }
                    _ => self.touch(a, side, other, tolerance, &mut touches),
                }
            }
            touches
        };
        let found: Vec<Vec<ContactPair>> = moved.par_iter().with_min_len(LEAST_SHARE).map(touches_of).collect();
        let kept = before.iter().filter(|t| is_still(t.a) && self.is_present(t.a) && stays(t.b)).cloned();
        let mut touches: Vec<ContactPair> = found.into_iter().flatten().chain(kept).collect();
        // In the order of the bodies, whoever finds them.
        touches.sort_by_key(|t| (t.a, t.b));
        touches
    }

    /// Height of the lowest point of these bodies' boxes; infinite where there are none.
    pub fn lowest(&self, ids: std::ops::Range<BodyId>) -> f64 {
        let bottom = |id: BodyId| f64::from(self.engine.colliders[self.bodies[id].collider].compute_aabb().mins.y);
        ids.map(bottom).fold(f64::INFINITY, f64::min)
    }

    /// Bodies with a gap of at most `tolerance` times their thickness to the ground or to scenery that stands still, in order.
    pub fn static_contact_pairs(&self, tolerance: f64) -> Vec<ContactPair> {
        let mut touches = Vec::new();
        for a in self.present() {
            let near = self.near(a, tolerance).into_iter();
            near.filter(|(side, _)| matches!(side, PairSide::Ground | PairSide::Scenery))
                .for_each(|(b, other)| self.touch(a, b, other, tolerance, &mut touches));
        }
        touches
    }

    /// What may be within `tolerance` times its thickness of body `a`, in order.
    fn near(&self, a: BodyId, tolerance: f64) -> Vec<(PairSide, ColliderHandle)> {
        let collider = &self.engine.colliders[self.bodies[a].collider];
        let reach = tolerance * self.bodies[a].thickness;
        let aabb = collider.compute_aabb().loosened((reach + STALE_INDEX) as f32);
        let mut near: Vec<(PairSide, ColliderHandle)> =
            self.query().intersect_aabb_conservative(aabb).filter_map(|(h, c)| Some((self.side(a, c)?, h))).collect();
        near.sort_unstable_by_key(|&(side, handle)| (side, handle.into_raw_parts()));
        near
    }

    /// Bodies glued to each other, as if each rested on the others.
    pub fn glue_bearings(&self) -> Vec<Bearing> {
        let bearing = |a: BodyId, b: BodyId| Bearing {
            a: contact::End::Body(a),
            b: contact::End::Body(b),
            normal: DVec3::Y,
            gap: 0.0,
        };
        let leaders = self.present().filter(|&id| self.bodies[id].cluster.is_some() && self.leads(id));
        let both = leaders.flat_map(|id| self.glued_with(id)[1..].iter().map(move |&other| (id, other)));
        both.flat_map(|(a, b)| [bearing(a, b), bearing(b, a)]).collect()
    }

    /// Thickness of the thinner one of a pair.
    pub fn pair_thickness(&self, touch: &ContactPair) -> f64 {
        self.thinner(touch.a, touch.b)
    }

    fn thinner(&self, a: BodyId, b: PairSide) -> f64 {
        match b {
            PairSide::Body(b) => self.bodies[a].thickness.min(self.bodies[b].thickness),
            PairSide::Ground | PairSide::Scenery | PairSide::Moving => self.bodies[a].thickness,
        }
    }

    pub(super) fn query(&self) -> QueryPipeline<'_> {
        self.engine.broad_phase.as_query_pipeline(
            &DefaultQueryDispatcher,
            &self.engine.bodies,
            &self.engine.colliders,
            QueryFilter::default(),
        )
    }

    /// What a collider is to body `a`; `None` for itself and for a container.
    fn side(&self, a: BodyId, collider: &Collider) -> Option<PairSide> {
        self.what(collider).filter(|side| !matches!(side, PairSide::Body(id) if *id == a))
    }

    /// The body that a collider is of. `None`, too, for what has been removed since the last step: the engine's contacts
    /// still name it.
    pub(super) fn body_of(&self, collider: ColliderHandle) -> Option<BodyId> {
        let data = self.engine.colliders.get(collider)?.user_data;
        (FIRST_BODY..FIRST_MOVING).contains(&data).then(|| (data - FIRST_BODY) as usize)
    }

    /// What a collider is; `None` for a container.
    pub(super) fn what(&self, collider: &Collider) -> Option<PairSide> {
        match collider.user_data {
            CONTAINER => None,
            GROUND => Some(PairSide::Ground),
            data if data >= FIRST_MOVING => {
                let moves = self.moving[(data - FIRST_MOVING) as usize].moves;
                Some(if moves { PairSide::Moving } else { PairSide::Scenery })
            }
            data if data >= FIRST_BODY => Some(PairSide::Body((data - FIRST_BODY) as usize)),
            _ => Some(PairSide::Scenery),
        }
    }

    fn touch(&self, a: BodyId, b: PairSide, other: ColliderHandle, tolerance: f64, out: &mut Vec<ContactPair>) {
        let (first, second) = (&self.engine.colliders[self.bodies[a].collider], &self.engine.colliders[other]);
        let limit = tolerance * self.thinner(a, b);
        let pos12 = first.position().inv_mul(second.position());
        let mut manifolds: Vec<ContactManifold<(), ()>> = Vec::new();
        let mut workspace: Option<ContactManifoldsWorkspace> = None;
        let found = Manifolds { most: TOLD }.contact_manifolds(
            &pos12,
            first.shape(),
            second.shape(),
            limit as f32,
            &mut manifolds,
            &mut workspace,
        );
        if found.is_err() {
            return;
        }
        let mut points = Vec::new();
        for m in &manifolds {
            let (pos1, pos2) = match &m.subshape_poses {
                Some(_) => {
                    (m.subshape_pos1().copied().unwrap_or_default(), m.subshape_pos2().copied().unwrap_or_default())
                }
                None => Default::default(),
            };
            let normal = -(first.position().rotation * (pos1.rotation * m.local_n1));
            for c in &m.points {
                let gap = c.dist as f64;
                let p1 = first.position().transform_point(pos1.transform_point(c.local_p1));
                let p2 = second.position().transform_point(pos2.transform_point(c.local_p2));
                let finite = p1.is_finite() && p2.is_finite() && normal.is_finite() && normal.length_squared() > 0.25;
                if gap <= limit && finite {
                    let point = (p1.as_dvec3() + p2.as_dvec3()) / 2.0;
                    points.push(ContactPoint { point, normal: normal.as_dvec3().normalize(), gap });
                }
            }
        }
        if !points.is_empty() {
            let theirs = match b {
                PairSide::Body(b) => self.bodies[b].friction,
                PairSide::Ground | PairSide::Scenery | PairSide::Moving => second.friction() as f64,
            };
            let friction = (self.bodies[a].friction + theirs) / 2.0;
            out.push(ContactPair { a, b, friction, points });
        }
    }

    /// The places of these bodies, which were inserted since the last [`World::zero_step`] or step: the spatial index does not know them.
    pub fn claims(&self, newest: impl IntoIterator<Item = BodyId>) -> Claims {
        let mut claims = Claims::default();
        for id in newest {
            let collider = &self.engine.colliders[self.bodies[id].collider];
            claims.add(*collider.position(), collider.shared_shape().clone());
        }
        claims
    }

    /// Whether a shape placed here would be free of bodies, scenery, the ground (containers are not asked) and places that are
    /// claimed. Then it is claimed.
    pub fn claim(&self, shape: &Shape, scale: f64, pose: &Pose, claims: &mut Claims) -> bool {
        let Some((place, solid)) = shape.collider(scale / self.units.length) else { return false };
        let at = to_engine(pose) * place;
        let aabb = solid.compute_aabb(&at);
        let overlaps = |pose: &EnginePose, other: &dyn rapier3d::parry::shape::Shape| {
            intersection_test(&at, &*solid, pose, other).is_ok_and(|hit| hit.intersecting)
        };
        let claimed = claims.tree.intersect_aabb(&aabb).any(|i| {
            let (pose, solid) = &claims.solids[i as usize];
            overlaps(pose, &**solid)
        });
        let is_met = |other: &Collider| other.user_data != CONTAINER && overlaps(other.position(), other.shape());
        if claimed || self.query().intersect_aabb_conservative(aabb).any(|(_, other)| is_met(other)) {
            return false;
        }
        claims.add(at, solid);
        true
    }

    /// A step of no time: brings the engine's spatial index and its contacts up to date with bodies that were added, moved or
    /// removed since the last step.
    pub fn zero_step(&mut self) {
        // The engine's own collision pass alone would swallow the news of inserted bodies, which the next step
        // then would not move.
        let dt = std::mem::take(&mut self.engine.integration_parameters.dt);
        self.engine.step();
        // The engine (rapier 0.36.1) may leave such a step with its tree still set aside for optimisation, and finds nothing
        // until the next step puts it back.
        if self.query().bvh.is_empty() {
            self.engine.step();
        }
        self.engine.integration_parameters.dt = dt;
    }

    /// Held bodies on which free bodies press with more than `limit` times their own mass (engine units of force), in contacts
    /// of the usual stiffness. Stiffer springs press harder for the same overlap, by the square of their frequency, which is
    /// no load of the pile's.
    pub fn overloaded(&self, limit: f64) -> Vec<BodyId> {
        let free = |h: ColliderHandle| self.body_of(h).is_some_and(|id| self.bodies[id].role == Role::Free);
        let load = |id: BodyId| -> f64 {
            let me = self.bodies[id].collider;
            let pairs = self.engine.narrow_phase.contact_pairs_with(me);
            pairs
                .filter(|p| free(if p.collider1 == me { p.collider2 } else { p.collider1 }))
                .map(|p| p.total_impulse_magnitude() as f64)
                .sum()
        };
        let held = |&id: &BodyId| self.bodies[id].role == Role::Frozen;
        let stiffness = self.engine.integration_parameters.contact_softness.natural_frequency as f64 / USUAL_FREQUENCY;
        let limit = limit * self.step_length() * stiffness.powi(2).max(1.0);
        self.present().filter(held).filter(|&id| load(id) > limit * self.bodies[id].mass).collect()
    }

    /// Bodies with a role, counted.
    pub fn count(&self, role: Role) -> usize {
        self.bodies.iter().filter(|b| b.role == role).count()
    }
}
