//! The only owner of the physics world: bodies, stepping, contacts, nails.
//!
//! Everything in here is in engine units: length d (the median prop diameter), time sqrt(d / g), mass that of the
//! median prop; gravity is then 1 and the engine sees the same numbers for a pile of rice as for one of logs.
//! [`Units`] is the one place of the conversion.

mod contacts;
mod creep;
mod guarded;
mod hits;
mod manifold;
mod motion;
mod nails;
mod rolling;
mod scenery;

use crate::geometry::mesh::TriMesh;
use crate::geometry::pose::Pose;
use crate::input::params::{FrictionModel, Physics, Switch, Time};
use crate::prepare::shape::Shape;
use glam::{DQuat, DVec3};
use rapier3d::math::{Pose as EnginePose, Vector};
use rapier3d::na::Unit;
use rapier3d::parry::shape::TriMeshFlags;
use rapier3d::prelude::*;

pub use contacts::{Side, Touch, TouchPoint};
pub use guarded::{Energy, State};
pub use hits::Hit;
use manifold::{Manifolds, SOLVED};
pub use motion::{FrictionExcess, Momentum};
pub use nails::NailId;
pub use scenery::MovingId;

/// Index of a body, in the order of insertion; never reused.
pub type BodyId = usize;

/// SI value of one engine unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Units {
    /// m.
    pub length: f64,
    /// s.
    pub time: f64,
    /// kg.
    pub mass: f64,
}

impl Units {
    /// Units in which the median prop has size, mass and gravity 1.
    pub fn new(diameter: f64, mass: f64, gravity: f64) -> Units {
        Units { length: diameter, time: (diameter / gravity).sqrt(), mass }
    }

    /// A duration in engine units.
    pub fn duration(&self, time: Time) -> f64 {
        match time {
            Time::Natural(t) => t,
            Time::Seconds(s) => s / self.time,
        }
    }

    pub fn pose_to_engine(&self, pose: &Pose) -> Pose {
        Pose { translation: pose.translation / self.length, ..*pose }
    }

    pub fn pose_to_si(&self, pose: &Pose) -> Pose {
        Pose { translation: pose.translation * self.length, ..*pose }
    }
}

/// What a body is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Not yet released: it stays where it is.
    Waiting,
    /// Simulated.
    Free,
    /// Held still by the control until a verdict frees it.
    Frozen,
    /// Placed by hand, and to stay: others may rest on it.
    Pinned,
    /// Taken out.
    Gone,
}

/// One body; lengths, masses in engine units.
#[derive(Clone, Debug)]
pub struct WorldBody {
    pub prop: usize,
    /// Scale of the prop.
    pub scale: f64,
    pub role: Role,
    pub mass: f64,
    /// Of the sphere about the centre of mass.
    pub radius: f64,
    /// Smallest extent.
    pub thickness: f64,
    /// Product of the two smaller extents: the area of its smallest face.
    pub face_area: f64,
    pub friction: f64,
    handle: RigidBodyHandle,
    collider: ColliderHandle,
}

/// What effects have done so far: bodies, summed over the steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Counters {
    /// Whose contacts were found a step ahead.
    pub speculative_body_steps: u64,
    /// Swept along their way.
    pub ccd_body_steps: u64,
    /// Kept from rolling.
    pub rolling_body_steps: u64,
    /// Looks at a body that moved on the spot, and so was let fall asleep.
    pub rocking_looks: u64,
}

/// How a body enters the world.
#[derive(Clone, Copy, Debug)]
pub struct Insertion {
    pub prop: usize,
    pub scale: f64,
    /// Engine units.
    pub pose: Pose,
    pub friction: f64,
    pub restitution: f64,
}

/// Bodies, ground, scenery and the engine that moves them.
pub struct World {
    pub units: Units,
    engine: PhysicsWorld,
    bodies: Vec<WorldBody>,
    nails: nails::Nails,
    moving: Vec<scenery::Moving>,
    marks: creep::Marks,
    rolling: rolling::Rolling,
    ccd: Switch,
    /// Steps taken.
    pub steps: u64,
    pub counters: Counters,
}

/// Colliders tell what they are by their user data: these, or [`FIRST_BODY`] plus a body's index.
const GROUND: u128 = 0;
const SCENERY: u128 = 1;
const CONTAINER: u128 = 2;
const FIRST_BODY: u128 = 3;
/// Plus the index of a piece of moving scenery: above all bodies.
const FIRST_MOVING: u128 = 1 << 64;

/// Contacts are predicted up to this distance, the engine's own choice for objects of its unit size, ...
const PREDICTION: f64 = 0.02;
/// ... where the thinnest body is this thick, ...
const USUAL_THICKNESS: f64 = 0.1;
/// ... and farther by up to this much where it is thinner: the rim of a plate that turns over is soon on its other side.
const FARTHER: f64 = 2.5;
/// Fastest that overlapping bodies are pushed apart; slower than a fall from one diameter, so that nothing bursts.
const PUSH_OUT_SPEED: f64 = 0.35;
/// An island sleeps when all its bodies have been slower than this ...
const SLEEP_SPEED: f64 = 0.03;
/// ... for this long.
const SLEEP_TIME: f64 = 1.5;
/// No body may be faster: a fall from 5,000 diameters.
const MAX_SPEED: f64 = 100.0;
/// Contacts are kept unchanged until a pair has moved by this share of the smallest thickness: more is fiction at the
/// time of a verdict, less lets small towers creep.
const RECYCLE_SHARE: f64 = 0.05;
/// Nor by more than this: a body would hover above what it seems to rest on.
const MAX_RECYCLE: f64 = 1.0 / 200.0;

/// Distance up to which contacts are predicted. `thickness`: the smallest of any body; engine units.
fn prediction(thickness: f64) -> f64 {
    PREDICTION * (USUAL_THICKNESS / thickness).clamp(1.0, FARTHER)
}

impl World {
    /// An empty world. `thickness`: the smallest of any body, engine units. `compounds`: some body has several parts.
    pub fn new(units: Units, physics: &Physics, thickness: f64, compounds: bool) -> World {
        let narrow_phase = NarrowPhase::with_query_dispatcher(Manifolds { most: SOLVED });
        let mut engine = PhysicsWorld { gravity: Vector::NEG_Y, narrow_phase, ..PhysicsWorld::new() };
        let frequency = physics.stiffness(thickness);
        let softness = SpringCoefficients {
            natural_frequency: frequency as f32,
            damping_ratio: physics.contact_damping_ratio as f32,
        };
        let p = &mut engine.integration_parameters;
        p.dt = units.duration(physics.step) as f32;
        p.num_solver_iterations = physics.substeps_for(frequency, units.duration(physics.step)) as usize;
        p.contact_softness = softness;
        p.static_contact_softness = softness;
        p.length_unit = 1.0;
        p.warmstart_joints = true;
        p.normalized_prediction_distance = prediction(thickness) as f32;
        p.normalized_max_corrective_velocity = PUSH_OUT_SPEED as f32;
        p.normalized_max_linear_velocity = MAX_SPEED as f32;
        if physics.switches.continuous_collision == Switch::Off {
            p.max_ccd_substeps = 0;
        }
        p.normalized_contact_recycle_distance = (RECYCLE_SHARE * thickness).min(MAX_RECYCLE) as f32;
        // Clustering picks other points of a compound from step to step, which rocks it for ever.
        p.contact_clustering = !compounds;
        p.friction_model = match physics.friction_model {
            FrictionModel::Simplified => rapier3d::prelude::FrictionModel::Simplified,
            FrictionModel::Coulomb => rapier3d::prelude::FrictionModel::Coulomb,
        };
        World {
            units,
            engine,
            bodies: Vec::new(),
            nails: nails::Nails::default(),
            moving: Vec::new(),
            marks: creep::Marks::default(),
            rolling: rolling::Rolling::new(physics),
            ccd: physics.switches.continuous_collision,
            steps: 0,
            counters: Counters::default(),
        }
    }

    /// The ground, a half-space below `height`.
    pub fn add_ground(&mut self, height: f64, friction: f64) {
        let ground = ColliderBuilder::halfspace(Unit::new_unchecked(Vector::Y))
            .translation(Vector::new(0.0, height as f32, 0.0))
            .friction(friction as f32)
            .user_data(GROUND);
        self.engine.insert_collider(ground, None);
    }

    /// Walls that keep bodies in: a mesh whose triangles face where the bodies are. SI.
    pub fn add_container(&mut self, mesh: &TriMesh, friction: f64) -> Result<ColliderHandle, String> {
        let flags =
            TriMeshFlags::ORIENTED | TriMeshFlags::FIX_INTERNAL_EDGES | TriMeshFlags::DELETE_DEGENERATE_TRIANGLES;
        self.add_mesh(mesh, friction, flags, CONTAINER)
    }

    /// A wall without end, facing `normal`.
    pub fn add_wall(&mut self, point: DVec3, normal: DVec3, friction: f64) -> ColliderHandle {
        let wall = ColliderBuilder::halfspace(Unit::new_unchecked(normal.as_vec3().normalize()))
            .translation(point.as_vec3())
            .friction(friction as f32)
            .user_data(CONTAINER);
        self.engine.insert_collider(wall, None)
    }

    pub fn remove_wall(&mut self, wall: ColliderHandle) {
        self.engine.remove_collider(wall);
    }

    fn add_mesh(
        &mut self,
        mesh: &TriMesh,
        friction: f64,
        flags: TriMeshFlags,
        what: u128,
    ) -> Result<ColliderHandle, String> {
        let points = mesh.points.iter().map(|&p| (p / self.units.length).as_vec3()).collect();
        let collider = ColliderBuilder::trimesh_with_flags(points, mesh.triangles.clone(), flags)
            .map_err(|e| format!("the engine refuses the mesh: {e}"))?;
        Ok(self.engine.insert_collider(collider.friction(friction as f32).user_data(what), None))
    }

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
        activation.normalized_linear_threshold = SLEEP_SPEED as f32;
        activation.time_until_sleep = SLEEP_TIME as f32;
        let collider = ColliderBuilder::new(collider)
            .position(place)
            .density(0.0)
            .friction(body.friction as f32)
            .restitution(body.restitution as f32)
            .active_collision_types(ActiveCollisionTypes::default())
            .user_data(FIRST_BODY + id as u128);
        let (handle, collider) = self.engine.insert(rigid, collider);
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
            handle,
            collider,
        });
        Ok(id)
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
        body.scale = scale;
        body.mass = shape.mass * scale.powi(3) / self.units.mass;
        body.radius = shape.radius * size;
        body.thickness = shape.thickness() * size;
        body.face_area = shape.size.extents.x * shape.size.extents.y * size * size;
    }

    /// Each contact point has a friction force of its own.
    pub fn has_friction_per_point(&self) -> bool {
        self.engine.integration_parameters.friction_model == rapier3d::prelude::FrictionModel::Coulomb
    }

    pub fn bodies(&self) -> &[WorldBody] {
        &self.bodies
    }

    /// Velocity of the centre of mass, engine units.
    pub fn velocity(&self, id: BodyId) -> DVec3 {
        self.engine.bodies[self.bodies[id].handle].linvel().as_dvec3()
    }

    /// Bodies that are still there, rising.
    pub fn present(&self) -> impl Iterator<Item = BodyId> + '_ {
        (0..self.bodies.len()).filter(|&i| self.bodies[i].role != Role::Gone)
    }

    pub fn is_present(&self, id: BodyId) -> bool {
        self.bodies[id].role != Role::Gone
    }

    pub fn remove(&mut self, id: BodyId) {
        self.nails.forget(id);
        self.engine.remove_body(self.bodies[id].handle);
        self.bodies[id].role = Role::Gone;
    }

    /// Changes what a body is doing; a body that starts or stops moving does so from rest.
    pub fn set_role(&mut self, id: BodyId, role: Role) {
        if self.bodies[id].role == role {
            return;
        }
        self.bodies[id].role = role;
        let body = &mut self.engine.bodies[self.bodies[id].handle];
        let kind = if role == Role::Free { RigidBodyType::Dynamic } else { RigidBodyType::Fixed };
        if body.body_type() != kind {
            body.set_linvel(Vector::ZERO, false);
            body.set_angvel(Vector::ZERO, false);
            body.set_body_type(kind, true);
        }
    }

    pub fn set_damping(&mut self, id: BodyId, damping: f64) {
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

    /// Gravity is 1 downward, or upward while an upright container is filled as if it stood on its head.
    pub fn set_gravity_up(&mut self, up: bool) {
        self.engine.gravity = if up { Vector::Y } else { Vector::NEG_Y };
        self.engine.wake_up_all(true);
    }

    /// A body is awake from now on, and never sleeps again.
    pub fn keep_awake(&mut self, id: BodyId) {
        let body = &mut self.engine.bodies[self.bodies[id].handle];
        body.activation_mut().normalized_linear_threshold = -1.0;
        body.wake_up(true);
    }

    pub fn pose(&self, id: BodyId) -> Pose {
        from_engine(self.engine.bodies[self.bodies[id].handle].position())
    }

    /// Moves a body without any motion.
    pub fn put(&mut self, id: BodyId, pose: &Pose) {
        self.engine.bodies[self.bodies[id].handle].set_position(to_engine(pose), false);
    }

    pub fn step_length(&self) -> f64 {
        self.engine.integration_parameters.dt as f64
    }

    /// One step. Returns the bodies whose state became non-finite and that the engine set aside.
    pub fn step(&mut self) -> Vec<BodyId> {
        self.watch_fast_ones();
        self.engine.step();
        self.steps += 1;
        let broken = self.engine.quarantine().bodies().to_vec();
        let ids: Vec<BodyId> = (0..self.bodies.len())
            .filter(|&i| self.bodies[i].role != Role::Gone && broken.contains(&self.bodies[i].handle))
            .collect();
        for &id in &ids {
            self.remove(id);
        }
        self.resist_rolling();
        self.keep_awake_what_creeps();
        ids
    }
}

/// The engine keeps the friction of contacts that it recycles; giving it the shape anew renews them.
fn change_friction(collider: &mut Collider, friction: f64, rule: CoefficientCombineRule) {
    collider.set_friction(friction as f32);
    collider.set_friction_combine_rule(rule);
    collider.set_shape(collider.shared_shape().clone());
}

fn to_engine(pose: &Pose) -> EnginePose {
    EnginePose::from_parts(pose.translation.as_vec3(), pose.rotation.as_quat())
}

fn from_engine(pose: &EnginePose) -> Pose {
    let q: DQuat = pose.rotation.as_dquat();
    Pose { translation: pose.translation.as_dvec3(), rotation: q.normalize() }
}
