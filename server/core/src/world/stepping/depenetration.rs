//! Depenetration: removes overlaps by moving bodies apart.

use crate::input::params::Physics;
use crate::world::{BodyId, PairSide, World, bodies::stop, settings};
use glam::DVec3;

/// Share of the pairs in contact that may overlap by more than the residual.
const DEEPER: f64 = 0.05;
/// No pair may overlap by more than this many times the residual.
const DEEPEST: f64 = 8.0;

impl World {
    /// Moves overlapping bodies apart until 95 of 100 pairs in contact overlap by at most `residual` of the thinner
    /// one's thickness, or for as long as `going` allows after that many steps. Bodies have no weight and no friction,
    /// and keep no motion from one step to the next: only the contacts push, which makes each step a projection.
    /// Returns the steps.
    pub fn depenetrate<E>(&mut self, residual: f64, mut going: impl FnMut(u64) -> Result<bool, E>) -> Result<u64, E> {
        let bodies: Vec<BodyId> = self.present().collect();
        let before = self.engine.integration_parameters;
        let gravity = self.engine.gravity;
        settings::set_projection(&mut self.engine.integration_parameters);
        self.set_gravity(DVec3::ZERO);
        bodies.iter().for_each(|&id| self.set_slippery(id, true));
        self.zero_step();
        let mut steps = 0;
        let ended = loop {
            for &id in &bodies {
                self.engine.bodies.get_mut(self.bodies[id].carrier).into_iter().for_each(stop);
            }
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

    /// From now on, contacts are as stiff as these.
    pub fn use_contacts_of(&mut self, physics: &Physics, thickness: f64) {
        let parameters = &mut self.engine.integration_parameters;
        let step = f64::from(parameters.dt);
        settings::set_contacts(parameters, physics, thickness, step);
    }

    fn overlaps_by_more_than(&self, residual: f64) -> bool {
        let pairs = self.contact_pairs(0.0);
        let of_bodies = pairs.iter().filter(|pair| matches!(pair.b, PairSide::Body(_) | PairSide::Scenery));
        let depths: Vec<f64> = of_bodies.map(|pair| pair.depth() / self.pair_thickness(pair)).collect();
        let deeper = depths.iter().filter(|&&depth| depth > residual).count();
        deeper as f64 > DEEPER * depths.len() as f64 || depths.iter().any(|&depth| depth > DEEPEST * residual)
    }
}
