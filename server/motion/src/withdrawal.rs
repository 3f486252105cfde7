//! The withdrawal of the control: it releases layer after layer, from the bottom to the top.

use super::control::PileControl;
use super::policy::Policy;
use cairn_engine::world::World;

/// The withdrawal of the control.
#[derive(Debug, Default)]
pub struct Withdrawal {
    wave: Option<Wave>,
    /// Steps that it has taken so far.
    pub steps: u64,
}

/// From the bottom to the top of the pile.
#[derive(Clone, Copy, Debug)]
struct Wave {
    /// The step in which it begins.
    begin: u64,
    /// Heights of the lowest and the highest center of mass, d.
    low: f64,
    high: f64,
    /// Rise of the wave, d per characteristic time.
    speed: f64,
}

impl Withdrawal {
    /// The wave begins in this step, at this speed, d per characteristic time.
    pub fn begin(&mut self, step: u64, world: &World, speed: f64) {
        let heights = || world.present().map(|id| world.pose(id).translation.y);
        let (low, high) = (heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max));
        self.wave = (low <= high).then_some(Wave { begin: step, low, high, speed });
    }

    pub fn is_under_way(&self) -> bool {
        self.wave.is_some()
    }

    /// Before the step of this number.
    pub fn before_step(&mut self, step: u64, world: &mut World, policy: &mut Policy, control: &mut PileControl) {
        let Some(wave) = self.wave.filter(|wave| step >= wave.begin) else { return };
        self.steps += 1;
        let height = wave.low + wave.speed * (step - wave.begin) as f64 * world.step_length();
        control.withdraw_below(height);
        if height > wave.high {
            control.end(world, policy);
            self.wave = None;
        }
    }
}
