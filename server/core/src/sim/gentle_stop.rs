//! The withdrawal of the control: it releases layer after layer, from the bottom to the top, while the contacts of all
//! bodies resist slow motion; then that resistance fades out, and the pile stands by itself as far as it can.

use super::control::PileControl;
use super::policy::Policy;
use crate::world::World;

/// Time over which the resistance fades out, characteristic times.
const FADE: f64 = 5.0;

/// The withdrawal of the control.
#[derive(Debug, Default)]
pub struct GentleStop {
    wave: Option<Wave>,
    /// Steps that it has taken so far.
    pub steps: u64,
}

/// From the bottom to the top of the pile.
#[derive(Clone, Copy, Debug)]
struct Wave {
    /// The step in which it began.
    begin: u64,
    /// Heights of the lowest and the highest center of mass, d.
    low: f64,
    high: f64,
    /// Rise of the wave, d per characteristic time.
    speed: f64,
    /// Resistance of all contacts.
    resistance: f64,
}

impl GentleStop {
    /// `speed` of the wave, d per characteristic time; `resistance` of all contacts while it rises.
    pub fn begin(&mut self, step: u64, world: &World, speed: f64, resistance: f64) {
        let heights = || world.present().map(|id| world.pose(id).translation.y);
        let (low, high) = (heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max));
        self.wave = (low <= high).then_some(Wave { begin: step, low, high, speed, resistance });
    }

    pub fn is_under_way(&self) -> bool {
        self.wave.is_some()
    }

    /// Before the step of this number.
    pub fn before_step(&mut self, step: u64, world: &mut World, policy: &mut Policy, control: &mut PileControl) {
        let Some(wave) = self.wave else { return };
        self.steps += 1;
        let time = (step - wave.begin) as f64 * world.step_length();
        let height = wave.low + wave.speed * time;
        if height <= wave.high {
            control.withdraw_below(height);
            policy.set_gentle(wave.resistance);
            return;
        }
        if control.is_on() {
            control.end(world, policy);
        }
        let faded = (time - (wave.high - wave.low) / wave.speed) / FADE;
        policy.set_gentle(wave.resistance * (1.0 - faded).max(0.0));
        if faded >= 1.0 {
            self.wave = None;
        }
    }
}
