//! What bodies meet and do not move: the ground, the walls of a container, and scenery that stands still or is moved from outside.

use super::{CONTAINER, FIRST_MOVING, GROUND, SCENERY, WallId, World, to_engine};
use crate::geometry::mesh::TriMesh;
use crate::geometry::pose::Pose;
use glam::DVec3;
use rapier3d::na::Unit;
use rapier3d::parry::shape::TriMeshFlags;
use rapier3d::prelude::*;

/// A piece of scenery with a pose of its own.
pub struct Moving {
    handle: RigidBodyHandle,
    collider: ColliderHandle,
    pose: Pose,
    /// Whether the current step moves it.
    pub moves: bool,
}

/// Bodies that the container's walls keep in, and those that they let out.
pub const KEPT_IN: Group = Group::GROUP_1;
pub const LET_OUT: Group = Group::GROUP_2;

/// Index of a piece of moving scenery.
pub type MovingId = usize;

impl World {
    /// The ground, a half-space below `height`.
    pub fn add_ground(&mut self, height: f64, friction: f64) {
        let ground = ColliderBuilder::halfspace(Unit::new_unchecked(Vector::Y))
            .translation(Vector::new(0.0, height as f32, 0.0))
            .friction(friction as f32)
            .user_data(GROUND);
        self.engine.insert_collider(ground, None);
    }

    /// Walls that keep bodies in: a mesh whose triangles face where the bodies are. Engine units.
    pub fn add_container(&mut self, mesh: &TriMesh, friction: f64) -> Result<WallId, String> {
        self.add_mesh(mesh, 1.0, friction, ONE_SIDED, CONTAINER).map(WallId)
    }

    /// Walls around others: what those let out is kept in by these, and nothing else meets them.
    pub fn add_walls_around(&mut self, mesh: &TriMesh, walls: WallId) -> Result<WallId, String> {
        let around = self.add_mesh(mesh, 1.0, 0.0, ONE_SIDED, CONTAINER)?;
        for (wall, met_by) in [(walls.0, !LET_OUT), (around, LET_OUT)] {
            let groups = InteractionGroups::new(Group::ALL, met_by, InteractionTestMode::And);
            self.engine.colliders[wall].set_collision_groups(groups);
        }
        Ok(WallId(around))
    }

    /// Adds what all bodies are near to, in the engine's order behind `bodies` of them. The engine finds a pair by a walk along all
    /// pairs of the one that comes first: were that a wall, N bodies would take N^2 steps.
    pub fn add_behind<T>(&mut self, bodies: usize, add: impl FnOnce(&mut World) -> T) -> T {
        let nothing = ColliderBuilder::ball(1e-3).enabled(false);
        let places: Vec<_> = (0..bodies).map(|_| self.engine.insert_collider(nothing.clone(), None)).collect();
        let added = add(self);
        // The place that was left last is taken first.
        for place in places.into_iter().rev() {
            self.engine.remove_collider(place);
        }
        added
    }

    /// A wall without end, facing `normal`.
    pub fn add_wall(&mut self, point: DVec3, normal: DVec3, friction: f64) -> WallId {
        let wall = ColliderBuilder::halfspace(Unit::new_unchecked(normal.as_vec3().normalize()))
            .translation(point.as_vec3())
            .friction(friction as f32)
            .user_data(CONTAINER);
        WallId(self.engine.insert_collider(wall, None))
    }

    pub fn remove_wall(&mut self, wall: WallId) {
        self.engine.remove_collider(wall.0);
    }

    /// `length`: an engine unit, in the mesh's own.
    fn add_mesh(
        &mut self,
        mesh: &TriMesh,
        length: f64,
        friction: f64,
        flags: TriMeshFlags,
        what: u128,
    ) -> Result<ColliderHandle, String> {
        let points = mesh.points.iter().map(|&p| (p / length).as_vec3()).collect();
        let collider = ColliderBuilder::trimesh_with_flags(points, mesh.triangles.clone(), flags)
            .map_err(|e| format!("the engine refuses the mesh: {e}"))?;
        Ok(self.engine.insert_collider(collider.friction(friction as f32).user_data(what), None))
    }

    /// Static geometry, seen from both sides. The mesh is in SI.
    pub fn add_scenery(&mut self, mesh: &TriMesh, friction: f64) -> Result<(), String> {
        self.add_mesh(mesh, self.units.length, friction, FLAGS, SCENERY).map(|_| ())
    }

    /// The core of a pile, closed and seen from outside: what has sunk into it is pushed out. The mesh is in SI.
    pub fn add_core(&mut self, mesh: &TriMesh, is_convex: bool, friction: f64) -> Result<(), String> {
        let points: Vec<Vector> = mesh.points.iter().map(|&p| (p / self.units.length).as_vec3()).collect();
        match ColliderBuilder::convex_hull(&points).filter(|_| is_convex) {
            Some(hull) => self.engine.insert_collider(hull.friction(friction as f32).user_data(SCENERY), None),
            None => self.add_mesh(mesh, self.units.length, friction, ONE_SIDED, SCENERY)?,
        };
        Ok(())
    }

    /// Geometry that moves, from its pose at the beginning on; SI.
    pub fn add_moving_scenery(&mut self, mesh: &TriMesh, friction: f64, pose: &Pose) -> Result<MovingId, String> {
        let id = self.moving.len();
        let pose = self.units.pose_to_engine(pose);
        let points = mesh.points.iter().map(|&p| (p / self.units.length).as_vec3()).collect();
        let collider = ColliderBuilder::trimesh_with_flags(points, mesh.triangles.clone(), FLAGS)
            .map_err(|e| format!("the engine refuses the mesh: {e}"))?
            .friction(friction as f32)
            .user_data(FIRST_MOVING + id as u128);
        let rigid = RigidBodyBuilder::kinematic_position_based().pose(to_engine(&pose));
        let (handle, collider) = self.engine.insert(rigid, collider);
        self.moving.push(Moving { handle, collider, pose, moves: false });
        Ok(id)
    }

    /// Where the next step shall take a piece of scenery; SI.
    pub fn move_scenery(&mut self, id: MovingId, pose: &Pose) {
        let pose = self.units.pose_to_engine(pose);
        let piece = &mut self.moving[id];
        let moved = pose != piece.pose;
        if !moved && !piece.moves {
            return;
        }
        (piece.moves, piece.pose) = (moved, pose);
        let body = &mut self.engine.bodies[piece.handle];
        body.set_next_kinematic_position(to_engine(&pose));
        if moved {
            // What sleeps on it must notice.
            self.engine.wake_up_all(true);
        }
    }

    /// What is on its way.
    pub(super) fn moving_colliders(&self) -> impl Iterator<Item = ColliderHandle> + '_ {
        self.moving.iter().filter(|piece| piece.moves).map(|piece| piece.collider)
    }

    /// Whether any scenery is on its way.
    pub fn scenery_moves(&self) -> bool {
        self.moving.iter().any(|piece| piece.moves)
    }
}

const FLAGS: TriMeshFlags = TriMeshFlags::FIX_INTERNAL_EDGES_TWO_SIDED.union(TriMeshFlags::DELETE_DEGENERATE_TRIANGLES);
const ONE_SIDED: TriMeshFlags =
    TriMeshFlags::ORIENTED.union(TriMeshFlags::FIX_INTERNAL_EDGES).union(TriMeshFlags::DELETE_DEGENERATE_TRIANGLES);
