//! The pile of the last frame as simulators take it: what moves as one, masses, and what stands still.

use super::ExportScene;
use super::glue::GlueMembership;
use cairn_core::report::bake::{BakedBody, BakedPile, BakedSolid};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::scene::StaticModel;
use glam::{DAffine3, DMat3, DQuat, DVec3};

/// Bodies that move as one, or stand as one.
pub struct RigidGroup {
    pub name: String,
    /// Ascending.
    pub members: Vec<usize>,
    /// It is glued to the ground or to scenery, or the scene keeps it where it is.
    pub is_fixed: bool,
}

impl RigidGroup {
    /// All of a pile, in the order of their first members. A body alone has its own name; a cluster, its number's.
    pub fn all(bake: &BakedPile, names: &[String]) -> Vec<RigidGroup> {
        let count = bake.bodies.len();
        let glue = bake.glue.as_ref();
        let held = glue.map_or(vec![GlueMembership::default(); count], |glue| GlueMembership::all(glue, count));
        let group = |(body, held): (usize, GlueMembership)| {
            let (name, members) = match glue.zip(held.cluster) {
                None => (names[body].clone(), vec![body]),
                Some((glue, number)) => (format!("cluster.{number}"), glue.clusters[number].clone()),
            };
            let is_pinned = members.iter().any(|&member| bake.bodies[member].is_pinned);
            // A cluster comes with its first member.
            (members[0] == body).then_some(RigidGroup { name, members, is_fixed: held.anchored || is_pinned })
        };
        held.into_iter().enumerate().filter_map(group).collect()
    }
}

/// Masses and places of bodies, in a format's axes.
pub struct MassModel<'a> {
    pub bake: &'a BakedPile,
    /// From Cairn's axes to the format's.
    pub turn: DQuat,
}

impl MassModel<'_> {
    /// kg.
    pub fn mass(&self, body: usize) -> f64 {
        let BakedBody { prop, scale, mass_factor, .. } = self.bake.bodies[body];
        self.bake.solids[prop].mass * scale.powi(3) * mass_factor
    }

    /// Principal moments of inertia about a body's centre of mass, kg m^2, and the rotation from their axes to its own.
    pub fn inertia(&self, body: usize) -> (DVec3, DQuat) {
        let BakedBody { prop, scale, mass_factor, .. } = self.bake.bodies[body];
        let (principal, turn) = self.bake.solids[prop].inertia;
        (principal * scale.powi(5) * mass_factor, turn)
    }

    /// The pose of a body's centre of mass, with its axes.
    pub fn place(&self, body: usize) -> Pose {
        let BakedBody { prop, scale, .. } = self.bake.bodies[body];
        let Some(&pose) = self.bake.frames.last().and_then(|frame| frame.get(body)) else { return Pose::IDENTITY };
        let center = pose.transform_point(self.bake.solids[prop].center * scale);
        Pose { translation: self.turn * center, rotation: self.turn * pose.rotation }
    }

    /// The frame of bodies that move as one: at their centre of mass. A body alone keeps its axes; several have those
    /// of the world.
    pub fn frame(&self, members: &[usize]) -> Pose {
        let mass = self.total(members);
        let weighed = |&body: &usize| self.mass(body) * self.place(body).translation;
        let axes = if let [body] = members { self.place(*body).rotation } else { DQuat::IDENTITY };
        Pose { translation: members.iter().map(weighed).sum::<DVec3>() / mass, rotation: axes }
    }

    pub fn total(&self, members: &[usize]) -> f64 {
        members.iter().map(|&body| self.mass(body)).sum()
    }

    /// A body's centre of mass and axes in a frame.
    pub fn local(&self, body: usize, frame: &Pose) -> Pose {
        let place = self.place(body);
        let back = frame.rotation.inverse();
        Pose { translation: back * (place.translation - frame.translation), rotation: back * place.rotation }
    }

    /// Inertia of bodies about the origin of a frame, along its axes.
    pub fn inertia_in(&self, members: &[usize], frame: &Pose) -> DMat3 {
        let of = |&body: &usize| {
            let (principal, turn) = self.inertia(body);
            let local = self.local(body, frame);
            let axes = DMat3::from_quat(local.rotation * turn);
            let arm = local.translation;
            let outer = DMat3::from_cols(arm * arm.x, arm * arm.y, arm * arm.z);
            let parallel = DMat3::from_diagonal(DVec3::splat(arm.length_squared())) - outer;
            axes * DMat3::from_diagonal(principal) * axes.transpose() + parallel * self.mass(body)
        };
        members.iter().map(of).sum()
    }

    /// The axis-aligned box around all bodies, in Cairn's axes.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let radius = |solid: &BakedSolid| {
            let corners = solid.solid.meshes().into_iter().flat_map(|mesh| mesh.points);
            corners.map(DVec3::length).fold(0.0, f64::max)
        };
        let radii: Vec<f64> = self.bake.solids.iter().map(radius).collect();
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for (body, &BakedBody { prop, scale, .. }) in self.bake.bodies.iter().enumerate() {
            let (center, radius) = (self.turn.inverse() * self.place(body).translation, radii[prop] * scale);
            (low, high) = (low.min(center - radius), high.max(center + radius));
        }
        (low, high)
    }
}

/// A piece of scenery, and earlier results around the pile, as they stand in the last frame; Cairn's axes.
pub struct SceneryCollider {
    /// The number of its piece among all.
    pub piece: usize,
    pub mesh: TriMesh,
    pub friction: f64,
}

impl SceneryCollider {
    pub fn all(bake: &BakedPile, scene: &ExportScene) -> Vec<SceneryCollider> {
        let collider = |(piece, model): (usize, &StaticModel)| {
            let pose = bake.scenery.get(piece).and_then(|poses| poses.last()).copied().unwrap_or(Pose::IDENTITY);
            let moved = DAffine3::from_rotation_translation(pose.rotation, pose.translation);
            SceneryCollider { piece, mesh: model.model.mesh.transformed(&moved), friction: model.friction }
        };
        scene.colliders.iter().enumerate().map(collider).collect()
    }
}
