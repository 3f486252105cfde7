//! What the guard needs of the world: the state before a step, the same step once more in smaller ones, and how deep
//! bodies are in each other by the engine's own account.

use super::{BodyId, Role, World};
use rapier3d::prelude::*;

/// The moving bodies before a step.
#[derive(Default)]
pub struct Snapshot(Vec<Moved>);

struct Moved {
    id: BodyId,
    pose: Pose,
    linear: Vector,
    angular: Vector,
}

/// The energy of the bodies of a state, at another time.
#[derive(Clone, Copy, Debug, Default)]
pub struct Energy {
    /// Kinetic and potential; gravity is 1 downward.
    pub whole: f64,
    pub kinetic: f64,
    /// Mass of the bodies.
    pub mass: f64,
}

impl World {
    /// Takes note of the free bodies that are awake, as they are now.
    pub fn note(&self, state: &mut Snapshot) {
        state.0.clear();
        for (id, body) in self.bodies.iter().enumerate().filter(|(_, body)| body.role == Role::Free) {
            let rigid = &self.engine.bodies[body.handle];
            if !rigid.is_sleeping() && self.leads(id) {
                let (linear, angular) = (rigid.linvel(), rigid.angvel());
                state.0.push(Moved { id, pose: *rigid.position(), linear, angular });
            }
        }
    }

    /// What the bodies of a state have now.
    pub fn energy_of(&self, state: &Snapshot) -> Energy {
        let mut energy = Energy::default();
        for id in state.0.iter().map(|moved| moved.id).filter(|&id| self.is_present(id)) {
            let rigid = &self.engine.bodies[self.bodies[id].handle];
            let (kinetic, mass) = (f64::from(rigid.kinetic_energy()), self.carried(id).0);
            energy.whole += kinetic + mass * f64::from(rigid.translation().y);
            energy.kinetic += kinetic;
            energy.mass += mass;
        }
        energy
    }

    /// Puts the bodies back to where they were, and takes the same step in `parts` smaller ones. Returns the bodies that the
    /// engine set aside.
    pub fn step_again(&mut self, before: &Snapshot, parts: u32) -> Vec<BodyId> {
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
        // The impulses that contacts remember are those of a whole step: as a first guess for a small one they would burst.
        let warm = std::mem::take(&mut self.engine.integration_parameters.warmstart_coefficient);
        self.engine.integration_parameters.dt = dt / parts as f32;
        let mut lost = self.step();
        self.engine.integration_parameters.warmstart_coefficient = warm;
        lost.extend((1..parts).flat_map(|_| self.step()).collect::<Vec<_>>());
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

    /// Free bodies that are awake and move, or turn, faster than this, or are farther below `ground` than they are large and
    /// sink faster than `sinking`: whether too fast, and which. Turning counts by the speed of as much energy.
    pub fn astray(&self, most: f64, most_spin: f64, ground: f64, sinking: f64) -> Vec<(BodyId, bool)> {
        let mut astray = Vec::new();
        for (id, body) in self.bodies.iter().enumerate().filter(|(_, body)| body.role == Role::Free) {
            let rigid = &self.engine.bodies[body.handle];
            if rigid.is_sleeping() || !self.leads(id) {
                continue;
            }
            let (_, radius, _) = self.carried(id);
            // The rim is faster than what counts: most bodies need no more than this look.
            let may_spin = f64::from(rigid.angvel().length()) * radius > most_spin;
            let too_fast = f64::from(rigid.linvel().length()) > most || may_spin && self.spin(id) > most_spin;
            let below = f64::from(rigid.translation().y) < ground - radius && f64::from(rigid.linvel().y) < -sinking;
            if too_fast || below {
                astray.push((id, too_fast));
            }
        }
        astray
    }

    fn spin(&self, id: BodyId) -> f64 {
        let rigid = &self.engine.bodies[self.bodies[id].handle];
        let inertia = rigid.mass_properties().local_mprops.reconstruct_inertia_matrix();
        let spin = rigid.rotation().inverse() * rigid.angvel();
        (f64::from(spin.dot(inertia * spin)) / self.carried(id).0).sqrt()
    }
}
