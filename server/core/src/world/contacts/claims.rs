//! Free places: where a body may be put before the engine's spatial index knows of it.

use crate::geometry::pose::Pose;
use crate::prepare::shape::Shape;
use crate::world::{BodyId, World, colliders::Owner, units::to_engine};
use rapier3d::math::Pose as EnginePose;
use rapier3d::parry::partitioning::Bvh;
use rapier3d::parry::query::intersection_test;
use rapier3d::prelude::*;

/// Places of bodies that the spatial index does not know yet.
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

impl World {
    /// The places of these bodies, which were inserted since the last [`World::zero_step`] or step: the spatial index
    /// does not know them.
    pub fn claims(&self, newest: impl IntoIterator<Item = BodyId>) -> Claims {
        let mut claims = Claims::default();
        for id in newest {
            let collider = &self.engine.colliders[self.bodies[id].collider];
            claims.add(*collider.position(), collider.shared_shape().clone());
        }
        claims
    }

    /// Whether a shape placed here would be free of bodies, scenery, the ground (not of containers) and claimed places.
    /// If so, its place is claimed.
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
        let is_met =
            |other: &Collider| Owner::of(other) != Owner::Container && overlaps(other.position(), other.shape());
        if claimed || self.query().intersect_aabb_conservative(aabb).any(|(_, other)| is_met(other)) {
            return false;
        }
        claims.add(at, solid);
        true
    }
}
