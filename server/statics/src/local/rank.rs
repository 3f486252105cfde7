//! Number of independent wrenches that the contacts can exert: 6 for a body held in every direction, less for
//! degenerate contact sets (five for two points, two and fewer without friction on parallel normals). A verdict needs
//! no full rank; but a stable body of lower rank is on the edge, since some disturbance, however small, finds no
//! answer.

use super::analyser::Analyser;
use super::scaled::{ScaledProblem, Vec6, dot, norm, subtract};
use super::{FrictionLaw, INDEPENDENT, LocalProblem, ProblemError};
use glam::DVec3;

impl Analyser {
    /// The dimension of the span of all wrenches that the contacts can exert, 0 to 6.
    pub fn rank(&mut self, problem: &LocalProblem) -> Result<usize, ProblemError> {
        self.scaled.set(problem, FrictionLaw::Cone)?;
        Ok(of(&self.scaled))
    }
}

/// Gram-Schmidt that takes the wrench farthest from the span so far, until none is far.
fn of(scaled: &ScaledProblem) -> usize {
    let mut q: [Vec6; 6] = [[0.0; 6]; 6];
    for rank in 0..6 {
        let mut farthest = [0.0; 6];
        for contact in scaled.contacts() {
            let tangents = if contact.mu > 0.0 { [contact.t1, contact.t2] } else { [DVec3::ZERO; 2] };
            for axis in [contact.n, tangents[0], tangents[1]] {
                let mut rest = contact.wrench(axis);
                for _ in 0..2 {
                    for q in &q[..rank] {
                        let along = dot(q, &rest);
                        subtract(&mut rest, along, q);
                    }
                }
                if norm(&rest) > norm(&farthest) {
                    farthest = rest;
                }
            }
        }
        let length = norm(&farthest);
        if length <= INDEPENDENT {
            return rank;
        }
        q[rank] = farthest.map(|k| k / length);
    }
    6
}
