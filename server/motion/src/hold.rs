//! Hold: the control continues until the pile is at rest, or to the last frame.

use crate::pile::Pile;
use crate::step::Simulation;
use cairn_input::error::Error;
use cairn_input::observer::{Observer, Stage};
use cairn_input::params::{Params, Switch};

/// The pile is at rest once all of its bodies have been for this long, characteristic times.
const REST_TIME: f64 = 1.0;
/// In a large pile some bodies always rock. If at most this share of the bodies moves, the hold ends after
/// [`ROCKING_TIMES`] x [`REST_TIME`].
const ROCKING: f64 = 1e-4;
const ROCKING_TIMES: u64 = 3;

/// Initial resistance of the contacts of bodies that still roll or rattle late in the hold, as a share of the force
/// that presses them. It doubles every [`LATE_TIMES`] characteristic times while bodies still move, up to
/// [`MOST_LATE_RESISTANCE`]. It stops what touches something; what falls freely goes on to fall.
const LATE_RESISTANCE: f64 = 0.5;
const LATE_TIMES: f64 = 5.0;
const MOST_LATE_RESISTANCE: f64 = 4.0;
/// It sets in after this share of the patience, or once at most a share of [`ROLLING`] of the bodies has moved for
/// [`REST_TIME`]: the shape no longer changes.
const LATE_ONSET: f64 = 0.125;
const ROLLING: f64 = 1e-3;

/// How the hold ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoldOutcome {
    /// All bodies but a share of [`ROCKING`] came to rest; nothing moves after that.
    pub at_rest: bool,
    /// Bodies that moved in the last step.
    pub moving: usize,
    /// Largest speed of any body since all have been at rest, or in the last step if some moved; d per characteristic
    /// time.
    pub resting_speed_max: f64,
    /// `None` if the pile never came to rest.
    pub rest: Option<RestTime>,
}

/// When all bodies but a share of [`ROCKING`] were at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestTime {
    /// From the last release, drop or impact on.
    pub steps: u64,
    pub frame: usize,
}

/// Steps in a row in which at most a share of the bodies moved.
#[derive(Clone, Copy, Default)]
struct RestCounters {
    /// At most [`ROCKING`].
    few_rock: u64,
    /// At most [`ROLLING`].
    few_roll: u64,
    /// None.
    none_moves: u64,
}

impl RestCounters {
    fn step(&mut self, moving: usize, bodies: usize) {
        let at_most = |share: f64| moving as f64 <= share * bodies as f64;
        let counters = [(&mut self.none_moves, 0.0), (&mut self.few_rock, ROCKING), (&mut self.few_roll, ROLLING)];
        for (steps, share) in counters {
            *steps = if at_most(share) { *steps + 1 } else { 0 };
        }
    }

    /// The pile is at rest: no body moved in `least` steps, or few rocked in [`ROCKING_TIMES`] as many.
    fn is_over(&self, least: u64) -> bool {
        self.none_moves >= least || self.few_rock >= ROCKING_TIMES * least
    }

    /// Only few bodies still move.
    fn is_decided(&self, least: u64) -> bool {
        self.few_roll >= least && self.none_moves < self.few_roll
    }
}

/// Resistance of all contacts, `times` characteristic times after it has set in.
fn late_resistance(times: f64) -> f64 {
    let doublings = (times / LATE_TIMES) as i32;
    (LATE_RESISTANCE * 2f64.powi(doublings)).min(MOST_LATE_RESISTANCE)
}

/// Whether the control is withdrawn only once the pile rests, where it `stands` by itself in the end.
fn holds_first(params: &Params, stands: bool) -> bool {
    stands && params.control.until.is_none() && params.control.stand == Switch::On
}

/// Simulates until the pile is at rest, patience is over, or the last frame is there. A pile at rest is not simulated
/// any further: its bodies are certified or asleep, and each further cycle would find the same. `stands`: the
/// control is withdrawn once the pile rests, where the parameters ask for the figures of the held pile.
pub fn run(
    sim: &mut Simulation,
    params: &Params,
    stands: bool,
    observer: &mut dyn Observer,
) -> Result<HoldOutcome, Error> {
    until_rest(sim, params, stands, params.output.frames, observer)
}

/// The frames after that: as many as the parameters ask for.
pub fn finish(sim: &mut Simulation, params: &Params, observer: &mut dyn Observer) {
    sim.show(observer, Stage::Hold);
    sim.pile.recorder.mark();
    if let Some(n) = params.output.frames {
        sim.pile.recorder.fit(n as usize);
        sim.show(observer, Stage::Hold);
    }
    // An entrance has frames of its own, up to the pile as it rests.
    if params.output.trim && !sim.hides_frames {
        let first = sim.first_step();
        let Pile { recorder, world, latest_event, .. } = &mut sim.pile;
        recorder.trim(world, *latest_event - first);
    }
    sim.show_end(observer, Stage::Hold);
}

/// Simulates until the pile is at rest or patience is over, before frame 0.
pub fn settle(sim: &mut Simulation, params: &Params, stands: bool, observer: &mut dyn Observer) -> Result<(), Error> {
    until_rest(sim, params, stands, None, observer).map(|_| ())
}

/// The simulation of [`run`], to this frame at most.
fn until_rest(
    sim: &mut Simulation,
    params: &Params,
    stands: bool,
    last_frame: Option<u32>,
    observer: &mut dyn Observer,
) -> Result<HoldOutcome, Error> {
    let step = sim.pile.world.step_length();
    let patience = (params.hold.patience / step).ceil() as u64;
    let rest_steps = (REST_TIME / step).ceil() as u64;
    let least_steps = (params.hold.least_seconds / sim.pile.world.units.time / step).ceil() as u64;
    let mut begin = sim.pile.step;
    let (mut counters, mut top_speed) = (RestCounters::default(), 0.0f64);
    let (mut rest, mut rolls_since) = (None, None);
    let mut to_stand = holds_first(params, stands) && sim.pile.control.is_on();
    loop {
        let rests = counters.is_over(rest_steps) && sim.is_left_alone();
        if rests && to_stand {
            sim.pile.end_control(true);
            (to_stand, counters, rest) = (false, RestCounters::default(), None);
        } else if rests && sim.pile.step - begin >= least_steps {
            break;
        }
        let ended = match last_frame {
            Some(n) => sim.pile.recorder.count() >= n as usize,
            None => sim.is_left_alone() && sim.pile.step - begin >= patience.max(least_steps),
        };
        if ended {
            break;
        }
        if sim.pile.latest_event > begin {
            if rolls_since.take().is_some() {
                sim.pile.policy.set_quiet(0.0);
            }
            begin = sim.pile.latest_event;
        }
        let is_late = sim.pile.step - begin >= (LATE_ONSET * patience as f64) as u64;
        if is_late || counters.is_decided(rest_steps) && sim.is_left_alone() {
            rolls_since.get_or_insert(sim.pile.step);
        }
        if let Some(since) = rolls_since {
            sim.pile.policy.set_quiet(late_resistance((sim.pile.step - since) as f64 * step));
        }
        sim.advance(observer, Stage::Hold, |sim| ((sim.pile.step - begin) as f64 / patience as f64).min(0.99))?;
        counters.step(sim.moving, sim.pile.world.present().count());
        top_speed = if sim.moving == 0 { top_speed.max(sim.top_speed) } else { 0.0 };
        if counters.few_rock == 1 {
            let steps = (sim.pile.step - 1).saturating_sub(sim.pile.latest_event);
            rest = Some(RestTime { steps, frame: sim.pile.recorder.count() });
        } else if counters.few_rock == 0 {
            rest = None;
        }
    }
    let at_rest = counters.few_rock >= rest_steps;
    let resting_speed_max = top_speed.max(sim.top_speed);
    Ok(HoldOutcome { at_rest, moving: sim.moving, resting_speed_max, rest: rest.filter(|_| at_rest) })
}

#[cfg(test)]
mod tests {
    use super::{MOST_LATE_RESISTANCE, RestCounters, late_resistance};

    /// Steps until the pile is at rest. `moving`: bodies that move in each step; the last number repeats.
    fn steps(moving: &[usize], bodies: usize) -> Option<usize> {
        let mut counters = RestCounters::default();
        (0..1000).find(|&step| {
            counters.step(moving[step.min(moving.len() - 1)], bodies);
            counters.is_over(10)
        })
    }

    #[test]
    fn rocking_bodies_of_a_large_pile_are_not_waited_for_forever() {
        assert_eq!(steps(&[1, 1, 0], 9_999), Some(11), "ten steps after the last one came to rest");
        assert_eq!(steps(&[1], 9_999), None, "in a small pile none may rock");
        assert_eq!(steps(&[1, 0], 10_000), Some(10), "a body that comes to rest is waited for");
        assert_eq!(steps(&[100, 1], 10_000), Some(30), "one that rocks on is waited for three times as long");
        assert_eq!(steps(&[2], 10_000), None);
    }

    #[test]
    fn contacts_resist_more_and_more() {
        assert_eq!([0.0, 4.9, 5.0, 12.0].map(late_resistance), [0.5, 0.5, 1.0, 2.0]);
        assert_eq!(late_resistance(f64::from(u16::MAX)), MOST_LATE_RESISTANCE);
    }
}
