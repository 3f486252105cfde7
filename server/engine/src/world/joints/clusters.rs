//! Clusters: bodies that are glued to each other move as one rigid body of the engine, with their mass and inertia.
//!
//! A body that joins a cluster lends it its collider; its own rigid body rests meanwhile. Joints in place of merging
//! fight with the contacts within the cluster, and creep.

use crate::shape::principal;
use crate::world::bodies::{GlueCluster, stop};
use crate::world::{BodyId, BodySize, ClusterId, Momentum, Role, World};
use glam::{DMat3, DVec3};
use rapier3d::prelude::*;

impl World {
    /// Glues free-standing bodies to each other, ascending, at least two, of one role. They continue with their common
    /// momentum.
    pub fn glue(&mut self, members: &[BodyId]) -> ClusterId {
        let id = self.bodies.clusters.len();
        let mass: f64 = members.iter().map(|&id| self.bodies[id].mass).sum();
        let rigid = self.merged(members, mass);
        let carrier = self.engine.insert_body(rigid);
        let frame = *self.engine.bodies[carrier].position();
        let mut size = BodySize { mass, radius: 0.0, thickness: f64::INFINITY };
        for &member in members {
            let offset = frame.inv_mul(&self.bodies.pose(&self.engine, member));
            let body = &mut self.bodies[member];
            size.radius = size.radius.max(f64::from(offset.translation.length()) + body.radius);
            size.thickness = size.thickness.min(body.thickness);
            (body.cluster, body.carrier, body.offset) = (Some(id), carrier, offset);
            let own = &mut self.engine.bodies[body.own];
            stop(own);
            own.set_body_type(RigidBodyType::Fixed, false);
            let (collider, place) = (body.collider, offset * body.collider_pose);
            self.move_collider(collider, carrier, place);
        }
        self.bodies.clusters.push(Some(GlueCluster { carrier, members: members.to_vec(), size }));
        id
    }

    /// The rigid body that these make together, at their center of mass, with their momentum. `mass`: of all.
    fn merged(&self, members: &[BodyId], mass: f64) -> RigidBody {
        let center = members.iter().map(|&id| self.pose(id).translation * self.bodies[id].mass).sum::<DVec3>() / mass;
        let (mut inertia, mut linear, mut angular) = (DMat3::ZERO, DVec3::ZERO, DVec3::ZERO);
        for &id in members {
            let arm = self.pose(id).translation - center;
            inertia += self.inertia_about(id, center);
            let Momentum { linear: l, angular: a } = self.momentum(id);
            linear += l;
            angular += a + arm.cross(l);
        }
        let spin = inertia.inverse() * angular;
        // The engine's own eigenvalues are of single precision.
        let (moments, frame) = principal(inertia);
        let (moments, frame) = (moments.as_vec3(), frame.as_quat());
        let properties = MassProperties::with_principal_inertia_frame(Vector::ZERO, mass as f32, moments, frame);
        let first = &self.bodies[members[0]];
        let like = &self.engine.bodies[first.carrier];
        let mut rigid = RigidBodyBuilder::new(first.role.engine_type())
            .pose(Pose::from_translation(center.as_vec3()))
            .additional_mass_properties(properties)
            .build();
        *rigid.activation_mut() = *like.activation();
        rigid.set_linvel((linear / mass).as_vec3(), false);
        rigid.set_angvel(if spin.is_finite() { spin.as_vec3() } else { Vector::ZERO }, false);
        rigid
    }

    /// Dissolves a cluster: its bodies continue by themselves with their present velocities.
    pub fn unglue(&mut self, id: ClusterId) {
        let Some(cluster) = self.bodies.clusters[id].take() else { return };
        for &member in &cluster.members {
            let pose = self.bodies.pose(&self.engine, member);
            let (linear, angular) = (self.velocity(member), self.angular_velocity(member));
            let carrier = &self.engine.bodies[cluster.carrier];
            let activation = *carrier.activation();
            let body = &mut self.bodies[member];
            (body.cluster, body.carrier, body.offset) = (None, body.own, Pose::IDENTITY);
            let (own, collider, place, role) = (body.own, body.collider, body.collider_pose, body.role);
            let rigid = &mut self.engine.bodies[own];
            rigid.set_position(pose, true);
            rigid.set_body_type(role.engine_type(), true);
            *rigid.activation_mut() = activation;
            if role == Role::Free {
                rigid.set_linvel(linear.as_vec3(), true);
                rigid.set_angvel(angular.as_vec3(), true);
            }
            self.move_collider(collider, own, place);
        }
        self.engine.remove_body(cluster.carrier);
    }

    fn move_collider(&mut self, collider: ColliderHandle, to: RigidBodyHandle, place: Pose) {
        let PhysicsWorld { bodies, colliders, .. } = &mut self.engine;
        colliders.set_parent(collider, Some(to), bodies);
        if let Some(collider) = colliders.get_mut(collider) {
            collider.set_position_wrt_parent(place);
        }
    }
}
