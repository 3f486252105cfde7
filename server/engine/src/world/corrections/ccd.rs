//! Continuous collision: a fast body must neither pass through what it hits nor stop deep inside it.
//!
//! A body of one convex shape is swept along its path; the engine never sweeps two such bodies against each other, so
//! that not all bodies may be. Several parts that are swept one by one jam in what they touch already: their contacts
//! are found a step ahead instead (speculative contacts).

use super::WorldCounters;
use crate::world::bodies::Bodies;
use cairn_input::params::Switch;
use rapier3d::prelude::*;

/// A body is fast if it moves by more than this share of its thickness in a step.
const FAST: f64 = 0.5;
/// The same where the user has switched continuous collision on.
const CAREFULLY_FAST: f64 = 0.1;

/// Before a step: sets how the engine looks ahead for each free body.
pub fn enable_for_fast_bodies(
    switch: Switch,
    engine: &mut PhysicsWorld,
    bodies: &Bodies,
    counters: &mut WorldCounters,
) {
    let dt = engine.integration_parameters.dt;
    let share = match switch {
        Switch::Auto => FAST,
        Switch::On => CAREFULLY_FAST,
        Switch::Off => return,
    };
    for (id, body) in bodies.free().filter(|&(id, _)| bodies.leads(id)) {
        let rigid = &engine.bodies[body.carrier];
        let size = bodies.carried(id);
        let has_parts = body.cluster.is_some() || engine.colliders[body.collider].shape().as_compound().is_some();
        let turn = if has_parts { rigid.angvel().length() * size.radius as f32 } else { 0.0 };
        let path = (rigid.linvel().length() + turn) * dt;
        let is_fast = path > (share * size.thickness) as f32;
        let (is_swept, ahead) = (is_fast && !has_parts, if is_fast && has_parts { path } else { 0.0 });
        if is_fast && !rigid.is_sleeping() {
            counters.ccd_body_steps += u64::from(is_swept);
            counters.speculative_body_steps += u64::from(has_parts);
        }
        if (is_swept, ahead) != (rigid.is_ccd_enabled(), rigid.soft_ccd_prediction())
            && let Some(rigid) = engine.bodies.get_mut(body.carrier)
        {
            rigid.enable_ccd(is_swept);
            rigid.set_soft_ccd_prediction(ahead);
        }
    }
}
