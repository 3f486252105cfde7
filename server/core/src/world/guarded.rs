//! What the guard needs of the world: the state before a step, the same step once more in smaller ones, and how deep
//! bodies are in each other by the engine's own account.

use super::{BodyId, Role, World};
use rapier3d::prelude::*;

/// The moving bodies before a step.
pub struct State(Vec<Moved>);

struct Moved {
    id: BodyId,
    pose: Pose,
    linear: Vector,
    angular: Vector,
    /// Kinetic and potential; gravity is 1 downward.
    energy: f64,
}

/// What a step did to the energy of the bodies that moved.
#[derive(Clone, Copy, Debug, Default)]
pub struct Gain {
    pub gained: f64,
    /// Kinetic, before the step.
    pub kinetic: f64,
    /// Mass of the bodies.
    pub mass: f64,
}

impl World {
    /// The free bodies that are awake, as they are now.
    pub fn state(&self) -> State {
        let moved = |id: BodyId| {
            let rigid = &self.engine.bodies[self.bodies[id].handle];
            let (linear, angular) = (rigid.linvel(), rigid.angvel());
            Moved { id, pose: *rigid.position(), linear, angular, energy: self.energy(id) }
        };
        State((0..self.bodies.len()).filter(|&id| self.is_awake(id)).map(moved).collect())
    }

    fn energy(&self, id: BodyId) -> f64 {
        let rigid = &self.engine.bodies[self.bodies[id].handle];
        f64::from(rigid.kinetic_energy()) + self.bodies[id].mass * f64::from(rigid.translation().y)
    }

    /// What the last step did to the bodies that were awake before it.
    pub fn gain_since(&self, before: &State) -> Gain {
        let mut gain = Gain::default();
        for was in before.0.iter().filter(|was| self.is_present(was.id)) {
            let mass = self.bodies[was.id].mass;
            gain.gained += self.energy(was.id) - was.energy;
            gain.kinetic += was.energy - mass * f64::from(was.pose.translation.y);
            gain.mass += mass;
        }
        gain
    }

    /// Puts the bodies back to where they were, and takes the same step in `parts` smaller ones. Returns the bodies that the
    /// engine set aside.
    pub fn step_again(&mut self, before: &State, parts: u32) -> Vec<BodyId> {
        for was in &before.0 {
            if self.bodies[was.id].role != Role::Free {
                continue;
            }
            if let Some(rigid) = self.engine.bodies.get_mut(self.bodies[was.id].handle) {
                rigid.set_position(was.pose, true);
                rigid.set_linvel(was.linear, false);
                rigid.set_angvel(was.angular, false);
            }
        }
        let (dt, steps) = (self.engine.integration_parameters.dt, self.steps);
        self.engine.integration_parameters.dt = dt / parts as f32;
        let lost = (0..parts).flat_map(|_| self.step()).collect();
        self.engine.integration_parameters.dt = dt;
        self.steps = steps;
        lost
    }

    /// Pairs that overlap by more than `share` of the thinner one's thickness, as the engine's contacts have it.
    pub fn deep_pairs(&self, share: f64) -> Vec<(BodyId, Option<BodyId>)> {
        let deepest = |pair: &ContactPair| {
            let points = pair.manifolds().iter().flat_map(|m| &m.points);
            f64::from(points.map(|p| -p.dist).fold(0.0, f32::max))
        };
        let mut deep = Vec::new();
        for pair in self.engine.narrow_phase.contact_pairs() {
            let depth = deepest(pair);
            if depth <= 0.0 {
                continue;
            }
            let (a, b) = match (self.body_of(pair.collider1), self.body_of(pair.collider2)) {
                (Some(a), b) => (a, b),
                (None, Some(b)) => (b, None),
                (None, None) => continue,
            };
            let thickness = |id: BodyId| self.bodies[id].thickness;
            if depth > share * b.map_or(f64::INFINITY, thickness).min(thickness(a)) {
                deep.push((a.min(b.unwrap_or(a)), b.map(|b| a.max(b))));
            }
        }
        deep.sort_unstable();
        deep.dedup();
        deep
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

    /// The speed at which a body would have as much energy by moving as it has by turning.
    pub fn spin(&self, id: BodyId) -> f64 {
        let rigid = &self.engine.bodies[self.bodies[id].handle];
        let inertia = rigid.mass_properties().local_mprops.reconstruct_inertia_matrix();
        let spin = rigid.rotation().inverse() * rigid.angvel();
        (f64::from(spin.dot(inertia * spin)) / self.bodies[id].mass).sqrt()
    }
}
