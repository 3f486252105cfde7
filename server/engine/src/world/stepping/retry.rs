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
    /// Kinetic and potential.
    energy: f64,
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
            MovingBody { id, pose: *rigid.position(), linear, angular, energy: self.energy(id).0 }
        }));
    }

    /// Measures the energy of a snapshot's bodies.
    pub fn energy_of(&self, snapshot: &Snapshot) -> Energy {
        let mut energy = Energy::default();
        for id in snapshot.0.iter().map(|body| body.id).filter(|&id| self.is_present(id)) {
            let (whole, kinetic) = self.energy(id);
            energy.whole += whole;
            energy.kinetic += kinetic;
            energy.mass += self.bodies.carried(id).mass;
        }
        energy
    }

    /// Of the rigid body that carries a body: the whole, and the kinetic one.
    fn energy(&self, id: BodyId) -> (f64, f64) {
        let rigid = &self.engine.bodies[self.bodies[id].carrier];
        let kinetic = f64::from(rigid.kinetic_energy());
        (kinetic + self.bodies.carried(id).mass * f64::from(rigid.center_of_mass().y), kinetic)
    }

    /// Takes energy out of the motion of the bodies that have gained some since a snapshot, each by its share of what
    /// they gained. Returns what was taken.
    pub fn take_energy(&mut self, before: &Snapshot, energy: f64) -> f64 {
        let of_now = |body: &MovingBody| {
            let is_free = self.is_present(body.id) && self.bodies[body.id].role == Role::Free;
            let (whole, kinetic) = if is_free { self.energy(body.id) } else { (body.energy, 0.0) };
            (body.id, (whole - body.energy).max(0.0), kinetic)
        };
        let gains: Vec<(BodyId, f64, f64)> = before.0.iter().map(of_now).filter(|gain| gain.1 > 0.0).collect();
        let all: f64 = gains.iter().map(|gain| gain.1).sum();
        let mut taken = 0.0;
        for (id, gain, kinetic) in gains {
            let out = (energy * gain / all).min(kinetic);
            // All of it is motion.
            let factor = if kinetic > 0.0 { (1.0 - out / kinetic).max(0.0).sqrt() as f32 } else { 1.0 };
            if let Some(rigid) = self.engine.bodies.get_mut(self.bodies[id].carrier).filter(|_| factor.is_finite()) {
                rigid.set_linvel(rigid.linvel() * factor, false);
                rigid.set_angvel(rigid.angvel() * factor, false);
                taken += out;
            }
        }
        taken
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
