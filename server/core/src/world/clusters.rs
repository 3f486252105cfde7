//! Clusters: bodies that are glued to each other move as one rigid body of the engine, with their mass and inertia.
//!
//! A body that joins a cluster lends it its collider; its own rigid body rests meanwhile. Joints in place of merging fight with the
//! contacts within the cluster, and creep.

use super::{BodyId, Momentum, Role, World};
use glam::{DMat3, DVec3};
use rapier3d::prelude::*;

/// Index of a cluster, in the order of gluing; never reused.
pub type ClusterId = usize;

/// Bodies glued to each other.
pub(super) struct Cluster {
    handle: RigidBodyHandle,
    /// Rising.
    members: Vec<BodyId>,
    pub mass: f64,
    /// Of the sphere about the centre of mass.
    pub radius: f64,
    /// Smallest of its members.
    pub thickness: f64,
}

impl World {
    /// Glues free-standing bodies to each other, rising, at least two, of one role. They go on with their common momentum.
    pub fn glue(&mut self, members: &[BodyId]) -> ClusterId {
        let id = self.clusters.len();
        let mass: f64 = members.iter().map(|&id| self.bodies[id].mass).sum();
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
        let [x, y, z] = inertia.to_cols_array_2d().map(|c| Vector::new(c[0] as f32, c[1] as f32, c[2] as f32));
        let properties = MassProperties::with_inertia_matrix(Vector::ZERO, mass as f32, Matrix::from_cols(x, y, z));
        let first = &self.engine.bodies[self.bodies[members[0]].handle];
        let (activation, linear_damping, angular_damping) =
            (*first.activation(), first.linear_damping(), first.angular_damping());
        let mut rigid = RigidBodyBuilder::new(kind(self.bodies[members[0]].role))
            .pose(Pose::from_translation(center.as_vec3()))
            .additional_mass_properties(properties)
            .linear_damping(linear_damping)
            .angular_damping(angular_damping)
            .build();
        *rigid.activation_mut() = activation;
        rigid.set_linvel((linear / mass).as_vec3(), false);
        rigid.set_angvel(if spin.is_finite() { spin.as_vec3() } else { Vector::ZERO }, false);
        let handle = self.engine.insert_body(rigid);
        let frame = *self.engine.bodies[handle].position();
        let (mut radius, mut thickness) = (0.0f64, f64::INFINITY);
        for &member in members {
            let offset = frame.inv_mul(&self.engine_pose(member));
            let body = &mut self.bodies[member];
            radius = radius.max(f64::from(offset.translation.length()) + body.radius);
            thickness = thickness.min(body.thickness);
            (body.cluster, body.handle, body.offset) = (Some(id), handle, offset);
            let own = &mut self.engine.bodies[body.own];
            own.set_linvel(Vector::ZERO, false);
            own.set_angvel(Vector::ZERO, false);
            own.set_body_type(RigidBodyType::Fixed, false);
            let (collider, place) = (body.collider, offset * body.place);
            self.move_collider(collider, handle, place);
        }
        self.clusters.push(Some(Cluster { handle, members: members.to_vec(), mass, radius, thickness }));
        id
    }

    /// The bodies of a cluster go on by themselves, as fast as they are.
    pub fn unglue(&mut self, id: ClusterId) {
        let Some(cluster) = self.clusters[id].take() else { return };
        for &member in &cluster.members {
            let pose = self.engine_pose(member);
            let (linear, angular) = (self.velocity(member), self.angular_velocity(member));
            let carrier = &self.engine.bodies[cluster.handle];
            let (activation, damping) = (*carrier.activation(), carrier.linear_damping());
            let body = &mut self.bodies[member];
            (body.cluster, body.handle, body.offset) = (None, body.own, Pose::IDENTITY);
            let (own, collider, place, role) = (body.own, body.collider, body.place, body.role);
            let rigid = &mut self.engine.bodies[own];
            rigid.set_position(pose, true);
            rigid.set_body_type(kind(role), true);
            *rigid.activation_mut() = activation;
            rigid.set_linear_damping(damping);
            rigid.set_angular_damping(damping);
            if role == Role::Free {
                rigid.set_linvel(linear.as_vec3(), true);
                rigid.set_angvel(angular.as_vec3(), true);
            }
            self.move_collider(collider, own, place);
        }
        self.engine.remove_body(cluster.handle);
    }

    fn move_collider(&mut self, collider: ColliderHandle, to: RigidBodyHandle, place: Pose) {
        let PhysicsWorld { bodies, colliders, .. } = &mut self.engine;
        colliders.set_parent(collider, Some(to), bodies);
        if let Some(collider) = colliders.get_mut(collider) {
            collider.set_position_wrt_parent(place);
        }
    }

    pub fn cluster_of(&self, id: BodyId) -> Option<ClusterId> {
        self.bodies[id].cluster
    }

    /// Whether two bodies are of one cluster.
    pub fn are_glued(&self, a: BodyId, b: BodyId) -> bool {
        self.bodies[a].cluster.is_some() && self.bodies[a].cluster == self.bodies[b].cluster
    }

    /// The bodies that move as one with this one, itself included, rising.
    pub fn glued_with(&self, id: BodyId) -> &[BodyId] {
        self.cluster(id).map_or(std::slice::from_ref(&self.bodies[id].id), |cluster| &cluster.members)
    }

    pub(super) fn cluster(&self, id: BodyId) -> Option<&Cluster> {
        self.bodies[id].cluster.and_then(|cluster| self.clusters[cluster].as_ref())
    }

    /// Of those that move as one, each is told of once, for this one.
    pub fn leads(&self, id: BodyId) -> bool {
        self.cluster(id).is_none_or(|cluster| cluster.members[0] == id)
    }

    /// Mass, bounding radius and least thickness of what moves as one with a body.
    pub fn carried(&self, id: BodyId) -> (f64, f64, f64) {
        let body = &self.bodies[id];
        self.cluster(id).map_or((body.mass, body.radius, body.thickness), |c| (c.mass, c.radius, c.thickness))
    }

    /// Centre of mass of what moves as one with a body.
    pub fn carried_center(&self, id: BodyId) -> DVec3 {
        self.engine.bodies[self.bodies[id].handle].translation().as_dvec3()
    }

    /// Of a body by itself, in the world's axes.
    pub fn inertia(&self, id: BodyId) -> DMat3 {
        let local = self.engine.bodies[self.bodies[id].own].mass_properties().local_mprops;
        let matrix = local.reconstruct_inertia_matrix();
        let matrix = DMat3::from_cols(matrix.x_axis.as_dvec3(), matrix.y_axis.as_dvec3(), matrix.z_axis.as_dvec3());
        let turn = DMat3::from_quat(self.pose(id).rotation);
        turn * matrix * turn.transpose()
    }

    /// The same about another point than its centre of mass.
    pub fn inertia_about(&self, id: BodyId, point: DVec3) -> DMat3 {
        let arm = self.pose(id).translation - point;
        let spread = DMat3::from_diagonal(DVec3::splat(arm.length_squared()))
            - DMat3::from_cols(arm * arm.x, arm * arm.y, arm * arm.z);
        self.inertia(id) + spread * self.bodies[id].mass
    }
}

/// How the engine treats a body of this role.
pub(super) fn kind(role: Role) -> RigidBodyType {
    if role == Role::Free { RigidBodyType::Dynamic } else { RigidBodyType::Fixed }
}
