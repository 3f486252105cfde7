//! Reserved places: shapes that were placed but are not yet in the engine's spatial index.

use crate::shape::Shape;
use crate::world::{BodyId, World, colliders::Owner, units::to_engine};
use cairn_geometry::pose::Pose;
use rapier3d::math::Pose as EnginePose;
use rapier3d::parry::partitioning::Bvh;
use rapier3d::parry::query::intersection_test;
use rapier3d::prelude::*;

/// Shapes that were placed but are not yet in the engine's spatial index.
#[derive(Default)]
pub struct ReservedPlaces {
    tree: Bvh,
    solids: Vec<(EnginePose, SharedShape)>,
}

impl ReservedPlaces {
    fn add(&mut self, at: EnginePose, solid: SharedShape) {
        self.tree.insert(solid.compute_aabb(&at), self.solids.len() as u32);
        self.solids.push((at, solid));
    }
}

impl World {
    /// The places of these bodies, which were inserted since the last [`World::zero_step`] or step and are not in the
    /// spatial index yet.
    pub fn reserved_places(&self, newest: impl IntoIterator<Item = BodyId>) -> ReservedPlaces {
        let mut reserved = ReservedPlaces::default();
        for id in newest {
            let collider = &self.engine.colliders[self.bodies[id].collider];
            reserved.add(*collider.position(), collider.shared_shape().clone());
        }
        reserved
    }

    /// Whether a shape placed here would be free of bodies, scenery, the ground (not of containers) and reserved
    /// places. If so, its place is reserved.
    pub fn reserve(&self, shape: &Shape, scale: f64, pose: &Pose, reserved: &mut ReservedPlaces) -> bool {
        let Some((place, solid)) = shape.collider(scale / self.units.length) else { return false };
        let at = to_engine(pose) * place;
        let aabb = solid.compute_aabb(&at);
        let overlaps = |pose: &EnginePose, other: &dyn rapier3d::parry::shape::Shape| {
            intersection_test(&at, &*solid, pose, other).is_ok_and(|hit| hit.intersecting)
        };
        let is_reserved = reserved.tree.intersect_aabb(&aabb).any(|i| {
            let (pose, solid) = &reserved.solids[i as usize];
            overlaps(pose, &**solid)
        });
        let is_met =
            |other: &Collider| Owner::of(other) != Owner::Container && overlaps(other.position(), other.shape());
        if is_reserved || self.query().intersect_aabb_conservative(aabb).any(|(_, other)| is_met(other)) {
            return false;
        }
        reserved.add(at, solid);
        true
    }
}
