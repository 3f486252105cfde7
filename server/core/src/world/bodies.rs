//! Bodies: how they come, grow and go, and what may be changed of them.

use super::clusters::kind;
use super::scenery::{KEPT_IN, LET_OUT};
use super::{BodyId, FIRST_BODY, Insertion, Role, World, WorldBody, to_engine};
use crate::geometry::pose;
use crate::prepare::shape::Shape;
use glam::DVec3;
use rapier3d::prelude::*;

/// An island sleeps when all its bodies have been slower than this for [`SLEEP_TIME`], d per natural time.
const SLEEP_SPEED: f64 = 0.03;
/// See [`SLEEP_SPEED`]; natural times.
const SLEEP_TIME: f64 = 1.5;

impl World {
    /// Adds a body, free.
    pub fn insert(&mut self, shape: &Shape, body: &Insertion) -> Result<BodyId, String> {
        let length = 1.0 / self.units.length;
        let (place, collider) = shape
            .collider(body.scale * length)
            .ok_or_else(|| format!("{}: the engine finds no volume in its collision shape", shape.report.prop))?;
        let id = self.bodies.len();
        let mut rigid = RigidBodyBuilder::dynamic()
            .pose(to_engine(&body.pose))
            .additional_mass_properties(shape.mass_properties(body.scale, length, 1.0 / self.units.mass))
            .build();
        let activation = rigid.activation_mut();
        activation.normalized_linear_threshold = SLEEP_SPEED as f32 / self.engine.integration_parameters.length_unit;
        activation.time_until_sleep = SLEEP_TIME as f32;
        let collider = ColliderBuilder::new(collider)
            .position(place)
            .density(0.0)
            .friction(body.friction as f32)
            .restitution(body.restitution as f32)
            .active_collision_types(ActiveCollisionTypes::default())
            .collision_groups(InteractionGroups::new(KEPT_IN, Group::ALL, InteractionTestMode::And))
            .user_data(FIRST_BODY + id as u128);
        let (handle, collider) = self.engine.insert(rigid, collider);
        let place = self.engine.colliders[collider].position_wrt_parent().copied().unwrap_or(Pose::IDENTITY);
        let size = body.scale * length;
        self.rolling.round.extend(self.rolling.radius(shape).map(|radius| (id, radius * size)));
        self.bodies.push(WorldBody {
            prop: body.prop,
            scale: body.scale,
            role: Role::Free,
            mass: shape.mass * body.scale.powi(3) / self.units.mass,
            radius: shape.radius * size,
            thickness: shape.thickness() * size,
            face_area: shape.size.extents.x * shape.size.extents.y * size * size,
            friction: body.friction,
            id,
            handle,
            own: handle,
            collider,
            place,
            offset: Pose::IDENTITY,
            cluster: None,
        });
        Ok(id)
    }

    /// Puts a body back to where it was, at rest.
    pub fn put_back(&mut self, id: BodyId, pose: &pose::Pose) {
        if let Some(rigid) = self.engine.bodies.get_mut(self.bodies[id].handle) {
            rigid.set_position(to_engine(pose), true);
            rigid.set_linvel(Vector::ZERO, false);
            rigid.set_angvel(Vector::ZERO, false);
        }
    }

    /// Gives a body another mass than its volume's, kg, distributed as before.
    pub fn set_mass(&mut self, id: BodyId, shape: &Shape, kg: f64) {
        let body = &mut self.bodies[id];
        let factor = kg / (shape.mass * body.scale.powi(3)) / self.units.mass;
        body.mass = kg / self.units.mass;
        if let Some(b) = self.engine.bodies.get_mut(body.handle) {
            let properties = shape.mass_properties(body.scale, 1.0 / self.units.length, factor);
            b.set_additional_mass_properties(properties, true);
        }
    }

    /// Throws a free body: m/s and rad/s.
    pub fn launch(&mut self, id: BodyId, velocity: DVec3, angular_velocity: DVec3) {
        let units = self.units;
        let body = &mut self.engine.bodies[self.bodies[id].handle];
        body.set_linvel((velocity * units.time / units.length).as_vec3(), true);
        body.set_angvel((angular_velocity * units.time).as_vec3(), true);
    }

    /// Gives a body another scale, about its centre of mass.
    pub fn rescale(&mut self, id: BodyId, shape: &Shape, scale: f64) {
        let length = 1.0 / self.units.length;
        let (handle, collider) = (self.bodies[id].handle, self.bodies[id].collider);
        let Some((place, solid)) = shape.collider(scale * length) else { return };
        if let Some(c) = self.engine.colliders.get_mut(collider) {
            c.set_shape(solid);
            c.set_position_wrt_parent(place);
        }
        if let Some(b) = self.engine.bodies.get_mut(handle) {
            b.set_additional_mass_properties(shape.mass_properties(scale, length, 1.0 / self.units.mass), true);
        }
        let size = scale * length;
        let body = &mut self.bodies[id];
        body.place = place;
        body.scale = scale;
        body.mass = shape.mass * scale.powi(3) / self.units.mass;
        body.radius = shape.radius * size;
        body.thickness = shape.thickness() * size;
        body.face_area = shape.size.extents.x * shape.size.extents.y * size * size;
    }

    /// Lets a body through the container's walls, up to those around it.
    pub fn allow_outside(&mut self, id: BodyId) {
        let groups = InteractionGroups::new(LET_OUT, Group::ALL, InteractionTestMode::And);
        self.engine.colliders[self.bodies[id].collider].set_collision_groups(groups);
    }

    /// Changes what a body is doing, and all that are glued to it; a body that starts or stops moving does so from rest.
    pub fn set_role(&mut self, id: BodyId, role: Role) {
        if self.bodies[id].role == role {
            return;
        }
        self.glued_with(id).to_vec().into_iter().for_each(|id| self.bodies[id].role = role);
        let body = &mut self.engine.bodies[self.bodies[id].handle];
        let kind = kind(role);
        if body.body_type() != kind {
            body.set_linvel(Vector::ZERO, false);
            body.set_angvel(Vector::ZERO, false);
            body.set_body_type(kind, true);
        }
    }

    /// What moves as one is damped as its first body.
    pub fn set_damping(&mut self, id: BodyId, damping: f64) {
        if !self.leads(id) {
            return;
        }
        let body = &mut self.engine.bodies[self.bodies[id].handle];
        if body.linear_damping() != damping as f32 {
            body.set_linear_damping(damping as f32);
            body.set_angular_damping(damping as f32);
        }
    }

    pub fn set_friction(&mut self, id: BodyId, friction: f64) {
        self.bodies[id].friction = friction;
        change_friction(
            &mut self.engine.colliders[self.bodies[id].collider],
            friction,
            CoefficientCombineRule::Average,
        );
    }

    /// Lets a body slide off whatever it touches without friction, or ends that. The material stays what it is, and
    /// `touches` goes on to tell it.
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
            self.engine.bodies[body.handle].wake_up(true);
        }
    }

    /// A body is awake from now on, and never sleeps again.
    pub fn keep_awake(&mut self, id: BodyId) {
        let body = &mut self.engine.bodies[self.bodies[id].handle];
        body.activation_mut().normalized_linear_threshold = -1.0;
        body.wake_up(true);
    }

    /// Moves a body without any motion.
    pub fn put(&mut self, id: BodyId, pose: &pose::Pose) {
        self.engine.bodies[self.bodies[id].handle].set_position(to_engine(pose), false);
    }
}

/// The engine keeps the friction of contacts that it recycles; giving it the shape anew renews them.
fn change_friction(collider: &mut Collider, friction: f64, rule: CoefficientCombineRule) {
    collider.set_friction(friction as f32);
    collider.set_friction_combine_rule(rule);
    collider.set_shape(collider.shared_shape().clone());
}
