//! Bodies: their records, their carriers, and which bodies are glued to each other.

mod changes;
mod motion;

pub use motion::Momentum;

use super::{BodyId, units::Units};
use crate::shape::Shape;
use cairn_geometry::pose::Pose;
use rapier3d::math::Pose as EnginePose;
use rapier3d::prelude::*;
use std::ops::{Index, IndexMut};

/// Index of a cluster, in the order of gluing; never reused.
pub type ClusterId = usize;

/// The part that a body plays.
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
    /// Glued to the ground or to scenery, by itself or through others.
    Anchored,
    /// Removed.
    Gone,
}

impl Role {
    /// It carries others like the ground, until the role changes.
    pub fn stands(self) -> bool {
        matches!(self, Role::Pinned | Role::Anchored)
    }

    /// The engine's type of a body of this role.
    pub fn engine_type(self) -> RigidBodyType {
        if self == Role::Free { RigidBodyType::Dynamic } else { RigidBodyType::Fixed }
    }
}

/// A body to be inserted.
#[derive(Clone, Copy, Debug)]
pub struct Insertion {
    pub prop: usize,
    pub scale: f64,
    /// Engine units.
    pub pose: Pose,
    pub friction: f64,
    pub restitution: f64,
}

/// How much the contacts of a body resist its motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Resistance {
    /// As a share of the friction that the contacts can bear.
    pub share: f64,
    /// Motion in the world is resisted, and so are parts of a pile that slide down as one; otherwise, motion over what
    /// touches the body.
    pub in_world: bool,
}

/// One body; lengths, masses in engine units.
#[derive(Clone, Debug)]
pub struct WorldBody {
    pub prop: usize,
    /// Scale of the prop.
    pub scale: f64,
    pub role: Role,
    pub mass: f64,
    /// Of the sphere about the center of mass.
    pub radius: f64,
    /// Smallest extent.
    pub thickness: f64,
    /// Thickness of its material: of the walls where it is hollow.
    pub wall: f64,
    /// Product of the two smaller extents: the area of its smallest face.
    pub face_area: f64,
    pub friction: f64,
    pub resistance: Resistance,
    /// Thickness of the skin that was taken off its shape; 0 where none was.
    pub(super) skin: f64,
    pub(super) id: BodyId,
    /// The rigid body that moves it: its own, or its cluster's.
    pub(super) carrier: RigidBodyHandle,
    pub(super) own: RigidBodyHandle,
    pub(super) collider: ColliderHandle,
    /// Pose of the collider on the body's own rigid body.
    pub(super) collider_pose: EnginePose,
    /// Pose of the body on its carrier.
    pub(super) offset: EnginePose,
    pub(super) cluster: Option<ClusterId>,
}

/// Bodies glued to each other: one rigid body of the engine.
#[derive(Clone)]
pub(super) struct GlueCluster {
    pub carrier: RigidBodyHandle,
    /// Ascending; at least two.
    pub members: Vec<BodyId>,
    pub size: BodySize,
}

/// Size of a body alone or of the cluster that it is part of; engine units.
#[derive(Clone, Copy, Debug)]
pub struct BodySize {
    pub mass: f64,
    /// Of the sphere about the center of mass.
    pub radius: f64,
    /// Smallest of the members.
    pub thickness: f64,
}

/// All bodies and all clusters, each by its index.
#[derive(Clone, Default)]
pub(super) struct Bodies {
    list: Vec<WorldBody>,
    pub clusters: Vec<Option<GlueCluster>>,
}

impl Index<BodyId> for Bodies {
    type Output = WorldBody;

    fn index(&self, id: BodyId) -> &WorldBody {
        &self.list[id]
    }
}

impl IndexMut<BodyId> for Bodies {
    fn index_mut(&mut self, id: BodyId) -> &mut WorldBody {
        &mut self.list[id]
    }
}

impl Bodies {
    pub fn as_slice(&self) -> &[WorldBody] {
        &self.list
    }

    pub fn push(&mut self, body: WorldBody) {
        self.list.push(body);
    }

    /// Free bodies, ascending.
    pub fn free(&self) -> impl Iterator<Item = (BodyId, &WorldBody)> {
        self.list.iter().enumerate().filter(|(_, body)| body.role == Role::Free)
    }

    /// The rigid bodies that the engine moves at present, each with the body that leads it, ascending.
    pub fn moving<'w>(&'w self, engine: &'w PhysicsWorld) -> impl Iterator<Item = (BodyId, &'w RigidBody)> {
        let leaders = self.free().filter(|&(id, _)| self.leads(id));
        leaders.map(|(id, body)| (id, &engine.bodies[body.carrier])).filter(|(_, rigid)| !rigid.is_sleeping())
    }

    /// Whether the engine moves the body at present.
    pub fn is_awake(&self, engine: &PhysicsWorld, id: BodyId) -> bool {
        self[id].role == Role::Free && !engine.bodies[self[id].carrier].is_sleeping()
    }

    pub fn pose(&self, engine: &PhysicsWorld, id: BodyId) -> EnginePose {
        let body = &self[id];
        let carrier = engine.bodies[body.carrier].position();
        if body.cluster.is_some() { *carrier * body.offset } else { *carrier }
    }

    pub fn cluster(&self, id: BodyId) -> Option<&GlueCluster> {
        self[id].cluster.and_then(|cluster| self.clusters[cluster].as_ref())
    }

    /// The bodies that move as one with this one, itself included, ascending.
    pub fn glued_with(&self, id: BodyId) -> &[BodyId] {
        self.cluster(id).map_or(std::slice::from_ref(&self[id].id), |cluster| &cluster.members)
    }

    /// Whether it is the first of the bodies that move as one: it stands for all of them where each rigid body counts
    /// once.
    pub fn leads(&self, id: BodyId) -> bool {
        self.cluster(id).is_none_or(|cluster| cluster.members[0] == id)
    }

    /// Size of the rigid body that carries a body.
    pub fn carried(&self, id: BodyId) -> BodySize {
        let WorldBody { mass, radius, thickness, .. } = self[id];
        self.cluster(id).map_or(BodySize { mass, radius, thickness }, |cluster| cluster.size)
    }
}

/// Size of a shape at a scale, the thickness of its material, and the area of its smallest face; engine units.
pub(super) fn scaled(shape: &Shape, scale: f64, units: &Units) -> (BodySize, f64, f64) {
    let size = scale * (1.0 / units.length);
    let body = BodySize {
        mass: shape.mass * scale.powi(3) / units.mass,
        radius: shape.radius * size,
        thickness: shape.thickness() * size,
    };
    // A shape without walls has none to cut.
    let wall = if shape.solid.parts() > 1 { shape.size.wall } else { shape.thickness() };
    (body, wall * size, shape.size.extents.x * shape.size.extents.y * size * size)
}

/// Takes a rigid body's velocities.
pub(super) fn stop(rigid: &mut RigidBody) {
    rigid.set_linvel(Vector::ZERO, false);
    rigid.set_angvel(Vector::ZERO, false);
}
