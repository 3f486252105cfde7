//! Loads of the joints of a cluster that moves or is hit: of all wrenches that balance its bodies, the smallest.
//!
//! A cluster is rigid: where its joints form rings, statics alone does not determine their loads. The least sum of
//! squares is the load of joints that are all equally stiff.

use super::factor::{ACCURATE, Factor, Mobility, Workspace};
use super::program::{GlueForces, GlueProgram};
use super::{GlueError, GlueJoint, GlueProblem, GlueSite, UNBOUNDED};
use crate::global::GlobalBody;
use glam::DVec3;
use nalgebra::Vector6;

/// Bound on the iterations for one answer, which starts at the one before: it is computed in every step.
const MOST: usize = 60;

/// The joints of a cluster, with the factorised balance of its bodies. Any consistent unit system, in the cluster's own
/// frame.
pub struct Loads {
    bodies: Vec<GlobalBody>,
    joints: Vec<GlueSite>,
    gravity: DVec3,
    factor: Factor,
    work: Workspace,
    multipliers: Vec<Vector6<f64>>,
}

impl Loads {
    /// `joints`: sites without contacts. `gravity`: only its length counts, as a unit.
    pub fn new(bodies: Vec<GlobalBody>, joints: Vec<GlueSite>, gravity: DVec3) -> Result<Loads, GlueError> {
        let multipliers = vec![Vector6::zeros(); bodies.len()];
        let problem = GlueProblem { bodies: &bodies, contacts: &[], sites: &joints, gravity };
        let program = GlueProgram::new(&problem, &UNBOUNDED, &vec![false; bodies.len()])?;
        let mobility = Mobility { contacts: vec![], joints: vec![1.0; joints.len()], missing: 0.0 };
        let factor = Factor::new(&program, &mobility);
        Ok(Loads { bodies, joints, gravity, factor, work: Workspace::default(), multipliers })
    }

    /// Loads of the joints that give each body this force and this moment about its centre. Shape `[joint]`.
    pub fn carry(&mut self, wanted: &[(DVec3, DVec3)]) -> Vec<GlueJoint> {
        let problem = GlueProblem { bodies: &self.bodies, contacts: &[], sites: &self.joints, gravity: self.gravity };
        let Ok(program) = GlueProgram::new(&problem, &UNBOUNDED, &vec![false; self.bodies.len()]) else {
            return Vec::new();
        };
        let unit = |(body, (force, moment)): (&GlobalBody, &(DVec3, DVec3))| {
            let weight = body.mass * self.gravity.length();
            let (f, m) = (*force / weight, *moment / (weight * body.radius));
            Vector6::new(f.x, f.y, f.z, m.x, m.y, m.z)
        };
        let target: Vec<Vector6<f64>> = self.bodies.iter().zip(wanted).map(unit).collect();
        self.factor.solve(&target, &mut self.multipliers, ACCURATE, MOST, &mut self.work);
        let mut state: GlueForces = program.empty_state();
        program.velocities(&self.multipliers, &vec![true; self.joints.len()], |_, _| (), |t, v| state.joints[t] = v);
        (0..self.joints.len()).map(|site| program.joint(site, &state)).collect()
    }
}
