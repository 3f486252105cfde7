//! Tall piles that bob. In each substep, the solver carries weight down a pile by about one layer. Where many regular
//! layers lie on each other, the part that arrives late pushes too hard: the pile hops forever, and walks. Substeps are
//! added while the pile bobs.

use super::WorldCounters;
use crate::world::REST_SPEED;
use crate::world::bodies::Bodies;
use cairn_input::params::MOST_SUBSTEPS;
use rapier3d::prelude::PhysicsWorld;

/// Up-and-down motion of the pile.
#[derive(Clone, Default)]
pub struct Bobbing {
    /// Bobbing is looked for at all.
    pub is_watched: bool,
    swing: Swing,
    /// Top speed of the swing before.
    before: f64,
    /// Swings in a row that did not fade.
    swings: u32,
}

/// From one change of direction to the next.
#[derive(Clone, Default)]
struct Swing {
    rises: bool,
    /// Engine time so far.
    time: f64,
    top_speed: f64,
}

/// Fewer bodies are no pile.
const LEAST_BODIES: usize = 20;
/// A bobbing swing reaches at least this share of the speed of the swing before: else the pile settles.
const LASTING: f64 = 0.8;
/// A bobbing swing is over within this time, characteristic times: else the pile falls.
const LONGEST: f64 = 1.0;
/// This many swings in a row are bobbing.
const SWINGS: u32 = 6;
/// The substeps are multiplied by this, up to [`MOST_SUBSTEPS`].
const FINER: usize = 2;

impl Bobbing {
    /// Records a step of this length with this mean upward speed. Returns whether the pile bobs.
    fn bobs(&mut self, speed: f64, length: f64) -> bool {
        self.swing.time += length;
        if (speed > 0.0) != self.swing.rises {
            let Swing { time, top_speed, .. } = self.swing;
            let lasts = top_speed > REST_SPEED && top_speed > LASTING * self.before && time < LONGEST;
            self.swings = if lasts { self.swings + 1 } else { 0 };
            self.before = top_speed;
            self.swing = Swing { rises: speed > 0.0, ..Swing::default() };
        }
        self.swing.top_speed = self.swing.top_speed.max(speed.abs());
        self.swings >= SWINGS
    }

    /// After a step: more substeps where the pile bobs.
    pub fn calm(&mut self, engine: &mut PhysicsWorld, bodies: &Bodies, counters: &mut WorldCounters) {
        if !self.is_watched {
            return;
        }
        let (mut mass, mut momentum, mut count) = (0.0, 0.0, 0);
        for (id, rigid) in bodies.moving(engine) {
            let carried = bodies.carried(id).mass;
            mass += carried;
            momentum += carried * f64::from(rigid.linvel().y);
            count += 1;
        }
        let speed = if count < LEAST_BODIES { 0.0 } else { momentum / mass };
        if !self.bobs(speed, f64::from(engine.integration_parameters.dt)) {
            return;
        }
        self.swings = 0;
        let substeps = &mut engine.integration_parameters.num_solver_iterations;
        if *substeps < MOST_SUBSTEPS as usize {
            *substeps = (*substeps * FINER).min(MOST_SUBSTEPS as usize);
            counters.calmed += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Bobbing;

    /// Steps until a pile that moves like this is found to bob.
    fn steps(speed: impl Fn(f64) -> f64) -> Option<usize> {
        let mut bobbing = Bobbing::default();
        (0..400).find(|&step| bobbing.bobs(speed(step as f64 * 0.05), 0.05))
    }

    #[test]
    fn only_a_pile_that_moves_up_and_down_forever_bobs() {
        let swings = |time: f64| (8.0 * time).sin();
        assert!(steps(|time| 0.1 * swings(time)).is_some_and(|step| step < 80));
        assert_eq!(steps(|time| 0.1 * swings(time) * (-time).exp()), None, "it settles");
        assert_eq!(steps(|time| 0.005 * swings(time)), None, "too slow to see");
        assert_eq!(steps(|time| 0.1 * (time).sin()), None, "a slow swing is no hop");
        assert_eq!(steps(|_| -1.0), None, "it falls");
    }
}
