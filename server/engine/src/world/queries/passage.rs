//! Whether bodies pass at poses other than those that they have: for planned motion.

use crate::world::contacts::points;
use crate::world::{BodyId, ContactPoint, PairSide, World, units::to_engine};
use cairn_geometry::pose::Pose;
use glam::DVec3;
use rapier3d::parry::bounding_volume::Aabb;
use rapier3d::parry::query;
use rapier3d::parry::shape::Shape;
use rapier3d::prelude::{Collider, ColliderHandle, SharedShape, Vector};
use smallvec::SmallVec;

/// As many parts as most shapes have; not on the heap.
type Few<T> = SmallVec<[T; 16]>;

/// Something that a planned motion may meet, where it is in the world.
#[derive(Clone, Copy, Debug)]
pub struct Obstacle {
    pub side: PairSide,
    /// Of its box.
    pub low: DVec3,
    pub high: DVec3,
    handle: ColliderHandle,
}

impl Obstacle {
    /// Distance of a point from its box.
    pub fn distance(&self, point: DVec3) -> f64 {
        (self.low - point).max(point - self.high).max(DVec3::ZERO).length()
    }
}

impl World {
    /// What may be met by a body other than `id` inside of a box: bodies, scenery and the ground, in order.
    pub fn obstacles(&self, id: BodyId, low: DVec3, high: DVec3) -> Vec<Obstacle> {
        let side = |collider: &Collider| self.side_of(collider).filter(|&side| side != PairSide::Body(id));
        let tree = self.query();
        let found = tree.intersect_aabb_conservative(Aabb::new(low.as_vec3(), high.as_vec3()));
        let mut obstacles: Vec<Obstacle> = found
            .filter_map(|(handle, collider)| {
                let aabb = collider.compute_aabb();
                Some(Obstacle { side: side(collider)?, low: aabb.mins.as_dvec3(), high: aabb.maxs.as_dvec3(), handle })
            })
            .collect();
        obstacles.sort_unstable_by_key(|o| (o.side, o.handle.into_raw_parts()));
        obstacles
    }

    /// Distance between a body at `pose` and an obstacle where that is; negative: the depth. `None`: beyond `reach`.
    pub fn gap_at(&self, id: BodyId, pose: &Pose, obstacle: &Obstacle, reach: f64) -> Option<f64> {
        let other = self.engine.colliders.get(obstacle.handle)?;
        self.gap(id, pose, other, other.position(), reach)
    }

    /// The points at which a body at `pose` is no farther than `limit` from an obstacle, normals into the body; and
    /// their friction.
    pub fn touches_at(&self, id: BodyId, pose: &Pose, obstacle: &Obstacle, limit: f64) -> (f64, Vec<ContactPoint>) {
        let body = &self.bodies[id];
        let colliders = (self.engine.colliders.get(body.collider), self.engine.colliders.get(obstacle.handle));
        let (Some(own), Some(other)) = colliders else { return (0.0, Vec::new()) };
        let theirs = match obstacle.side {
            PairSide::Body(other) => self.bodies[other].friction,
            PairSide::Ground | PairSide::Scenery | PairSide::Moving => f64::from(other.friction()),
        };
        let at = to_engine(pose) * body.collider_pose;
        let found = points((&at, own.shape()), (other.position(), other.shape()), limit);
        ((body.friction + theirs) / 2.0, found)
    }

    /// Distance between two bodies, each at a pose; negative: the depth. `None`: beyond `reach`.
    pub fn gap_between(&self, first: (BodyId, &Pose), second: (BodyId, &Pose), reach: f64) -> Option<f64> {
        let other = &self.bodies[second.0];
        let collider = self.engine.colliders.get(other.collider)?;
        self.gap(first.0, first.1, collider, &(to_engine(second.1) * other.collider_pose), reach)
    }

    fn gap(&self, id: BodyId, pose: &Pose, other: &Collider, place: &rapier3d::math::Pose, reach: f64) -> Option<f64> {
        let body = &self.bodies[id];
        let own = self.engine.colliders.get(body.collider)?;
        let at = to_engine(pose) * body.collider_pose;
        let gap = match other.shape().as_halfspace() {
            // The library takes the pose for its inverse where a plane comes second.
            Some(plane) => lowest(own.shape(), &place.inv_mul(&at), plane.normal),
            None => gap_of_parts((&at, own.shape()), (place, other.shape()), reach as f32)?,
        };
        Some(f64::from(gap)).filter(|gap| gap.is_finite() && *gap <= reach)
    }
}

/// A convex part of a shape in the world, or the whole shape, with a ball around it.
struct Part<'a> {
    pose: rapier3d::math::Pose,
    shape: &'a dyn Shape,
    center: Vector,
    radius: f32,
}

fn parts<'a>(pose: &rapier3d::math::Pose, shape: &'a dyn Shape) -> Few<Part<'a>> {
    let part = |at: rapier3d::math::Pose, shape: &'a dyn Shape, local: &Aabb| {
        let center = *pose * local.center();
        Part { pose: at, shape, center, radius: local.half_extents().length() }
    };
    match shape.as_compound() {
        Some(compound) => {
            let parts = compound.shapes().iter().zip(compound.aabbs());
            parts.map(|((at, shape), local)| part(*pose * *at, &**shape, local)).collect()
        }
        None => std::iter::once(part(*pose, shape, &shape.compute_local_aabb())).collect(),
    }
}

/// Distance between two shapes; negative: the depth. `None`: beyond `reach`. Of parts, the nearest ones come first, and
/// those that are farther than what is found are not looked at.
fn gap_of_parts(
    first: (&rapier3d::math::Pose, &dyn Shape),
    second: (&rapier3d::math::Pose, &dyn Shape),
    reach: f32,
) -> Option<f32> {
    let (own, others) = (parts(first.0, first.1), parts(second.0, second.1));
    let least = |(i, j): (usize, usize)| {
        let (a, b) = (&own[i], &others[j]);
        (a.center.distance(b.center) - a.radius - b.radius, i, j)
    };
    let all = (0..own.len()).flat_map(|i| (0..others.len()).map(move |j| (i, j)));
    let mut pairs: Few<(f32, usize, usize)> = all.map(least).filter(|(gap, ..)| *gap <= reach).collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut found: Option<f32> = None;
    for (least, i, j) in pairs {
        if found.is_some_and(|found| least >= found) {
            break;
        }
        let most = found.unwrap_or(reach);
        let (a, b) = (&own[i], &others[j]);
        if let Ok(Some(contact)) = query::contact(&a.pose, a.shape, &b.pose, b.shape, most.max(0.0)) {
            found = Some(found.map_or(contact.dist, |found| found.min(contact.dist)));
        }
    }
    found
}

/// The least height of a shape at a pose over the plane through the origin with this normal.
fn lowest(shape: &dyn Shape, pose: &rapier3d::math::Pose, normal: Vector) -> f32 {
    if let Some(parts) = shape.as_compound() {
        let part = |(place, part): &(rapier3d::math::Pose, SharedShape)| lowest(&**part, &(*pose * *place), normal);
        return parts.shapes().iter().map(part).fold(f32::INFINITY, f32::min);
    }
    shape.as_support_map().map_or(f32::INFINITY, |map| map.support_point(pose, -normal).dot(normal))
}
