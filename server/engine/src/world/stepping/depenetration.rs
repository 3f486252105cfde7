//! Depenetration: removes overlaps by moving bodies apart.

use crate::world::{BodyId, PairSide, World, bodies::stop, settings};
use cairn_input::params::Physics;
use glam::DVec3;

/// Share of the pairs in contact that may overlap by more than the residual.
const DEEPER: f64 = 0.05;
/// No pair may overlap by more than this many times the residual.
pub const DEEPEST: f64 = 8.0;
/// After so many steps in which the overlaps did not become smaller by [`GAIN`], what is left is locked in.
const STEPS_WITHOUT_GAIN: u64 = 16;
/// A share of the overlaps.
const GAIN: f64 = 0.05;

impl World {
    /// Moves overlapping bodies apart until 95 of 100 pairs in contact overlap by at most `residual` of the thinner
    /// one's thickness, until the overlaps become no smaller, or for as long as `going` allows after that many steps.
    /// Bodies have no weight and no friction, and keep no motion from one step to the next: only the contacts push,
    /// which makes each step a projection. Returns the steps.
    pub fn depenetrate<E>(&mut self, residual: f64, mut going: impl FnMut(u64) -> Result<bool, E>) -> Result<u64, E> {
        let bodies: Vec<BodyId> = self.present().collect();
        let before = self.engine.integration_parameters;
        let gravity = self.engine.gravity;
        settings::set_projection(&mut self.engine.integration_parameters);
        self.set_gravity(DVec3::ZERO);
        bodies.iter().for_each(|&id| self.set_slippery(id, true));
        self.zero_step();
        let mut steps = 0;
        let (mut least, mut least_at) = (f64::INFINITY, 0);
        let ended = loop {
            for &id in &bodies {
                self.engine.bodies.get_mut(self.bodies[id].carrier).into_iter().for_each(stop);
            }
            let excess = self.excess_over(residual);
            if excess < (1.0 - GAIN) * least {
                (least, least_at) = (excess, steps);
            }
            if excess <= 1.0 || steps - least_at > STEPS_WITHOUT_GAIN {
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

    /// From now on, steps are this long, characteristic times, and contacts as stiff as these.
    pub fn use_step_and_contacts_of(&mut self, step: f64, physics: &Physics, thickness: f64) {
        self.engine.integration_parameters.dt = step as f32;
        self.use_contacts_of(physics, thickness);
    }

    /// From now on, contacts are as stiff as these.
    pub fn use_contacts_of(&mut self, physics: &Physics, thickness: f64) {
        let parameters = &mut self.engine.integration_parameters;
        let step = f64::from(parameters.dt);
        settings::set_contacts(parameters, physics, thickness, step);
    }

    /// How many times deeper than allowed the pairs in contact overlap: 95 of 100 of them, or the deepest.
    fn excess_over(&self, residual: f64) -> f64 {
        let pairs = self.contact_pairs(0.0);
        let of_bodies = pairs.iter().filter(|pair| matches!(pair.b, PairSide::Body(_) | PairSide::Scenery));
        let mut depths: Vec<f64> = of_bodies.map(|pair| pair.depth() / self.pair_thickness(pair)).collect();
        depths.sort_by(f64::total_cmp);
        let Some(deepest) = depths.last() else { return 0.0 };
        let allowed = (DEEPER * depths.len() as f64) as usize;
        let usual = depths[depths.len() - 1 - allowed.min(depths.len() - 1)];
        usual.max(deepest / DEEPEST) / residual
    }
}
