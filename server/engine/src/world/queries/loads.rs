//! Loads of the latest step.

use crate::world::{BodyId, Role, World};
use glam::DVec3;
use rapier3d::prelude::*;

/// Frequency of contact springs, per characteristic time, up to which loads are compared with kappa as they are.
const USUAL_FREQUENCY: f64 = 20.0;

impl World {
    /// Force of all contacts on a body, and its moment about the body's center of mass. Bodies that it is glued to do
    /// not count.
    pub fn load_on(&self, id: BodyId) -> (DVec3, DVec3) {
        let me = self.bodies[id].collider;
        let center = self.pose(id).translation;
        let (mut force, mut moment) = (DVec3::ZERO, DVec3::ZERO);
        for pair in self.engine.narrow_phase.contact_pairs_with(me) {
            let Some(first) = self.engine.colliders.get(pair.collider1) else { continue };
            let sign = if pair.collider1 == me { 1.0 } else { -1.0 };
            for patch in pair.solver_manifolds() {
                let (f, m) = self.load_of(patch, first.position(), center);
                force += sign * f;
                moment += sign * m;
            }
        }
        (force, moment)
    }

    /// Force of a patch on its first collider, which has this position, and its moment about `center`. Points that the
    /// solver left out keep impulses of earlier steps.
    fn load_of(&self, patch: &ContactManifold, position: &Pose, center: DVec3) -> (DVec3, DVec3) {
        let dt = self.step_length();
        let per_substep = self.engine.integration_parameters.num_solver_iterations as f64 / dt;
        let pose = patch.subshape_pos1().map_or(*position, |local| *position * *local);
        let normal = patch.data.normal.as_dvec3();
        let points: Vec<(DVec3, &ContactData)> = patch
            .data
            .solver_contacts
            .iter()
            .filter_map(|contact| patch.points.get(contact.contact_indices()[0] as usize))
            .map(|point| (pose.transform_point(point.local_p1).as_dvec3() - center, &point.data))
            .collect();
        let (mut force, mut moment) = (DVec3::ZERO, DVec3::ZERO);
        let mut add = |arm: DVec3, f: DVec3| {
            force += f;
            moment += arm.cross(f);
        };
        for (arm, data) in &points {
            add(*arm, -normal * (f64::from(data.impulse) / dt));
        }
        if self.has_friction_per_point() {
            points.iter().for_each(|(arm, data)| add(*arm, data.warmstart_tangent_world.as_dvec3() * per_substep));
        } else if let Some((_, data)) = points.last() {
            // The patch has one friction force, in its middle, and one twist; each of its points has them.
            let middle = points.iter().map(|(arm, _)| *arm).sum::<DVec3>() / points.len() as f64;
            add(middle, data.warmstart_tangent_world.as_dvec3() * per_substep);
            if points.len() > 1 {
                moment -= normal * (f64::from(data.warmstart_twist_impulse) * per_substep);
            }
        }
        (force, moment)
    }

    /// Held bodies on which free bodies press with more than `limit` times their own mass (engine units of force), in
    /// contacts of the usual stiffness. Stiffer springs press harder for the same overlap, by the square of their
    /// frequency. The excess force is an artifact, not a load; it is divided out.
    pub fn overloaded(&self, limit: f64) -> Vec<BodyId> {
        let free = |h: ColliderHandle| self.body_of(h).is_some_and(|id| self.bodies[id].role == Role::Free);
        let load = |id: BodyId| -> f64 {
            let me = self.bodies[id].collider;
            let pairs = self.engine.narrow_phase.contact_pairs_with(me);
            pairs
                .filter(|p| free(if p.collider1 == me { p.collider2 } else { p.collider1 }))
                .map(|p| p.total_impulse_magnitude() as f64)
                .sum()
        };
        let held = |&id: &BodyId| self.bodies[id].role == Role::Frozen;
        let stiffness = self.engine.integration_parameters.contact_softness.natural_frequency as f64 / USUAL_FREQUENCY;
        let limit = limit * self.step_length() * stiffness.powi(2).max(1.0);
        self.present().filter(held).filter(|&id| load(id) > limit * self.bodies[id].mass).collect()
    }

    /// Each contact point has a friction force of its own.
    pub fn has_friction_per_point(&self) -> bool {
        self.engine.integration_parameters.friction_model == FrictionModel::Coulomb
    }
}
