//! What the dots of a cluster carry while it moves or is hit: of all wrenches that balance its bodies, the smallest.
//!
//! A cluster is rigid, so that where its dots form rings their loads are not determined by statics alone; the least sum of squares
//! is that of dots that all yield alike.

use super::factor::{Factor, Mobility, Work};
use super::program::{Program, State};
use super::{GlueDot, GlueError, GlueOptions, GlueProblem, GlueTouch, MOST_ROUNDS};
use crate::equilibrium::global::GlobalBody;
use glam::DVec3;
use nalgebra::Vector6;

/// Iterations for one answer, and the residual that ends them.
const MOST: usize = 60;
const RESIDUAL: f64 = 1e-3;

/// The dots of a cluster, ready to be asked. Any consistent unit system, in the cluster's own frame.
pub struct Loads {
    bodies: Vec<GlobalBody>,
    dots: Vec<GlueTouch>,
    gravity: DVec3,
    factor: Factor,
    work: Work,
    multipliers: Vec<Vector6<f64>>,
}

impl Loads {
    /// `dots`: without contacts. `gravity`: only its length counts, as a unit.
    pub fn new(bodies: Vec<GlobalBody>, dots: Vec<GlueTouch>, gravity: DVec3) -> Result<Loads, GlueError> {
        let multipliers = vec![Vector6::zeros(); bodies.len()];
        let problem = GlueProblem { bodies: &bodies, contacts: &[], touches: &dots, gravity };
        let program = Program::new(&problem, &FREE, &vec![false; bodies.len()])?;
        let mobility = Mobility { contacts: vec![], dots: vec![1.0; dots.len()], missing: 0.0 };
        let factor = Factor::new(&program, &mobility);
        Ok(Loads { bodies, dots, gravity, factor, work: Work::default(), multipliers })
    }

    /// Loads of the dots that give each body this force and this moment about its centre. Shape `[dot]`.
    pub fn carry(&mut self, wanted: &[(DVec3, DVec3)]) -> Vec<GlueDot> {
        let problem = GlueProblem { bodies: &self.bodies, contacts: &[], touches: &self.dots, gravity: self.gravity };
        let Ok(program) = Program::new(&problem, &FREE, &vec![false; self.bodies.len()]) else { return Vec::new() };
        let unit = |(body, (force, moment)): (&GlobalBody, &(DVec3, DVec3))| {
            let weight = body.mass * self.gravity.length();
            let (f, m) = (*force / weight, *moment / (weight * body.radius));
            Vector6::new(f.x, f.y, f.z, m.x, m.y, m.z)
        };
        let target: Vec<Vector6<f64>> = self.bodies.iter().zip(wanted).map(unit).collect();
        self.factor.solve(&target, &mut self.multipliers, RESIDUAL, MOST, &mut self.work);
        let mut state: State = program.empty_state();
        program.velocities(&self.multipliers, &vec![true; self.dots.len()], |_, _| (), |t, v| state.dots[t] = v);
        (0..self.dots.len()).map(|touch| program.dot(touch, &state)).collect()
    }
}

/// Nothing but the dots counts.
const FREE: GlueOptions = GlueOptions { friction_factor: 1.0, normal_price: 0.0, strength: None, rounds: MOST_ROUNDS };
