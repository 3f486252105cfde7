//! The gentle end of the control: all bodies are damped for a while, then less and less, so that the pile creeps to
//! rest.

use super::policy::Policy;

/// Damping during the gentle end, per characteristic time: 50/s for a prop of 1 m, at which a pile creeps to rest.
const DAMPING: f64 = 16.0;
/// The damping is full for this long, characteristic times.
const FULL: f64 = 9.5;
/// Time over which it then fades out, characteristic times.
const RAMP: f64 = 3.2;

/// State of the gentle end of the control.
#[derive(Debug, Default)]
pub struct GentleStop {
    /// The step in which it began.
    begin: Option<u64>,
    /// Steps damped so far.
    pub steps: u64,
}

impl GentleStop {
    pub fn begin(&mut self, step: u64) {
        self.begin = Some(step);
    }

    pub fn is_under_way(&self) -> bool {
        self.begin.is_some()
    }

    /// Before the step of this number. `step_length`: characteristic times.
    pub fn before_step(&mut self, step: u64, step_length: f64, policy: &mut Policy) {
        let Some(begin) = self.begin else { return };
        self.steps += 1;
        let time = (step - begin) as f64 * step_length;
        let share = ((FULL + RAMP - time) / RAMP).clamp(0.0, 1.0);
        policy.set_gentle((share > 0.0).then_some(DAMPING * share));
        if share == 0.0 {
            self.begin = None;
        }
    }
}
