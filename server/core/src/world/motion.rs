//! How the bodies move, and what the engine's last step left undone.

use super::{BodyId, Role, World};
use crate::input::params::Switch;
use glam::DVec3;
use rapier3d::prelude::*;

/// Momentum and angular momentum about the centre of mass, engine units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Momentum {
    pub linear: DVec3,
    pub angular: DVec3,
}

/// By how much friction exceeds what Coulomb's law allows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrictionExcess {
    /// Largest (|ft| - mu fn) / (mu fn) of a patch, never below 0.
    pub max: f64,
    /// Sums over the patches of |ft| - mu fn, never below 0, and of mu fn.
    pub excess: f64,
    pub limit: f64,
}

/// A body is fast if it moves by more than this share of its thickness in a step.
const FAST: f64 = 0.5;
/// The same where the user has switched continuous collision on.
const CAREFULLY_FAST: f64 = 0.1;

impl World {
    /// Speed of the fastest point of a body.
    pub fn speed(&self, id: BodyId) -> f64 {
        // What is gone has no body to look at.
        if !self.is_awake(id) {
            return 0.0;
        }
        let body = self.rigid(id);
        let turning = body.angvel().length() as f64 * self.bodies[id].radius;
        let moving =
            if self.cluster_of(id).is_some() { self.velocity(id).length() } else { body.linvel().length() as f64 };
        moving + turning
    }

    /// Before a step: what is fast must neither pass through what it hits nor stop deep in it. One convex shape is swept along
    /// its way; the engine never sweeps two such bodies against each other, so that not all may be. Several parts swept one by one
    /// jam in what they touch already: their contacts are found a step ahead instead (speculative contacts).
    pub(super) fn watch_fast_ones(&mut self) {
        let dt = self.engine.integration_parameters.dt;
        let share = match self.ccd {
            Switch::Auto => FAST,
            Switch::On => CAREFULLY_FAST,
            Switch::Off => return,
        };
        for (id, body) in self.bodies.iter().enumerate().filter(|(_, body)| body.role == Role::Free) {
            if !self.leads(id) {
                continue;
            }
            let rigid = &self.engine.bodies[body.handle];
            let (_, radius, thickness) = self.carried(id);
            let has_parts =
                body.cluster.is_some() || self.engine.colliders[body.collider].shape().as_compound().is_some();
            let turn = if has_parts { rigid.angvel().length() * radius as f32 } else { 0.0 };
            let way = (rigid.linvel().length() + turn) * dt;
            let is_fast = way > (share * thickness) as f32;
            let (is_swept, ahead) = (is_fast && !has_parts, if is_fast && has_parts { way } else { 0.0 });
            if is_fast && !rigid.is_sleeping() {
                self.counters.ccd_body_steps += u64::from(is_swept);
                self.counters.speculative_body_steps += u64::from(has_parts);
            }
            if (is_swept, ahead) != (rigid.is_ccd_enabled(), rigid.soft_ccd_prediction())
                && let Some(rigid) = self.engine.bodies.get_mut(body.handle)
            {
                rigid.enable_ccd(is_swept);
                rigid.set_soft_ccd_prediction(ahead);
            }
        }
    }

    /// Whether the engine simulates the body at present.
    pub fn is_awake(&self, id: BodyId) -> bool {
        self.bodies[id].role == Role::Free && !self.rigid(id).is_sleeping()
    }

    pub fn momentum(&self, id: BodyId) -> Momentum {
        Momentum {
            linear: self.velocity(id) * self.bodies[id].mass,
            angular: self.inertia(id) * self.angular_velocity(id),
        }
    }

    /// Kinetic energy of all free bodies.
    pub fn kinetic_energy(&self) -> f64 {
        let energy = |id: BodyId| self.rigid(id).kinetic_energy() as f64;
        let moves = |&id: &BodyId| self.bodies[id].role == Role::Free && self.leads(id);
        self.present().filter(moves).map(energy).sum()
    }

    /// Kinetic and potential energy of all bodies; gravity is 1 downward.
    pub fn mechanical_energy(&self) -> f64 {
        let height = |id: BodyId| self.bodies[id].mass * self.pose(id).translation.y;
        self.kinetic_energy() + self.present().map(height).sum::<f64>()
    }

    /// Friction against Coulomb's law, over the contact patches that carry more than `least` (engine units of force); from
    /// the forces of the engine's last substep.
    pub fn friction_excess(&self, least: f64) -> FrictionExcess {
        let patches =
            self.engine.narrow_phase.contact_pairs().filter(|pair| self.moves(pair.collider1, pair.collider2));
        let mut total = FrictionExcess::default();
        for (excess, limit) in patches.flat_map(|pair| pair.manifolds()).filter_map(|m| self.excess(m, least)) {
            total.max = total.max.max(excess / limit);
            total.excess += excess;
            total.limit += limit;
        }
        total
    }

    /// |ft| - mu fn, never below 0, and mu fn; of one patch.
    fn excess(&self, patch: &ContactManifold, least: f64) -> Option<(f64, f64)> {
        let normal: f64 = patch.points.iter().map(|p| p.data.warmstart_impulse as f64).sum();
        let parameters = &self.engine.integration_parameters;
        let substep = self.step_length() / parameters.num_solver_iterations as f64;
        let limit = patch.data.friction as f64 * normal;
        if normal <= least * substep || limit <= 0.0 {
            return None;
        }
        let tangents = patch.points.iter().map(|p| p.data.warmstart_tangent_world);
        let tangent = match parameters.friction_model {
            // The patch has one friction force, and each of its points tells it.
            FrictionModel::Simplified => tangents.take(1).sum::<Vector>(),
            FrictionModel::Coulomb => tangents.sum(),
        };
        Some(((tangent.length() as f64 - limit).max(0.0), limit))
    }

    fn moves(&self, a: ColliderHandle, b: ColliderHandle) -> bool {
        let awake = |h: ColliderHandle| self.body_of(h).is_some_and(|id| self.is_awake(id));
        awake(a) || awake(b)
    }

    fn rigid(&self, id: BodyId) -> &RigidBody {
        &self.engine.bodies[self.bodies[id].handle]
    }
}
