//! What contacts do to a body in the latest step.

use super::{BodyId, World};
use glam::DVec3;

impl World {
    /// Force of all contacts on a body, and its moment about the body's centre of mass. Those it is glued to are not asked.
    pub fn load_on(&self, id: BodyId) -> (DVec3, DVec3) {
        let me = self.bodies[id].collider;
        let center = self.pose(id).translation;
        let (dt, substeps) = (self.step_length(), self.engine.integration_parameters.num_solver_iterations as f64);
        let patch_wide = !self.has_friction_per_point();
        let (mut force, mut moment) = (DVec3::ZERO, DVec3::ZERO);
        for pair in self.engine.narrow_phase.contact_pairs_with(me) {
            let Some(first) = self.engine.colliders.get(pair.collider1) else { continue };
            let sign = if pair.collider1 == me { 1.0 } else { -1.0 };
            for patch in pair.manifolds() {
                let pose = patch.subshape_pos1().map_or(*first.position(), |local| *first.position() * *local);
                let normal = patch.data.normal.as_dvec3();
                for (k, point) in patch.points.iter().enumerate() {
                    let mut push = -normal * (f64::from(point.data.impulse) / dt);
                    // The patch has one friction force, and each of its points tells it.
                    if k == 0 || !patch_wide {
                        push += point.data.warmstart_tangent_world.as_dvec3() * (substeps / dt);
                    }
                    let at = pose.transform_point(point.local_p1).as_dvec3();
                    force += sign * push;
                    moment += (at - center).cross(sign * push);
                }
            }
        }
        (force, moment)
    }
}
