//! The tilt, the shake and the friction at which the whole pile goes.

use super::horizon::Horizon;
use super::knock::{self, KnockOver};
use super::loads::Loads;
use super::own::{self, Own};
use super::part::Part;
use super::standing::Found;
use super::{AZIMUTHS, AnalysedBody, Going, PileContacts};
use cairn_input::error::Error;
use cairn_statics::limit;
use cairn_statics::local::margin::SLACK;
use glam::DVec3;

/// Tilts are sought up to this tangent: 84 degrees.
const MOST: f64 = own::MOST_PUSH;
/// Bounds on a tilt that are no farther apart need no more programs, degrees.
const NEAR: f64 = 0.5;
/// Where not one program can be afforded, loads in the four directions are tried without one, at these shares of the
/// least load that is known to bring the pile down, until it stands in all four.
const TRIALS: [f64; 3] = [0.8, 0.4, 0.2];
/// Halvings between shares of friction.
const HALVINGS: usize = 6;

/// A tilt of the ground in one direction, degrees. By quasi-statics, the ground may as well be accelerated the other
/// way by the tangent of the angle, in g.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct TiltLimit {
    /// The direction in which things slide, degrees from +Z toward +X.
    pub azimuth: f64,
    /// Forces balance it up to here.
    pub stands_to: f64,
    /// None do from here on.
    pub falls_from: f64,
}

/// The whole pile's margins.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct WholePile {
    /// Around the vertical.
    pub tilts: Vec<TiltLimit>,
    /// The least tilt of all directions, degrees: proven to stand up to the first, and to fall from the second.
    pub tilt: [f64; 2],
    /// The least horizontal acceleration of the ground at which it goes, g: the same, as a tangent.
    pub shake: [f64; 2],
    /// The direction of the least tilt, degrees from +Z toward +X.
    pub azimuth: f64,
    /// The bodies that go first there, ascending.
    pub goes_first: Vec<usize>,
    /// The body with the least margin of its own: the weakest point.
    pub weakest: Option<usize>,
    /// The share of friction with which it cannot stand, and that with which it stands.
    pub friction: [f64; 2],
    /// The least push at one body that brings it down; `None` where none was found.
    pub knock_over: Option<KnockOver>,
    /// Cone programs solved.
    pub programs: u64,
}

/// Looks for the limits of the bodies that stand.
pub fn of(
    pile: &PileContacts,
    found: &Found,
    own: &[Own],
    loads: &Loads,
    bodies: &[AnalysedBody],
    going: &mut Going,
) -> Result<WholePile, Error> {
    let part = Part::new(pile, &found.falls, |_| 1.0);
    let dead = limit::weights(&part.part_bodies, DVec3::NEG_Y);
    let most_programs = part.affordable().min(AZIMUTHS);
    let mut horizon = Horizon::new(MOST);
    // A body that moves even while its neighbours are held bounds the whole.
    for (k, most) in horizon.alone.iter_mut().enumerate() {
        let pushes = part.bodies.iter().filter_map(|&body| own[body].pushes.get(k));
        let pushes = pushes.map(|push| push * (1.0 + 2.0 * SLACK));
        *most = pushes.fold(MOST, f64::min);
    }
    let mut programs = 0;
    let mut asked = [false; AZIMUTHS];
    let (mut goes_first, mut least_found) = (Vec::new(), f64::INFINITY);
    while programs < most_programs {
        going.on(0.8 + 0.1 * programs as f64 / most_programs as f64)?;
        let Some(k) = widest(&horizon, &asked) else { break };
        asked[k] = true;
        programs += 1;
        let way = own::way(k).0;
        let live = limit::shake(&part.part_bodies, 1.0, way);
        let limit = part.limit(&dead, &live, horizon.alone[k])?;
        horizon.learn(k, &limit, |way| limit.work(&part.part_bodies, 1.0, &limit::shake(&part.part_bodies, 1.0, way)));
        if limit.falls_from.is_finite() && limit.falls_from < least_found {
            least_found = limit.falls_from;
            goes_first = limit.moving().map(|body| pile.ids[part.bodies[body]]).collect();
        }
    }
    if most_programs == 0 {
        try_all_ways(&part, &mut horizon, going)?;
    }
    let tilts: Vec<TiltLimit> = (0..AZIMUTHS)
        .map(|k| {
            let (least, most) = horizon.along(k);
            let azimuth = own::way(k).1;
            TiltLimit { azimuth, stands_to: libm::atan(least).to_degrees(), falls_from: libm::atan(most).to_degrees() }
        })
        .collect();
    let least = |tilt: fn(&TiltLimit) -> f64| tilts.iter().map(tilt).fold(90.0, f64::min);
    let tilt = [least(|tilt| tilt.stands_to), least(|tilt| tilt.falls_from)];
    if goes_first.is_empty() {
        // Of what moves even while its neighbours are held, that which moves at the least tilt.
        let least_of = |&&body: &&usize| own[body].push.map_or(MOST, |(push, _)| push);
        let first = part.bodies.iter().min_by(|a, b| least_of(a).total_cmp(&least_of(b)).then(a.cmp(b)));
        goes_first = first.into_iter().map(|&body| pile.ids[body]).collect();
    }
    let azimuth = tilts.iter().find(|one| one.falls_from <= tilt[1]).map_or(0.0, |one| one.azimuth);
    let margin = |&id: &usize| bodies[id].least_push.unwrap_or(f64::INFINITY);
    let standing = part.bodies.iter().map(|&body| pile.ids[body]);
    let weakest = standing.min_by(|a, b| margin(a).total_cmp(&margin(b)).then(a.cmp(b)));
    let (knock_over, pushed) = knock::of(pile, found, loads, going)?;
    let (friction, solved) = friction(pile, found, bodies, going)?;
    Ok(WholePile {
        tilt,
        shake: tilt.map(|degrees| libm::tan(degrees.to_radians())),
        tilts,
        azimuth,
        goes_first,
        weakest,
        friction,
        knock_over: knock_over.map(|knock| knock.named(&pile.ids)),
        programs: programs as u64 + solved + pushed,
    })
}

/// Looks for a load under which the part stands in all directions.
fn try_all_ways(part: &Part, horizon: &mut Horizon, going: &mut Going) -> Result<(), Error> {
    let least = horizon.alone.iter().copied().fold(MOST, f64::min);
    if libm::atan(least).to_degrees() <= NEAR {
        return Ok(());
    }
    for share in TRIALS {
        let mut stands = true;
        for k in (0..AZIMUTHS).step_by(AZIMUTHS / 4) {
            going.on(0.85)?;
            let loads = limit::shake(&part.part_bodies, 1.0, share * least * own::way(k).0);
            stands = part.balance(&loads, false, going)?.is_some();
            if !stands {
                break;
            }
            horizon.stands(k, share * least);
        }
        if stands {
            break;
        }
    }
    Ok(())
}

/// The direction in which the least is known, of those that were not asked yet; of equals, opposite ones first.
fn widest(horizon: &Horizon, asked: &[bool; AZIMUTHS]) -> Option<usize> {
    let degrees = |t: f64| libm::atan(t).to_degrees();
    let apart = |k: usize| {
        let (least, most) = horizon.along(k);
        degrees(most) - degrees(least)
    };
    let order = (0..AZIMUTHS).map(|k| (k * 5) % AZIMUTHS);
    let widest = order.filter(|&k| !asked[k]).map(|k| (apart(k), k));
    widest.reduce(|a, b| if b.0 > a.0 + 1e-9 { b } else { a }).filter(|(width, _)| *width > NEAR).map(|(_, k)| k)
}

/// The share of friction with which it cannot stand, and that with which it stands; and the programs solved.
fn friction(
    pile: &PileContacts,
    found: &Found,
    bodies: &[AnalysedBody],
    going: &mut Going,
) -> Result<([f64; 2], u64), Error> {
    // What a body needs even while its neighbours are held, the whole needs.
    let standing = (0..pile.ids.len()).filter(|&body| !found.falls[body]);
    let alone = standing.filter_map(|body| bodies[pile.ids[body]].least_friction).fold(0.0, f64::max);
    let used = found.shares.iter().copied().fold(0.0, f64::max);
    let (mut low, mut high) = ((alone - 0.5_f64.powi(10)).max(0.0), used.max(alone));
    let affordable = Part::new(pile, &found.falls, |_| 1.0).affordable();
    let most = (affordable / 2).clamp(1, HALVINGS);
    let mut programs = 0;
    // Most piles need no more than their neediest body does.
    let mut next = alone * 1.02 + 1e-3;
    while programs < most && high - low > 0.02 && next < high {
        going.on(0.9 + 0.1 * programs as f64 / most as f64)?;
        programs += 1;
        let part = Part::new(pile, &found.falls, |_| next);
        if part.balance(&part.no_load(), false, going)?.is_some() {
            high = next;
        } else if affordable == 0 {
            break;
        } else {
            let limit = part.bears()?;
            if limit.reaches(1.0) {
                high = next;
            } else if limit.falls_from < 1.0 {
                low = next;
            } else {
                break;
            }
        }
        next = (low + high) / 2.0;
    }
    Ok(([low, high], programs as u64))
}
