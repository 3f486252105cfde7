//! Invariants of the world, checked at the end of each step ([`crate::invariants`] says when).

use super::{Role, World, WorldBody, bodies::GlueCluster, colliders::Owner};
use cairn_geometry::SINGLE_ROUNDING;
use rapier3d::prelude::*;

impl World {
    /// Panics where the records of the bodies, of their joints and of the engine contradict each other.
    pub(super) fn validate(&self) {
        for body in self.bodies().iter().filter(|body| body.role != Role::Gone) {
            self.validate_body(body);
        }
        for (k, cluster) in self.bodies.clusters.iter().enumerate() {
            for &id in cluster.iter().flat_map(|cluster| &cluster.members) {
                assert_eq!(self.bodies[id].cluster, Some(k), "body {id} knows its cluster");
            }
        }
        for nail in self.nails.driven.values() {
            assert!(
                self.engine.impulse_joints.get(nail.handle).is_some(),
                "the engine has the nail of body {}",
                nail.a
            );
            for id in [Some(nail.a), nail.b].into_iter().flatten() {
                assert!(self.is_present(id), "the nailed body {id} is present");
            }
        }
    }

    fn validate_body(&self, body: &WorldBody) {
        let id = body.id;
        let carrier = self.engine.bodies.get(body.carrier).expect("a present body has a carrier");
        let collider = self.engine.colliders.get(body.collider).expect("a present body has a collider");
        assert_eq!(Owner::of(collider), Owner::Body(id), "the collider of body {id} names it");
        assert_eq!(collider.parent(), Some(body.carrier), "the carrier of body {id} has its collider");
        assert_eq!(carrier.body_type(), body.role.engine_type(), "the engine treats body {id} as {:?}", body.role);
        let pose = self.bodies.pose(&self.engine, id);
        assert!(pose.translation.is_finite() && pose.rotation.is_finite(), "body {id} is at {pose:?}");
        let place = collider.position_wrt_parent().copied().unwrap_or(Pose::IDENTITY);
        let expected = body.offset * body.collider_pose;
        // By the chord between the quaternions: the cosine of a small angle is all rounding.
        let [apart, opposite] = [place.rotation - expected.rotation, place.rotation + expected.rotation];
        let turn = 2.0 * apart.length().min(opposite.length());
        let apart = place.translation.distance(expected.translation).max(turn * body.radius as f32);
        assert!(
            apart <= SINGLE_ROUNDING * (1.0 + place.translation.length()),
            "the collider of body {id} is {apart} off"
        );
        match self.bodies.cluster(id) {
            Some(cluster) => self.validate_member(body, cluster),
            None => {
                assert_eq!((body.cluster, body.carrier), (None, body.own), "body {id} carries itself");
                assert_eq!(body.offset, Pose::IDENTITY, "body {id} carries itself");
            }
        }
    }

    fn validate_member(&self, body: &WorldBody, cluster: &GlueCluster) {
        let GlueCluster { carrier, members, .. } = cluster;
        assert!(members.contains(&body.id), "the cluster of body {} has it as a member", body.id);
        assert!(members.len() > 1 && members.is_sorted(), "members are several, ascending: {members:?}");
        assert_eq!(body.carrier, *carrier, "body {} is carried by its cluster", body.id);
        assert_eq!(body.role, self.bodies[members[0]].role, "body {} has the role of its cluster", body.id);
        assert_eq!(self.engine.bodies[body.own].body_type(), RigidBodyType::Fixed, "body {}'s own rests", body.id);
    }
}
