//! One step of the world, and the other ways to move it on.

mod depenetration;
mod retry;

use crate::invariants;
pub use depenetration::DEEPEST;
pub use retry::{Energy, Snapshot};

use super::{BodyId, World, corrections::ccd, corrections::resistance};
use glam::DVec3;

impl World {
    /// One step. Returns the bodies whose state became non-finite: they are removed.
    pub fn step(&mut self) -> Vec<BodyId> {
        let paths = self.scenery_paths();
        let parts = self.scenery_parts(&paths);
        let turning = self.turning_pieces(&paths);
        let World { turning: correction, engine, bodies, moving, .. } = self;
        correction.renew_contacts(turning, moving.iter().map(|piece| piece.collider), engine, bodies);
        if parts == 1 {
            return self.single_step();
        }
        self.counters.scenery_part_steps += u64::from(parts);
        // Moving scenery moves evenly through the step.
        self.step_in_parts(parts, |world, part| {
            world.place_scenery_along(&paths, f64::from(part) / f64::from(parts));
            world.single_step()
        })
    }

    /// One step in `parts` smaller ones. `step`: takes one of them; it gets its number, from 1.
    fn step_in_parts(&mut self, parts: u32, mut step: impl FnMut(&mut World, u32) -> Vec<BodyId>) -> Vec<BodyId> {
        let (dt, steps) = (self.engine.integration_parameters.dt, self.steps);
        self.engine.integration_parameters.dt = dt / parts as f32;
        let lost = (1..=parts).flat_map(|part| step(self, part)).collect();
        self.engine.integration_parameters.dt = dt;
        self.steps = steps + 1;
        lost
    }

    fn single_step(&mut self) -> Vec<BodyId> {
        ccd::enable_for_fast_bodies(self.ccd, &mut self.engine, &self.bodies, &mut self.counters);
        let riders = self.turning.lead(&mut self.engine, &self.bodies);
        self.engine.step();
        self.turning.put_back(&mut self.engine, &riders);
        self.steps += 1;
        self.counters.awake_body_steps += self.engine.islands.num_active_bodies() as u64;
        self.counters.pair_steps += self.engine.narrow_phase.contact_graph().raw_graph().raw_edges().len() as u64;
        (self.counters.contact_looks, self.counters.contact_skips) = (self.looks.looks(), self.looks.skips());
        let broken = self.remove_quarantined();
        let World { engine, bodies, counters, .. } = self;
        self.rolling.brake(engine, bodies, counters);
        resistance::brake(engine, bodies, counters);
        self.creep.prevent_sleep(engine, bodies, counters);
        self.bobbing.calm(engine, bodies, counters);
        if invariants::are_checked() {
            self.validate();
        }
        broken
    }

    /// Removes the bodies that the engine has set aside.
    fn remove_quarantined(&mut self) -> Vec<BodyId> {
        let broken = self.engine.quarantine().bodies().to_vec();
        let is_broken = |&id: &BodyId| broken.contains(&self.bodies[id].carrier);
        let ids: Vec<BodyId> = self.present().filter(is_broken).collect();
        ids.iter().for_each(|&id| self.remove(id));
        ids
    }

    /// A step of no time: brings the engine's spatial index and its contacts up to date with bodies that were added,
    /// moved or removed since the last step.
    pub fn zero_step(&mut self) {
        // The engine's own collision pass alone would consume the record of inserted bodies, which the next step would
        // then not move.
        let dt = std::mem::take(&mut self.engine.integration_parameters.dt);
        self.engine.step();
        // The engine (rapier 0.36.1) may leave such a step with its tree still set aside for optimization, and finds
        // nothing until the next step puts it back.
        if self.query().bvh.is_empty() {
            self.engine.step();
        }
        self.engine.integration_parameters.dt = dt;
    }

    /// Direction and strength of gravity; 1 downward in a new world.
    pub fn set_gravity(&mut self, gravity: DVec3) {
        self.engine.gravity = gravity.as_vec3();
        self.engine.wake_up_all(true);
    }

    /// From now on, the pile gets more substeps where it bobs.
    pub fn watch_bobbing(&mut self) {
        self.bobbing.is_watched = true;
    }
}
