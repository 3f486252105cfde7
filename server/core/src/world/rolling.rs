//! Resistance to rolling and spinning. The engine has none: a ball on level ground would roll for ever.
//!
//! Real bodies dent what they roll on, and the force that carries them then attacks a little ahead of their middle: by a
//! share of the radius, which is the coefficient of rolling resistance. Its torque stops a ball on level ground, and keeps
//! it on a slope less steep than the coefficient.

use super::{BodyId, World};
use crate::input::params::{Physics, Switch};
use crate::prepare::shape::Shape;
use rapier3d::prelude::*;

/// What rolls.
#[derive(Default)]
pub struct Rolling {
    /// Share of the radius; 0: nothing is resisted.
    pub coefficient: f64,
    /// Bodies that are not round are resisted, too.
    pub of_all: bool,
    /// Bodies that are round, and the radius on which they roll.
    pub round: Vec<(BodyId, f64)>,
}

impl Rolling {
    pub fn new(physics: &Physics) -> Rolling {
        let off = physics.switches.rolling_resistance == Switch::Off;
        let coefficient = if off { 0.0 } else { physics.rolling_resistance };
        Rolling { coefficient, of_all: physics.switches.rolling_resistance == Switch::On, round: Vec::new() }
    }

    /// The radius on which a body of this shape rolls, m; `None` where nothing resists it.
    pub fn radius(&self, shape: &Shape) -> Option<f64> {
        let all = || self.of_all.then(|| shape.thickness() / 2.0);
        shape.size.round.or_else(all).filter(|_| self.coefficient > 0.0)
    }
}

impl World {
    /// After a step: the contacts' torque against rolling, by the forces of that step.
    pub(super) fn resist_rolling(&mut self) {
        for &(id, radius) in &self.rolling.round {
            if !self.is_awake(id) {
                continue;
            }
            let body = &self.bodies[id];
            let pairs = self.engine.narrow_phase.contact_pairs_with(body.collider);
            let pressed: f64 = pairs.map(|pair| f64::from(pair.total_impulse_magnitude())).sum();
            let rigid = &self.engine.bodies[body.handle];
            let spin = rigid.angvel();
            if pressed <= 0.0 || spin == Vector::ZERO {
                continue;
            }
            let inertia = rigid.mass_properties().local_mprops.reconstruct_inertia_matrix();
            let momentum = f64::from((inertia * (rigid.rotation().inverse() * spin)).length());
            self.counters.rolling_body_steps += 1;
            let braked = 1.0 - self.rolling.coefficient * radius * pressed / momentum;
            let handle = body.handle;
            if let Some(rigid) = self.engine.bodies.get_mut(handle).filter(|_| braked.is_finite()) {
                rigid.set_angvel(spin * braked.max(0.0) as f32, false);
            }
        }
    }
}
