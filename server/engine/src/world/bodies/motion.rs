//! Poses and velocities of bodies.

use super::{BodySize, ClusterId, Role, WorldBody};
use crate::world::{BodyId, World, units::from_engine};
use cairn_geometry::pose::Pose;
use glam::{DMat3, DVec3};

/// Momentum and angular momentum about the center of mass, engine units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Momentum {
    pub linear: DVec3,
    pub angular: DVec3,
}

impl World {
    pub fn bodies(&self) -> &[WorldBody] {
        self.bodies.as_slice()
    }

    /// Bodies that are still there, ascending.
    pub fn present(&self) -> impl Iterator<Item = BodyId> + '_ {
        (0..self.bodies().len()).filter(|&id| self.is_present(id))
    }

    pub fn is_present(&self, id: BodyId) -> bool {
        self.bodies[id].role != Role::Gone
    }

    /// Bodies with a role, counted.
    pub fn count(&self, role: Role) -> usize {
        self.bodies().iter().filter(|b| b.role == role).count()
    }

    pub fn pose(&self, id: BodyId) -> Pose {
        from_engine(&self.bodies.pose(&self.engine, id))
    }

    /// Height of the lowest point of these bodies' boxes; infinite where there are none.
    pub fn lowest(&self, ids: std::ops::Range<BodyId>) -> f64 {
        let bottom = |id: BodyId| f64::from(self.engine.colliders[self.bodies[id].collider].compute_aabb().mins.y);
        ids.map(bottom).fold(f64::INFINITY, f64::min)
    }

    /// Velocity of the center of mass, engine units.
    pub fn velocity(&self, id: BodyId) -> DVec3 {
        let rigid = &self.engine.bodies[self.bodies[id].carrier];
        if self.bodies[id].cluster.is_none() {
            return rigid.linvel().as_dvec3();
        }
        let arm = self.bodies.pose(&self.engine, id).translation - rigid.translation();
        (rigid.linvel() + rigid.angvel().cross(arm)).as_dvec3()
    }

    pub fn angular_velocity(&self, id: BodyId) -> DVec3 {
        self.engine.bodies[self.bodies[id].carrier].angvel().as_dvec3()
    }

    /// Speed of the fastest point of a body; 0 for a body that is gone.
    pub fn speed(&self, id: BodyId) -> f64 {
        if !self.is_awake(id) {
            return 0.0;
        }
        let rigid = &self.engine.bodies[self.bodies[id].carrier];
        let turning = rigid.angvel().length() as f64 * self.bodies[id].radius;
        let moving =
            if self.cluster_of(id).is_some() { self.velocity(id).length() } else { rigid.linvel().length() as f64 };
        moving + turning
    }

    /// Whether the engine simulates the body at present.
    pub fn is_awake(&self, id: BodyId) -> bool {
        self.bodies.is_awake(&self.engine, id)
    }

    pub fn momentum(&self, id: BodyId) -> Momentum {
        Momentum {
            linear: self.velocity(id) * self.bodies[id].mass,
            angular: self.inertia(id) * self.angular_velocity(id),
        }
    }

    /// Of a body by itself, in the world's axes.
    pub fn inertia(&self, id: BodyId) -> DMat3 {
        let local = self.engine.bodies[self.bodies[id].own].mass_properties().local_mprops;
        let matrix = local.reconstruct_inertia_matrix();
        let matrix = DMat3::from_cols(matrix.x_axis.as_dvec3(), matrix.y_axis.as_dvec3(), matrix.z_axis.as_dvec3());
        let turn = DMat3::from_quat(self.pose(id).rotation);
        turn * matrix * turn.transpose()
    }

    /// The same about another point than its center of mass.
    pub fn inertia_about(&self, id: BodyId, point: DVec3) -> DMat3 {
        let arm = self.pose(id).translation - point;
        let spread = DMat3::from_diagonal(DVec3::splat(arm.length_squared()))
            - DMat3::from_cols(arm * arm.x, arm * arm.y, arm * arm.z);
        self.inertia(id) + spread * self.bodies[id].mass
    }

    pub fn cluster_of(&self, id: BodyId) -> Option<ClusterId> {
        self.bodies[id].cluster
    }

    /// Size of the rigid body that carries a body.
    pub fn carried(&self, id: BodyId) -> BodySize {
        self.bodies.carried(id)
    }

    /// Centre of mass of the rigid body that carries a body.
    pub fn carried_center(&self, id: BodyId) -> DVec3 {
        self.engine.bodies[self.bodies[id].carrier].translation().as_dvec3()
    }
}
