//! Things that bodies meet and do not move: the ground, the container, and scenery that stands still or is moved from
//! outside.

use super::colliders::{OUTSIDE, Owner};
use super::{MovingId, World, corrections::turning::TurningPiece, units::from_engine, units::to_engine};
use crate::shape::Hull;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use glam::DVec3;
use rapier3d::na::Unit;
use rapier3d::parry::shape::TriMeshFlags;
use rapier3d::prelude::*;

/// A wall of a container.
#[derive(Clone, Copy, Debug)]
pub struct WallId(ColliderHandle);

/// A piece of scenery with a pose of its own.
#[derive(Clone)]
pub(super) struct MovingPiece {
    handle: RigidBodyHandle,
    pub collider: ColliderHandle,
    pose: Pose,
    /// Of the sphere about the origin of its own frame that holds it, engine units.
    radius: f64,
    /// Whether the current step moves it.
    pub moves: bool,
}

/// The way of a moving piece through a step: from its pose before.
pub(super) struct SceneryPath {
    piece: usize,
    from: Pose,
    to: Pose,
}

/// Scenery that moves by more than this share of a near body's thickness in a step passes into it, and a thin wall
/// through it: such a step is taken in smaller ones, but in at most so many.
const FAST: f64 = 0.1;
const MOST_PARTS: u32 = 32;
/// Scenery turns if it does so faster than this, per characteristic time: less is the rounding of its poses.
const TURNS: f64 = 1e-4;

/// Scenery is seen from both sides; a container, and the core of a pile, from the side that its triangles face.
const TWO_SIDED: TriMeshFlags =
    TriMeshFlags::FIX_INTERNAL_EDGES_TWO_SIDED.union(TriMeshFlags::DELETE_DEGENERATE_TRIANGLES);
const ONE_SIDED: TriMeshFlags =
    TriMeshFlags::ORIENTED.union(TriMeshFlags::FIX_INTERNAL_EDGES).union(TriMeshFlags::DELETE_DEGENERATE_TRIANGLES);

impl World {
    /// The ground, a half-space below `height`.
    pub fn add_ground(&mut self, height: f64, friction: f64) {
        let ground = ColliderBuilder::halfspace(Unit::new_unchecked(Vector::Y))
            .translation(Vector::new(0.0, height as f32, 0.0))
            .friction(friction as f32)
            .user_data(Owner::Ground.user_data());
        self.engine.insert_collider(ground, None);
    }

    /// Walls that keep bodies in: a mesh whose triangles face where the bodies are. Engine units.
    pub fn add_container(&mut self, mesh: &TriMesh, friction: f64) -> Result<WallId, String> {
        let container = mesh_collider(mesh, 1.0, friction, ONE_SIDED, Owner::Container)?;
        Ok(WallId(self.engine.insert_collider(container, None)))
    }

    /// A container around another one: it keeps in the bodies that the inner one lets through, and meets nothing else.
    pub fn add_walls_around(&mut self, mesh: &TriMesh, walls: WallId) -> Result<WallId, String> {
        let WallId(around) = self.add_container(mesh, 0.0)?;
        for (wall, met_by) in [(walls.0, !OUTSIDE), (around, OUTSIDE)] {
            let groups = InteractionGroups::new(Group::ALL, met_by, InteractionTestMode::And);
            self.engine.colliders[wall].set_collision_groups(groups);
        }
        Ok(WallId(around))
    }

    /// Adds a collider that all bodies are near to, in the engine's order behind `bodies` of them. The engine finds a
    /// pair by a walk along all pairs of the collider that comes first: were that a wall, N bodies would take N^2
    /// steps.
    pub fn add_behind<T>(&mut self, bodies: usize, add: impl FnOnce(&mut World) -> T) -> T {
        let nothing = ColliderBuilder::ball(1e-3).enabled(false);
        let places: Vec<_> = (0..bodies).map(|_| self.engine.insert_collider(nothing.clone(), None)).collect();
        let added = add(self);
        // The engine fills the place that was freed last first.
        for place in places.into_iter().rev() {
            self.engine.remove_collider(place);
        }
        added
    }

    /// An infinite wall that faces `normal`.
    pub fn add_wall(&mut self, point: DVec3, normal: DVec3, friction: f64) -> WallId {
        let wall = ColliderBuilder::halfspace(Unit::new_unchecked(normal.as_vec3().normalize()))
            .translation(point.as_vec3())
            .friction(friction as f32)
            .user_data(Owner::Container.user_data());
        WallId(self.engine.insert_collider(wall, None))
    }

    pub fn remove_wall(&mut self, wall: WallId) {
        self.engine.remove_collider(wall.0);
    }

    pub fn set_wall_friction(&mut self, wall: WallId, friction: f64) {
        self.engine.colliders[wall.0].set_friction(friction as f32);
    }

    /// Static geometry. The mesh is in SI.
    pub fn add_scenery(&mut self, mesh: &TriMesh, friction: f64) -> Result<(), String> {
        self.add_piece(&self.units.mesh_to_engine(mesh), friction).map(|_| ())
    }

    /// The same, in engine units.
    pub fn add_piece(&mut self, mesh: &TriMesh, friction: f64) -> Result<WallId, String> {
        let scenery = mesh_collider(mesh, 1.0, friction, TWO_SIDED, Owner::Scenery(self.still_pieces))?;
        self.still_pieces += 1;
        Ok(WallId(self.engine.insert_collider(scenery, None)))
    }

    /// Whether a collider is scenery that moves, and its index among those; `None`: it is none.
    pub(super) fn piece(&self, handle: ColliderHandle) -> Option<(bool, usize)> {
        match Owner::of(self.engine.colliders.get(handle)?) {
            Owner::Scenery(id) => Some((false, id)),
            Owner::Moving(id) => Some((true, id)),
            _ => None,
        }
    }

    /// A closed solid, such as the core of a pile: bodies that have sunk into it are pushed out. The mesh is in SI.
    pub fn add_core(&mut self, mesh: &TriMesh, is_convex: bool, friction: f64) -> Result<WallId, String> {
        let mesh = self.units.mesh_to_engine(mesh);
        let points: Vec<Vector> = mesh.points.iter().map(|p| p.as_vec3()).collect();
        let core = match Hull::new(&points).filter(|_| is_convex) {
            Some(hull) => ColliderBuilder::new(SharedShape::new(hull))
                .friction(friction as f32)
                .user_data(Owner::Core.user_data()),
            None => mesh_collider(&mesh, 1.0, friction, ONE_SIDED, Owner::Core)?,
        };
        Ok(WallId(self.engine.insert_collider(core, None)))
    }

    /// Geometry that moves, from its pose at the beginning on; SI.
    pub fn add_moving_scenery(&mut self, mesh: &TriMesh, friction: f64, pose: &Pose) -> Result<MovingId, String> {
        let id = self.moving.len();
        let pose = self.units.pose_to_engine(pose);
        let collider = mesh_collider(mesh, self.units.length, friction, TWO_SIDED, Owner::Moving(id))?;
        let rigid = RigidBodyBuilder::kinematic_position_based().pose(to_engine(&pose));
        let (handle, collider) = self.engine.insert(rigid, collider);
        // The engine would know it from its next step on: until then, the control would not see what it carries.
        let bounds = self.engine.colliders[collider].compute_aabb();
        self.engine.broad_phase.set_aabb(&self.engine.integration_parameters, collider, bounds);
        let radius = mesh.points.iter().map(|p| p.length()).fold(0.0, f64::max) / self.units.length;
        self.moving.push(MovingPiece { handle, collider, pose, radius, moves: false });
        Ok(id)
    }

    /// The pose to which the next step takes a piece of scenery; SI.
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
            // Bodies that sleep on it must notice.
            self.engine.wake_up_all(true);
        }
    }

    /// Colliders of the scenery that moves.
    pub(super) fn moving_colliders(&self) -> impl Iterator<Item = ColliderHandle> + '_ {
        self.moving.iter().filter(|piece| piece.moves).map(|piece| piece.collider)
    }

    /// How many steps the next one must be taken in, so that moving scenery does not pass through bodies.
    pub(super) fn scenery_parts(&self, paths: &[SceneryPath]) -> u32 {
        let parts = |path: &SceneryPath| {
            let piece = &self.moving[path.piece];
            let length = path.from.moved(&path.to, piece.radius);
            // Bodies that it may meet in this step.
            let near = self.bodies.free().filter(|&(id, body)| {
                let reach = piece.radius + length + body.radius;
                self.pose(id).translation.distance_squared(path.from.translation) < reach * reach
            });
            let thinnest = near.map(|(_, body)| body.thickness).fold(f64::INFINITY, f64::min);
            (length / (FAST * thinnest)).ceil().clamp(1.0, f64::from(MOST_PARTS)) as u32
        };
        paths.iter().map(parts).max().unwrap_or(1)
    }

    pub(super) fn scenery_paths(&self) -> Vec<SceneryPath> {
        let moving = self.moving.iter().enumerate().filter(|(_, piece)| piece.moves);
        let path = |(piece, moved): (usize, &MovingPiece)| {
            let from = from_engine(self.engine.bodies[moved.handle].position());
            SceneryPath { piece, from, to: moved.pose }
        };
        moving.map(path).collect()
    }

    /// The pieces that turn on these paths, in a step.
    pub(super) fn turning_pieces(&self, paths: &[SceneryPath]) -> Vec<TurningPiece> {
        let turning = |path: &SceneryPath| {
            let turn = path.to.rotation * path.from.rotation.inverse();
            // Twice the sine of half the angle: a step turns by little.
            let velocity = 2.0 * turn.w.signum() * turn.xyz() / self.step_length();
            let &MovingPiece { handle, collider, .. } = &self.moving[path.piece];
            let angular_velocity = velocity.as_vec3();
            (velocity.length() > TURNS).then_some(TurningPiece { body: handle, collider, angular_velocity })
        };
        paths.iter().filter_map(turning).collect()
    }

    /// The next step takes the pieces to this share of their paths.
    pub(super) fn place_scenery_along(&mut self, paths: &[SceneryPath], share: f64) {
        for path in paths {
            let pose = if share < 1.0 { path.from.interpolate_arc(&path.to, share) } else { path.to };
            self.engine.bodies[self.moving[path.piece].handle].set_next_kinematic_position(to_engine(&pose));
        }
    }

    /// Whether any scenery moves.
    pub fn scenery_moves(&self) -> bool {
        self.moving.iter().any(|piece| piece.moves)
    }
}

/// `length`: an engine unit, in the mesh's own.
fn mesh_collider(
    mesh: &TriMesh,
    length: f64,
    friction: f64,
    flags: TriMeshFlags,
    owner: Owner,
) -> Result<ColliderBuilder, String> {
    let points = mesh.points.iter().map(|&p| (p / length).as_vec3()).collect();
    let collider = ColliderBuilder::trimesh_with_flags(points, mesh.triangles.clone(), flags)
        .map_err(|e| format!("the engine refuses the mesh: {e}"))?;
    Ok(collider.friction(friction as f32).user_data(owner.user_data()))
}
