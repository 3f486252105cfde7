//! Changes of a body: its place, its size, its mass, and how it is treated.

use super::{BodySize, Resistance, Role, scaled, stop};
use crate::shape::Shape;
use crate::world::{BodyId, World, colliders::OUTSIDE, units::to_engine};
use cairn_geometry::pose;
use glam::DVec3;
use rapier3d::prelude::*;

impl World {
    /// Moves a body; it keeps its velocity and its sleep.
    pub fn put(&mut self, id: BodyId, pose: &pose::Pose) {
        self.engine.bodies[self.bodies[id].carrier].set_position(to_engine(pose), false);
    }

    /// Moves a body, and with it all that is glued to it, so that it is at this pose, at rest.
    pub fn put_carrier(&mut self, id: BodyId, pose: &pose::Pose) {
        let body = &self.bodies[id];
        let place = to_engine(pose);
        let place = if body.cluster.is_some() { place * body.offset.inverse() } else { place };
        if let Some(rigid) = self.engine.bodies.get_mut(body.carrier) {
            rigid.set_position(place, false);
            stop(rigid);
        }
    }

    /// Puts a body back to where it was, at rest.
    pub fn put_back(&mut self, id: BodyId, pose: &pose::Pose) {
        if let Some(rigid) = self.engine.bodies.get_mut(self.bodies[id].carrier) {
            rigid.set_position(to_engine(pose), true);
            stop(rigid);
        }
    }

    /// Throws a free body: m/s and rad/s.
    pub fn launch(&mut self, id: BodyId, velocity: DVec3, angular_velocity: DVec3) {
        let units = self.units;
        let rigid = &mut self.engine.bodies[self.bodies[id].carrier];
        rigid.set_linvel((velocity * units.time / units.length).as_vec3(), true);
        rigid.set_angvel((angular_velocity * units.time).as_vec3(), true);
    }

    /// A free body, and all that are glued to it, turn about a point; engine units.
    pub fn spin(&mut self, id: BodyId, about: DVec3, angular_velocity: DVec3) {
        let rigid = &mut self.engine.bodies[self.bodies[id].carrier];
        let center = rigid.center_of_mass().as_dvec3();
        rigid.set_linvel(angular_velocity.cross(center - about).as_vec3(), true);
        rigid.set_angvel(angular_velocity.as_vec3(), true);
    }

    /// Gives a body another mass than its volume's, kg, distributed as before.
    pub fn set_mass(&mut self, id: BodyId, shape: &Shape, kg: f64) {
        let body = &mut self.bodies[id];
        let factor = kg / (shape.mass * body.scale.powi(3)) / self.units.mass;
        body.mass = kg / self.units.mass;
        if let Some(rigid) = self.engine.bodies.get_mut(body.carrier) {
            let properties = shape.mass_properties(body.scale, 1.0 / self.units.length, factor);
            rigid.set_additional_mass_properties(properties, true);
        }
    }

    /// Gives a body another scale, about its center of mass.
    pub fn rescale(&mut self, id: BodyId, shape: &Shape, scale: f64) {
        let length = 1.0 / self.units.length;
        let (carrier, collider) = (self.bodies[id].carrier, self.bodies[id].collider);
        let Some((place, solid)) = shape.collider(scale * length) else { return };
        if let Some(c) = self.engine.colliders.get_mut(collider) {
            c.set_shape(solid);
            c.set_position_wrt_parent(place);
        }
        if let Some(rigid) = self.engine.bodies.get_mut(carrier) {
            rigid.set_additional_mass_properties(shape.mass_properties(scale, length, 1.0 / self.units.mass), true);
        }
        let body = &mut self.bodies[id];
        body.collider_pose = place;
        body.scale = scale;
        let size;
        (size, body.wall, body.face_area) = scaled(shape, scale, &self.units);
        BodySize { mass: body.mass, radius: body.radius, thickness: body.thickness } = size;
    }

    /// Lets a body through the container, up to the one around it.
    pub fn allow_outside(&mut self, id: BodyId) {
        let groups = InteractionGroups::new(OUTSIDE, Group::ALL, InteractionTestMode::And);
        self.engine.colliders[self.bodies[id].collider].set_collision_groups(groups);
    }

    /// Changes the role of a body and of all that are glued to it; a body that starts or stops moving does so from
    /// rest.
    pub fn set_role(&mut self, id: BodyId, role: Role) {
        if self.bodies[id].role == role {
            return;
        }
        self.bodies.glued_with(id).to_vec().into_iter().for_each(|id| self.bodies[id].role = role);
        let rigid = &mut self.engine.bodies[self.bodies[id].carrier];
        let engine_type = role.engine_type();
        if rigid.body_type() != engine_type {
            stop(rigid);
            rigid.set_body_type(engine_type, true);
        }
    }

    /// Lets the contacts of a body resist slow motion. A cluster is resisted as its first body.
    pub fn set_resistance(&mut self, id: BodyId, resistance: Resistance) {
        self.bodies[id].resistance = resistance;
    }

    pub fn set_friction(&mut self, id: BodyId, friction: f64) {
        self.bodies[id].friction = friction;
        let collider = &mut self.engine.colliders[self.bodies[id].collider];
        change_friction(collider, friction, CoefficientCombineRule::Average);
    }

    /// Removes the friction of a body, or restores it. The material, and the friction of its contact pairs, stay.
    pub fn set_slippery(&mut self, id: BodyId, slippery: bool) {
        let body = &self.bodies[id];
        let (friction, rule) = match slippery {
            true => (0.0, CoefficientCombineRule::Min),
            false => (body.friction, CoefficientCombineRule::Average),
        };
        let collider = &mut self.engine.colliders[body.collider];
        if collider.friction_combine_rule() != rule {
            change_friction(collider, friction, rule);
        }
        if slippery {
            self.engine.bodies[body.carrier].wake_up(true);
        }
    }

    /// Whether [`World::set_slippery`] holds.
    pub fn is_slippery(&self, id: BodyId) -> bool {
        self.engine.colliders[self.bodies[id].collider].friction_combine_rule() == CoefficientCombineRule::Min
    }

    /// A body is awake from now on, and never sleeps again.
    pub fn keep_awake(&mut self, id: BodyId) {
        let rigid = &mut self.engine.bodies[self.bodies[id].carrier];
        rigid.activation_mut().normalized_linear_threshold = -1.0;
        rigid.wake_up(true);
    }
}

/// The engine keeps the friction of contacts that it recycles; setting the shape again renews them.
fn change_friction(collider: &mut Collider, friction: f64, rule: CoefficientCombineRule) {
    collider.set_friction(friction as f32);
    collider.set_friction_combine_rule(rule);
    collider.set_shape(collider.shared_shape().clone());
}
