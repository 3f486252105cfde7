//! Coming hits: a held body must be free before it is hit, or it would stop the other like a wall.

use super::PairSide;
use crate::world::settings::PREDICTION;
use crate::world::{BodyId, Role, World};
use glam::DVec3;
use rapier3d::parry::bounding_volume::BoundingVolume;
use rapier3d::parry::query;
use rapier3d::prelude::{Collider, ColliderHandle};

/// A free body that will touch a held one within the next steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComingHit {
    pub hitter: BodyId,
    pub frozen: BodyId,
    /// Of their approach, engine units.
    pub speed: f64,
}

/// Steps ahead in which a hit is looked for: more than one, so that no hit is missed between two looks.
const STEPS_AHEAD: f64 = 1.5;
/// Moving scenery frees bodies that are nearer than this, in d.
const NEAR_MOVING: f64 = 0.05;

impl World {
    /// The coming hits on held bodies that are faster than `least`, in order of hitter and held.
    pub fn hits_ahead(&self, least: f64) -> Vec<ComingHit> {
        let mut hits = Vec::new();
        let fast = |&id: &BodyId| self.bodies[id].role == Role::Free && self.speed(id) > least;
        for hitter in self.present().filter(fast) {
            let reach = self.speed(hitter) * self.step_length() * STEPS_AHEAD;
            let mut near: Vec<BodyId> = self.frozen_around(self.bodies[hitter].collider, reach + PREDICTION);
            near.sort_unstable();
            for frozen in near {
                if let Some(speed) = self.approach(hitter, frozen, reach).filter(|&speed| speed > least) {
                    hits.push(ComingHit { hitter, frozen, speed });
                }
            }
        }
        hits
    }

    /// Held bodies that moving scenery is about to touch, ascending.
    pub fn frozen_near_moving(&self) -> Vec<BodyId> {
        let mut near = Vec::new();
        for piece in self.moving_colliders() {
            let collider = &self.engine.colliders[piece];
            for id in self.frozen_around(piece, NEAR_MOVING + PREDICTION) {
                let other = &self.engine.colliders[self.bodies[id].collider];
                let apart = query::distance(collider.position(), collider.shape(), other.position(), other.shape());
                if apart.is_ok_and(|apart| f64::from(apart.distance) <= NEAR_MOVING) {
                    near.push(id);
                }
            }
        }
        near.sort_unstable();
        near.dedup();
        near
    }

    /// Held bodies whose boxes are this near to a collider's.
    fn frozen_around(&self, collider: ColliderHandle, distance: f64) -> Vec<BodyId> {
        let aabb = self.engine.colliders[collider].compute_aabb().loosened(distance as f32);
        let frozen = |(_, other): (ColliderHandle, &Collider)| match self.side_of(other) {
            Some(PairSide::Body(id)) if self.bodies[id].role == Role::Frozen => Some(id),
            _ => None,
        };
        self.query().intersect_aabb_conservative(aabb).filter_map(frozen).collect()
    }

    /// Speed at which a body nears another that is not farther than `reach`, if it gets there within the steps ahead.
    fn approach(&self, hitter: BodyId, frozen: BodyId, reach: f64) -> Option<f64> {
        let [first, second] = [hitter, frozen].map(|id| &self.engine.colliders[self.bodies[id].collider]);
        let found =
            query::contact(first.position(), first.shape(), second.position(), second.shape(), reach as f32).ok()??;
        let body = &self.engine.bodies[self.bodies[hitter].carrier];
        let arm = found.point1.as_dvec3() - body.translation().as_dvec3();
        let velocity: DVec3 = body.linvel().as_dvec3() + body.angvel().as_dvec3().cross(arm);
        let speed = velocity.dot(found.normal1.as_dvec3());
        let in_time = speed * self.step_length() * STEPS_AHEAD >= f64::from(found.dist);
        (speed.is_finite() && in_time).then_some(speed)
    }
}
