//! The gentle end of the control: everything is damped for a while, then ever less, so that the pile creeps into its rest.

use super::policy::Policy;

/// Damping during the gentle end, per natural time: 50/s for a prop of 1 m, at which a pile creeps into its rest.
const DAMPING: f64 = 16.0;
/// The damping is whole for this long, natural times.
const WHOLE: f64 = 9.5;
/// Time over which it then fades out, natural times.
const RAMP: f64 = 3.2;

/// Whether the control is ending gently, and since when.
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

    /// Before the step of this number. `step_length`: natural times.
    pub fn before_step(&mut self, step: u64, step_length: f64, policy: &mut Policy) {
        let Some(begin) = self.begin else { return };
        self.steps += 1;
        let time = (step - begin) as f64 * step_length;
        let share = ((WHOLE + RAMP - time) / RAMP).clamp(0.0, 1.0);
        policy.set_gentle((share > 0.0).then_some(DAMPING * share));
        if share == 0.0 {
            self.begin = None;
        }
    }
}
