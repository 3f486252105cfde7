//! Insertion and removal of bodies.

use super::colliders::{INSIDE, Owner};
use super::{
    BodyId, BodySize, Insertion, Resistance, Role, World, WorldBody, bodies::scaled, settings, units::to_engine,
};
use crate::shape::Shape;
use rapier3d::prelude::*;

impl World {
    /// Adds a body, free.
    pub fn insert(&mut self, shape: &Shape, body: &Insertion) -> Result<BodyId, String> {
        let length = 1.0 / self.units.length;
        let (place, collider) = shape
            .collider(body.scale * length)
            .ok_or_else(|| format!("{}: the engine finds no volume in its collision shape", shape.report.prop))?;
        let id = self.bodies().len();
        let mut rigid = RigidBodyBuilder::dynamic()
            .pose(to_engine(&body.pose))
            .additional_mass_properties(shape.mass_properties(body.scale, length, 1.0 / self.units.mass))
            .build();
        settings::set_sleep(&mut rigid, self.engine.integration_parameters.length_unit);
        let collider = ColliderBuilder::new(collider)
            .position(place)
            .density(0.0)
            .friction(body.friction as f32)
            .restitution(body.restitution as f32)
            .active_collision_types(ActiveCollisionTypes::default())
            .collision_groups(InteractionGroups::new(INSIDE, Group::ALL, InteractionTestMode::And))
            .user_data(Owner::Body(id).user_data());
        let (own, collider) = self.engine.insert(rigid, collider);
        let collider_pose = self.engine.colliders[collider].position_wrt_parent().copied().unwrap_or(Pose::IDENTITY);
        self.rolling.join(id, shape, body.scale * length);
        let (BodySize { mass, radius, thickness }, wall, face_area) = scaled(shape, body.scale, &self.units);
        self.bodies.push(WorldBody {
            prop: body.prop,
            scale: body.scale,
            role: Role::Free,
            mass,
            radius,
            thickness,
            wall,
            face_area,
            friction: body.friction,
            resistance: Resistance::default(),
            skin: 0.0,
            id,
            carrier: own,
            own,
            collider,
            collider_pose,
            offset: Pose::IDENTITY,
            cluster: None,
        });
        Ok(id)
    }

    /// Removes a body. Bodies that were glued to it continue by themselves.
    pub fn remove(&mut self, id: BodyId) {
        self.nails.forget(id);
        if let Some(cluster) = self.bodies[id].cluster {
            self.unglue(cluster);
        }
        self.engine.remove_body(self.bodies[id].own);
        self.bodies[id].role = Role::Gone;
    }
}
