//! Hold: the control goes on until the pile is at rest, or to the last frame.

use crate::error::Error;
use crate::input::observer::{Observer, Stage};
use crate::input::params::{Params, Switch};
use crate::sim::step::Simulation;

/// The pile is at rest once all bodies but this share have been for this long, natural times: in a large one, some always rock.
const REST_TIME: f64 = 1.0;
const RESTLESS: f64 = 1e-4;

/// Damping of what still rolls or rattles late in the hold, per natural time: most of its speed is gone after five natural times.
const ROLLING_DAMPING: f64 = 0.5;
/// It sets in after this share of the patience, when the shape is long decided.
const ROLLING_ONSET: f64 = 0.125;

/// How the hold ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoldOutcome {
    /// All bodies but [`RESTLESS`] of them came to rest; nothing moves after that.
    pub at_rest: bool,
    /// Largest speed of any body since the pile has been calm, or in the last step if it never was; d per natural time.
    pub resting_speed_max: f64,
    /// Steps from the last release, drop or impact until the pile was at rest, and the frame of that; `None` if it
    /// never was.
    pub rest: Option<Rest>,
}

/// When the pile came to rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    pub steps: u64,
    pub frame: usize,
}

/// Steps until rest, patience or the last frame ends it. A pile at rest is not simulated any further: its bodies are
/// certified or asleep, and each further cycle would find the same.
/// `stands`: once the pile rests, the control ends gently.
pub fn run(
    sim: &mut Simulation,
    params: &Params,
    stands: bool,
    observer: &mut dyn Observer,
) -> Result<HoldOutcome, Error> {
    let step = sim.pile.world.step_length();
    let patience = (params.hold.patience / step).ceil() as u64;
    let rest_steps = (REST_TIME / step).ceil() as u64;
    let least_steps = (params.hold.least / sim.pile.world.units.time / step).ceil() as u64;
    let mut begin = sim.pile.step;
    let (mut calm, mut top_speed) = (0, 0.0f64);
    let mut rest = None;
    let mut to_stand = stands && params.control.until.is_none() && sim.pile.control.is_on();
    loop {
        let rests = calm >= rest_steps && sim.is_left_alone();
        if rests && to_stand {
            match params.control.stand {
                Switch::On => sim.pile.end_control(true),
                Switch::Auto | Switch::Off => sim.pile.wean(),
            }
            (to_stand, calm, rest) = (false, 0, None);
        } else if rests && sim.pile.step - begin >= least_steps {
            break;
        }
        let ended = match params.output.frames {
            Some(n) => sim.pile.recorder.count() >= n as usize,
            None => sim.is_left_alone() && sim.pile.step - begin >= patience.max(least_steps),
        };
        if ended {
            break;
        }
        if sim.pile.latest_event > begin {
            if sim.pile.step - begin > (ROLLING_ONSET * patience as f64) as u64 {
                sim.pile.policy.set_quiet(None);
            }
            begin = sim.pile.latest_event;
        }
        if sim.pile.step - begin == (ROLLING_ONSET * patience as f64) as u64 {
            sim.pile.policy.set_quiet(Some(ROLLING_DAMPING));
        }
        sim.advance(observer, Stage::Hold, |sim| ((sim.pile.step - begin) as f64 / patience as f64).min(0.99))?;
        let is_calm = sim.restless <= RESTLESS;
        (calm, top_speed) = if is_calm { (calm + 1, top_speed.max(sim.top_speed)) } else { (0, 0.0) };
        if calm == 1 {
            let steps = (sim.pile.step - 1).saturating_sub(sim.pile.latest_event);
            rest = Some(Rest { steps, frame: sim.pile.recorder.count() });
        } else if calm == 0 {
            rest = None;
        }
    }
    let at_rest = calm >= rest_steps;
    sim.pile.recorder.mark();
    if let Some(n) = params.output.frames {
        sim.pile.recorder.fit(n as usize);
        sim.show(observer, Stage::Hold);
    }
    sim.show_end(observer, Stage::Hold);
    Ok(HoldOutcome { at_rest, resting_speed_max: top_speed.max(sim.top_speed), rest: rest.filter(|_| at_rest) })
}
