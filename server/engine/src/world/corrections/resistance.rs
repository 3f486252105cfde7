//! Resistance of contacts to what moves slowly over them: sliding creep, rolling, rocking and spinning.
//!
//! It acts at contacts only, and is bounded by the friction that they can bear: per body, it takes at most the share
//! [`Resistance::share`] of the friction coefficient times the impulse of its contacts from the momentum of sliding,
//! and the same, at a small lever, from the angular momentum. So it acts as more friction and as a moment in a contact
//! patch do: it brings to rest what rocks or creeps, and does not slow what falls. A body that touches nothing is
//! ballistic.

use super::WorldCounters;
use crate::world::{BodyId, Resistance, bodies::Bodies};
use rapier3d::prelude::*;

/// Half the width of a contact patch, as a share of the body's thickness: the lever of the moment that the patch can
/// carry. With half of it, columns of sticks keep 0.01 less of their shape; with 0.5, cards with too little friction
/// stand.
const PATCH: f64 = 0.2;

/// After a step: the resistance of the contacts, by the forces of that step.
pub fn brake(engine: &mut PhysicsWorld, bodies: &Bodies, counters: &mut WorldCounters) {
    for (id, body) in bodies.free().filter(|&(id, body)| body.resistance.share > 0.0 && bodies.leads(id)) {
        let rigid = &engine.bodies[body.carrier];
        if rigid.is_sleeping() {
            continue;
        }
        let Pressure { total, net, velocity, spin } = pressure(engine, bodies, id);
        if total <= 0.0 {
            continue;
        }
        let Resistance { share, in_world } = body.resistance;
        let (velocity, spin) = if in_world {
            (rigid.linvel(), rigid.angvel())
        } else {
            (rigid.linvel() - velocity, rigid.angvel() - spin)
        };
        let size = bodies.carried(id);
        let limit = (share * body.friction) as f32 * total;
        // Where all contacts push one way, motion along that way is a fall or a rise: only sliding is resisted.
        let along = net.normalize_or_zero();
        let sliding = velocity - along * (velocity.dot(along) * net.length() / total);
        let momentum = sliding.length() * size.mass as f32;
        let slowed = sliding * (limit / momentum.max(f32::MIN_POSITIVE)).min(1.0);
        let inertia = rigid.mass_properties().local_mprops.reconstruct_inertia_matrix();
        let angular_momentum = (inertia * (rigid.rotation().inverse() * spin)).length();
        let lever = (PATCH * size.thickness) as f32;
        let turned = spin * (limit * lever / angular_momentum.max(f32::MIN_POSITIVE)).min(1.0);
        counters.resisted_body_steps += 1;
        if let Some(rigid) = engine.bodies.get_mut(body.carrier).filter(|_| slowed.is_finite() && turned.is_finite()) {
            rigid.set_linvel(rigid.linvel() - slowed, false);
            rigid.set_angvel(rigid.angvel() - turned, false);
        }
    }
}

/// Contacts of a body in a step.
#[derive(Default)]
struct Pressure {
    /// Sum of the magnitudes of the impulses.
    total: f32,
    /// Sum of the impulses.
    net: Vector,
    /// Velocity of what touches the body, carried on to the body's center, and its angular velocity: means by impulse.
    velocity: Vector,
    spin: Vector,
}

fn pressure(engine: &PhysicsWorld, bodies: &Bodies, id: BodyId) -> Pressure {
    let mut pressure = Pressure::default();
    let center = engine.bodies[bodies[id].carrier].center_of_mass();
    for &member in bodies.glued_with(id) {
        let collider = bodies[member].collider;
        for pair in engine.narrow_phase.contact_pairs_with(collider) {
            let impulse = pair.total_impulse_magnitude();
            if impulse <= 0.0 {
                continue;
            }
            let (other, sign) = if pair.collider1 == collider { (pair.collider2, -1.0) } else { (pair.collider1, 1.0) };
            pressure.total += impulse;
            pressure.net += pair.total_impulse() * sign;
            let parent = engine.colliders.get(other).and_then(|other| other.parent());
            if let Some(other) = parent.and_then(|parent| engine.bodies.get(parent)) {
                pressure.velocity += other.velocity_at_point(center) * impulse;
                pressure.spin += other.angvel() * impulse;
            }
        }
    }
    if pressure.total > 0.0 {
        pressure.velocity /= pressure.total;
        pressure.spin /= pressure.total;
    }
    pressure
}
