//! Energy of all bodies.

use crate::world::World;

impl World {
    /// Kinetic energy of all free bodies.
    pub fn kinetic_energy(&self) -> f64 {
        let leaders = self.bodies.free().filter(|&(id, _)| self.bodies.leads(id));
        leaders.map(|(_, body)| self.engine.bodies[body.carrier].kinetic_energy() as f64).sum()
    }

    /// Kinetic and potential energy of all bodies; gravity is 1 downward.
    pub fn mechanical_energy(&self) -> f64 {
        let height = |id: usize| self.bodies[id].mass * self.pose(id).translation.y;
        self.kinetic_energy() + self.present().map(height).sum::<f64>()
    }
}
