//! Tall piles that bob. In each substep, the solver carries weight down a pile by about one layer; where many regular layers lie on each
//! other, what arrives late pushes too much, and the pile hops for ever, and walks. More substeps calm it: how many it takes is
//! found by watching it.

use super::{Role, World};

/// How the pile goes up and down.
#[derive(Default)]
pub struct Bobbing {
    pub is_watched: bool,
    swing: Swing,
    /// Top speed of the swing before.
    before: f64,
    /// Swings in a row that did not ebb away.
    swings: u32,
}

/// From one change of direction to the next.
#[derive(Default)]
struct Swing {
    rises: bool,
    /// Engine time so far.
    time: f64,
    top_speed: f64,
}

/// Fewer bodies are no pile.
const LEAST_BODIES: usize = 20;
/// A swing's mean speed gets at least so high, d per natural time, and at least this share of the swing's before; and it is over in this
/// time, natural times: else the pile falls or settles.
const FAST: f64 = 0.01;
const LASTING: f64 = 0.8;
const LONGEST: f64 = 1.0;
/// So many swings in a row are bobbing.
const SWINGS: u32 = 6;
/// The substeps become so many times as many, up to [`MOST_SUBSTEPS`].
const FINER: usize = 2;
const MOST_SUBSTEPS: usize = 64;

impl Bobbing {
    /// A step of this length, with this mean upward speed. Whether the pile bobs.
    fn bobs(&mut self, speed: f64, length: f64) -> bool {
        self.swing.time += length;
        if (speed > 0.0) != self.swing.rises {
            let Swing { time, top_speed, .. } = self.swing;
            let lasts = top_speed > FAST && top_speed > LASTING * self.before && time < LONGEST;
            self.swings = if lasts { self.swings + 1 } else { 0 };
            self.before = top_speed;
            self.swing = Swing { rises: speed > 0.0, ..Swing::default() };
        }
        self.swing.top_speed = self.swing.top_speed.max(speed.abs());
        self.swings >= SWINGS
    }
}

impl World {
    /// From now on, the pile is given more substeps where it bobs.
    pub fn watch_bobbing(&mut self) {
        self.bobbing.is_watched = true;
    }

    /// After a step.
    pub(super) fn calm_bobbing(&mut self) {
        if !self.bobbing.is_watched {
            return;
        }
        let (mut mass, mut momentum, mut count) = (0.0, 0.0, 0);
        for (id, body) in self.bodies.iter().enumerate().filter(|(_, body)| body.role == Role::Free) {
            let rigid = &self.engine.bodies[body.handle];
            if !rigid.is_sleeping() && self.leads(id) {
                mass += self.carried(id).0;
                momentum += self.carried(id).0 * f64::from(rigid.linvel().y);
                count += 1;
            }
        }
        let speed = if count < LEAST_BODIES { 0.0 } else { momentum / mass };
        if !self.bobbing.bobs(speed, self.step_length()) {
            return;
        }
        self.bobbing.swings = 0;
        let substeps = &mut self.engine.integration_parameters.num_solver_iterations;
        if *substeps < MOST_SUBSTEPS {
            *substeps = (*substeps * FINER).min(MOST_SUBSTEPS);
            self.counters.calmed += 1;
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
    fn only_what_goes_up_and_down_without_end_bobs() {
        let swings = |time: f64| (8.0 * time).sin();
        assert!(steps(|time| 0.1 * swings(time)).is_some_and(|step| step < 80));
        assert_eq!(steps(|time| 0.1 * swings(time) * (-time).exp()), None, "it settles");
        assert_eq!(steps(|time| 0.005 * swings(time)), None, "nobody sees it");
        assert_eq!(steps(|time| 0.1 * (time).sin()), None, "a slow swing is no hop");
        assert_eq!(steps(|_| -1.0), None, "it falls");
    }
}
