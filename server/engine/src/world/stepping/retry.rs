//! The state before a step, and the retry of a step with smaller steps.

use crate::world::{BodyId, Role, World};
use rapier3d::prelude::*;

/// The moving bodies before a step.
#[derive(Default)]
pub struct Snapshot(Vec<MovingBody>);

/// State of a rigid body, with the body that leads it.
struct MovingBody {
    id: BodyId,
    pose: Pose,
    linear: Vector,
    angular: Vector,
}

/// Energy of a snapshot's bodies, measured now.
#[derive(Clone, Copy, Debug, Default)]
pub struct Energy {
    /// Kinetic and potential; gravity is 1 downward.
    pub whole: f64,
    pub kinetic: f64,
    /// Mass of the bodies.
    pub mass: f64,
}

impl World {
    /// Writes the free bodies that are awake, as they are now, into `snapshot`.
    pub fn snapshot(&self, snapshot: &mut Snapshot) {
        snapshot.0.clear();
        snapshot.0.extend(self.bodies.moving(&self.engine).map(|(id, rigid)| {
            let (linear, angular) = (rigid.linvel(), rigid.angvel());
            MovingBody { id, pose: *rigid.position(), linear, angular }
        }));
    }

    /// Measures the energy of a snapshot's bodies.
    pub fn energy_of(&self, snapshot: &Snapshot) -> Energy {
        let mut energy = Energy::default();
        for id in snapshot.0.iter().map(|body| body.id).filter(|&id| self.is_present(id)) {
            let rigid = &self.engine.bodies[self.bodies[id].carrier];
            let (kinetic, mass) = (f64::from(rigid.kinetic_energy()), self.bodies.carried(id).mass);
            energy.whole += kinetic + mass * f64::from(rigid.translation().y);
            energy.kinetic += kinetic;
            energy.mass += mass;
        }
        energy
    }

    /// Puts the bodies back to where they were, and takes the same step in `parts` smaller ones. Returns the bodies
    /// that became non-finite.
    pub fn retry_step(&mut self, before: &Snapshot, parts: u32) -> Vec<BodyId> {
        for was in &before.0 {
            if self.bodies[was.id].role != Role::Free {
                continue;
            }
            if let Some(rigid) = self.engine.bodies.get_mut(self.bodies[was.id].carrier) {
                rigid.set_position(was.pose, true);
                rigid.set_linvel(was.linear, false);
                rigid.set_angvel(was.angular, false);
            }
        }
        // It takes the place of the step that was taken before.
        self.steps -= 1;
        // The impulses that contacts remember are those of a whole step: as a first guess for a small one they would
        // burst.
        let warm = std::mem::take(&mut self.engine.integration_parameters.warmstart_coefficient);
        self.step_in_parts(parts, |world, _| {
            let lost = world.step();
            world.engine.integration_parameters.warmstart_coefficient = warm;
            lost
        })
    }

    /// Contacts and substeps this much stiffer and finer than the parameters have them.
    pub fn stiffen(&mut self, factor: u32) {
        let p = &mut self.engine.integration_parameters;
        p.num_solver_iterations *= factor as usize;
        p.contact_softness.natural_frequency *= factor as f32;
        p.static_contact_softness.natural_frequency *= factor as f32;
    }

    /// Ends [`World::stiffen`].
    pub fn unstiffen(&mut self, factor: u32) {
        let p = &mut self.engine.integration_parameters;
        p.num_solver_iterations /= factor as usize;
        p.contact_softness.natural_frequency /= factor as f32;
        p.static_contact_softness.natural_frequency /= factor as f32;
    }
}
