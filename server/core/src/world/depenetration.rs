//! Depenetration: what overlaps is parted by position.

use super::{BodyId, PairSide, World};
use glam::DVec3;
use rapier3d::prelude::*;

/// Contact springs so stiff and so damped that about half of an overlap goes in a step.
const FREQUENCY: f64 = 60.0;
const DAMPING_RATIO: f64 = 10.0;
/// With fewer, bodies between others are pushed too far.
const SUBSTEPS: usize = 4;
/// Natural times.
const STEP: f64 = 0.05;
/// The share of the touching pairs that may overlap by more.
const DEEPER: f64 = 0.05;
/// But none by more than so many times as much.
const DEEPEST: f64 = 8.0;

impl World {
    /// Parts what overlaps until 95 of 100 touching pairs of bodies do so by at most `residual` of the thinner one's thickness, or
    /// for as long as `going` says after so many steps. Nothing has weight, nothing rubs, and no body keeps its motion from one step to the
    /// next: only the contacts push, which makes each step a projection. Returns the steps.
    pub fn depenetrate<E>(&mut self, residual: f64, mut going: impl FnMut(u64) -> Result<bool, E>) -> Result<u64, E> {
        let bodies: Vec<BodyId> = self.present().collect();
        let before = self.engine.integration_parameters;
        let gravity = self.engine.gravity;
        let softness = SpringCoefficients { natural_frequency: FREQUENCY as f32, damping_ratio: DAMPING_RATIO as f32 };
        let p = &mut self.engine.integration_parameters;
        p.contact_softness = softness;
        p.static_contact_softness = softness;
        p.num_solver_iterations = SUBSTEPS;
        p.dt = STEP as f32;
        self.set_gravity(DVec3::ZERO);
        bodies.iter().for_each(|&id| self.set_slippery(id, true));
        self.zero_step();
        let mut steps = 0;
        let ended = loop {
            bodies.iter().for_each(|&id| self.stop(id));
            if !self.overlaps_by_more_than(residual) {
                break Ok(());
            }
            match going(steps) {
                Ok(true) => {}
                Ok(false) => break Ok(()),
                Err(error) => break Err(error),
            }
            self.step();
            steps += 1;
        };
        let present: Vec<BodyId> = self.present().collect();
        present.into_iter().for_each(|id| self.set_slippery(id, false));
        self.engine.integration_parameters = before;
        self.set_gravity(gravity.as_dvec3());
        ended.map(|()| steps)
    }

    /// Takes a body's motion.
    fn stop(&mut self, id: BodyId) {
        if let Some(body) = self.engine.bodies.get_mut(self.bodies[id].handle) {
            body.set_linvel(Vector::ZERO, false);
            body.set_angvel(Vector::ZERO, false);
        }
    }

    fn overlaps_by_more_than(&self, residual: f64) -> bool {
        let touches = self.contact_pairs(0.0);
        let pairs = touches.iter().filter(|touch| matches!(touch.b, PairSide::Body(_)));
        let depths: Vec<f64> = pairs.map(|touch| touch.depth() / self.pair_thickness(touch)).collect();
        let deeper = depths.iter().filter(|&&depth| depth > residual).count();
        deeper as f64 > DEEPER * depths.len() as f64 || depths.iter().any(|&depth| depth > DEEPEST * residual)
    }
}
