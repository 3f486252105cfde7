//! Resistance of contacts to what moves slowly over them: sliding creep, rolling, rocking and spinning.
//!
//! It acts at contacts only, and is bounded by the force that presses them: per body, it takes at most the share
//! `resistance` of the impulse of its contacts from the momentum of sliding, and the same, at a small lever, from the
//! angular momentum. So it acts as more friction and as a moment in a contact patch do: it brings to rest what rocks or
//! creeps, and does not slow what falls. A body that touches nothing is ballistic.

use super::WorldCounters;
use crate::world::bodies::Bodies;
use rapier3d::prelude::*;

/// Half the width of a contact patch, as a share of the body's thickness: the lever of the moment that the patch can
/// carry. With a tenth of it, sticks roll on; with ten times as much, a cube that is pushed over an edge tips too late.
const PATCH: f64 = 0.05;

/// After a step: the resistance of the contacts, by the forces of that step.
pub fn brake(engine: &mut PhysicsWorld, bodies: &Bodies, counters: &mut WorldCounters) {
    for (id, body) in bodies.free().filter(|&(id, body)| body.resistance > 0.0 && bodies.leads(id)) {
        let rigid = &engine.bodies[body.carrier];
        let (velocity, spin) = (rigid.linvel(), rigid.angvel());
        if rigid.is_sleeping() || velocity == Vector::ZERO && spin == Vector::ZERO {
            continue;
        }
        let Pressure { total, net } = pressure(engine, bodies, bodies.glued_with(id));
        if total <= 0.0 {
            continue;
        }
        let size = bodies.carried(id);
        let limit = (body.resistance * total) as f32;
        // Where all contacts push one way, motion along that way is a fall or a rise: only sliding is resisted.
        let along = net.normalize_or_zero();
        let sliding = velocity - along * (velocity.dot(along) * net.length() / total as f32);
        let momentum = sliding.length() * size.mass as f32;
        let kept = velocity - sliding * (limit / momentum.max(f32::MIN_POSITIVE)).min(1.0);
        let inertia = rigid.mass_properties().local_mprops.reconstruct_inertia_matrix();
        let angular_momentum = (inertia * (rigid.rotation().inverse() * spin)).length();
        let lever = (PATCH * size.thickness) as f32;
        let kept_spin = spin * (1.0 - limit * lever / angular_momentum.max(f32::MIN_POSITIVE)).max(0.0);
        counters.resisted_body_steps += 1;
        if let Some(rigid) = engine.bodies.get_mut(body.carrier).filter(|_| kept.is_finite() && kept_spin.is_finite()) {
            rigid.set_linvel(kept, false);
            rigid.set_angvel(kept_spin, false);
        }
    }
}

/// Impulses of the contacts of a body in a step: the sum of their magnitudes, and their sum.
struct Pressure {
    total: f64,
    net: Vector,
}

fn pressure(engine: &PhysicsWorld, bodies: &Bodies, members: &[usize]) -> Pressure {
    let mut pressure = Pressure { total: 0.0, net: Vector::ZERO };
    for &id in members {
        let collider = bodies[id].collider;
        for pair in engine.narrow_phase.contact_pairs_with(collider) {
            let sign = if pair.collider1 == collider { -1.0 } else { 1.0 };
            pressure.total += f64::from(pair.total_impulse_magnitude());
            pressure.net += pair.total_impulse() * sign;
        }
    }
    pressure
}
