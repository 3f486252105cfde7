//! Contact forces that balance a pile which has changed a little, from those before.

use super::admm::onto_cone;
use super::program::GlueProgram;
use super::{GlueError, GlueProblem, Going, UNBOUNDED, certificate};
use crate::limit::Load;
use glam::DVec3;
use nalgebra::Vector6;

/// Forces near `forces` that balance every body under its weight and a load, and what they leave: the sum over the
/// bodies, each relative to its weight. No joints. Shapes: `[body]`, `[contact]`.
pub fn rebalance(
    pile: &GlueProblem,
    loads: &[Load],
    forces: &[DVec3],
    going: &mut Going,
) -> Result<(Vec<DVec3>, f64), GlueError> {
    let mut program = GlueProgram::new(pile, &UNBOUNDED, &vec![false; pile.bodies.len()])?;
    let g = pile.gravity.length();
    for ((target, load), body) in program.target.iter_mut().zip(loads).zip(pile.bodies) {
        let Load { force, moment } = load.in_weights(body, g);
        *target -= Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z);
    }
    let mut state = program.state_of_contacts(forces);
    for (force, contact) in state.contacts.iter_mut().zip(&program.contacts) {
        *force = onto_cone(*force, 0.0, contact.friction);
    }
    let (state, imbalance) = certificate::correct(&program, state, &vec![false; pile.sites.len()], going)?;
    Ok((program.forces(&state), imbalance))
}
