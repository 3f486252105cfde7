//! Resistance to rolling and spinning. The engine has none: a ball on level ground would roll forever.
//!
//! Real bodies dent the surface on which they roll, and the force that carries them then acts a little ahead of their
//! center: by a share of the radius, which is the coefficient of rolling resistance. Its torque stops a ball on level
//! ground, and keeps it on a slope less steep than the coefficient.

use super::WorldCounters;
use crate::shape::Shape;
use crate::world::{BodyId, bodies::Bodies};
use cairn_input::params::{Physics, Switch};
use rapier3d::prelude::*;

/// The bodies that resist rolling.
#[derive(Clone, Default)]
pub struct Rolling {
    /// Share of the radius; 0: nothing is resisted.
    coefficient: f64,
    /// Bodies that are not round are resisted, too.
    of_all: bool,
    /// Each with the radius on which it rolls, engine units.
    bodies: Vec<(BodyId, f64)>,
}

impl Rolling {
    pub fn new(physics: &Physics) -> Rolling {
        let off = physics.switches.rolling_resistance == Switch::Off;
        let coefficient = if off { 0.0 } else { physics.rolling_resistance };
        Rolling { coefficient, of_all: physics.switches.rolling_resistance == Switch::On, bodies: Vec::new() }
    }

    /// A body comes in, `size` engine units for each meter of its shape.
    pub fn join(&mut self, id: BodyId, shape: &Shape, size: f64) {
        let all = || self.of_all.then(|| shape.thickness() / 2.0);
        let radius = shape.size.round.or_else(all).filter(|_| self.coefficient > 0.0);
        self.bodies.extend(radius.map(|radius| (id, radius * size)));
    }

    /// Nothing resists rolling from now on.
    pub fn end(&mut self) {
        self.bodies.clear();
    }

    /// After a step: the contacts' torque against rolling, by the forces of that step.
    pub fn brake(&self, engine: &mut PhysicsWorld, bodies: &Bodies, counters: &mut WorldCounters) {
        for &(id, radius) in &self.bodies {
            if !bodies.is_awake(engine, id) {
                continue;
            }
            let body = &bodies[id];
            let pairs = engine.narrow_phase.contact_pairs_with(body.collider);
            let pressed: f64 = pairs.map(|pair| f64::from(pair.total_impulse_magnitude())).sum();
            let rigid = &engine.bodies[body.carrier];
            let spin = rigid.angvel();
            if pressed <= 0.0 || spin == Vector::ZERO {
                continue;
            }
            let inertia = rigid.mass_properties().local_mprops.reconstruct_inertia_matrix();
            let momentum = f64::from((inertia * (rigid.rotation().inverse() * spin)).length());
            counters.rolling_body_steps += 1;
            let braked = 1.0 - self.coefficient * radius * pressed / momentum;
            if let Some(rigid) = engine.bodies.get_mut(body.carrier).filter(|_| braked.is_finite()) {
                rigid.set_angvel(spin * braked.max(0.0) as f32, false);
            }
        }
    }
}
