//! Friction of the latest step against Coulomb's law.

use crate::world::World;
use rapier3d::prelude::*;

/// By how much friction exceeds the limit of Coulomb's law.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrictionExcess {
    /// Largest (|ft| - mu fn) / (mu fn) of a patch, never below 0.
    pub max: f64,
    /// Sums over the patches of |ft| - mu fn, never below 0, and of mu fn.
    pub excess: f64,
    pub limit: f64,
}

impl World {
    /// Friction against Coulomb's law, over the contact patches that carry more than `least` (engine units of force);
    /// from the forces of the engine's last substep.
    pub fn friction_excess(&self, least: f64) -> FrictionExcess {
        let is_awake = |h: ColliderHandle| self.body_of(h).is_some_and(|id| self.is_awake(id));
        let pairs = self.engine.narrow_phase.contact_pairs();
        let patches = pairs.filter(|pair| is_awake(pair.collider1) || is_awake(pair.collider2));
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
            // The patch has one friction force, and each of its points has it.
            FrictionModel::Simplified => tangents.take(1).sum::<Vector>(),
            FrictionModel::Coulomb => tangents.sum(),
        };
        Some(((tangent.length() as f64 - limit).max(0.0), limit))
    }
}
