//! The least push at one body that brings a pile down, nothing being held.

use super::horizon::Horizon;
use super::loads::Loads;
use super::own;
use super::part::Part;
use super::standing::Found;
use super::{AZIMUTHS, Going, PileContacts};
use cairn_input::error::Error;
use cairn_statics::limit::{self, Limit, Load};
use glam::DVec3;
use std::collections::BTreeSet;

/// Larger pushes are not sought, in weights of the body.
const MOST: f64 = 50.0;
/// Programs, times the number of bodies to the power 1.5: the time is about the same for any pile. Of a large one only
/// the bodies that carry most are tried; where there would be fewer programs than the least, none.
const WORK: f64 = 15_000.0;
const LEAST_PROGRAMS: usize = 6;
/// The directions that are asked first.
const FIRST: [usize; 3] = [0, 5, 11];
/// A direction that may need no less than this share of the least push so far is not asked.
const NEAR: f64 = 0.95;
/// A push brings the pile down if this share of the bodies that stand comes down.
const DOWN: f64 = 0.5;

/// A horizontal push at the center of mass of a body.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct KnockOver {
    pub body: usize,
    /// Degrees from +Z toward +X.
    pub azimuth: f64,
    /// In the body's weight: the pile is proven to stand under the first, and to move under the second.
    pub push: [f64; 2],
    /// The second, N.
    pub force: f64,
    /// Bodies that begin to move, ascending.
    pub moving: Vec<usize>,
    /// Those, and all that rest on them, ascending.
    pub comes_down: Vec<usize>,
    /// Number of bodies at which pushes were tried.
    pub tried: usize,
}

/// Looks for the least push, by its force, that brings down at least half of what stands, or else the most; and the
/// number of programs solved. Indices are those of the pile.
pub fn of(
    pile: &PileContacts,
    found: &Found,
    loads: &Loads,
    going: &mut Going,
) -> Result<(Option<KnockOver>, u64), Error> {
    let part = Part::new(pile, &found.falls, |_| 1.0);
    let count = part.bodies.len();
    let dead = limit::weights(&part.part_bodies, DVec3::NEG_Y);
    let on: Vec<Vec<usize>> = part.bodies.iter().map(|&body| loads.rests_on(body)).collect();
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&a, &b| on[b].len().cmp(&on[a].len()).then(a.cmp(&b)));
    let bodies = count.max(1) as f64;
    let most = Some((WORK / (bodies * bodies.sqrt())) as usize).filter(|&most| most >= LEAST_PROGRAMS).unwrap_or(0);
    let (mut programs, mut tried) = (0, 0);
    let mut best: Option<KnockOver> = None;
    for &at in &order {
        if programs >= most {
            break;
        }
        tried += 1;
        let mut horizon = Horizon::new(MOST);
        let mut asked = [false; AZIMUTHS];
        let mut least: Option<(usize, Limit)> = None;
        while programs < most {
            going.on(0.85 + 0.05 * programs as f64 / most as f64)?;
            let known = least.as_ref().map_or(MOST, |(_, limit)| limit.falls_from);
            // First around, then where it may be least.
            let first = FIRST.into_iter().find(|&k| !asked[k]);
            let may_be = |k: usize| horizon.along(k).0;
            let lowest = || (0..AZIMUTHS).filter(|&k| !asked[k]).min_by(|&a, &b| may_be(a).total_cmp(&may_be(b)));
            let Some(k) = first.or_else(lowest) else { break };
            let is_little_less =
                asked.iter().filter(|asked| **asked).count() >= FIRST.len() && may_be(k) >= NEAR * known;
            if is_little_less {
                break;
            }
            asked[k] = true;
            programs += 1;
            let limit = part.limit(&dead, &push(&part, at, own::way(k).0), horizon.along(k).1)?;
            horizon.learn(k, &limit, |way| limit.work(&part.part_bodies, 1.0, &push(&part, at, way)));
            if limit.falls_from < known {
                least = Some((k, limit));
            }
        }
        let Some((k, limit)) = least else { continue };
        let body = part.bodies[at];
        let moving: Vec<usize> = limit.moving().map(|body| part.bodies[body]).collect();
        let down: BTreeSet<usize> =
            moving.iter().copied().chain(moving.iter().flat_map(|&body| loads.rests_on(body))).collect();
        let found = KnockOver {
            body,
            azimuth: own::way(k).1,
            push: [limit.stands_to.unwrap_or(0.0).min(limit.falls_from), limit.falls_from],
            force: pile.newton(limit.falls_from * pile.bodies[body].mass),
            moving,
            comes_down: down.into_iter().collect(),
            tried: 0,
        };
        // As many as make half of the pile count alike.
        let enough = (DOWN * count as f64).ceil() as usize;
        let rank = |knock: &KnockOver| knock.comes_down.len().min(enough);
        let is_better = best.as_ref().is_none_or(|best| {
            rank(&found) > rank(best) || rank(&found) == rank(best) && found.force < best.force * (1.0 - 1e-9)
        });
        if is_better {
            best = Some(found);
        }
    }
    Ok((best.map(|best| KnockOver { tried, ..best }), programs as u64))
}

/// A push of the weight of one body, by its number in the part.
fn push(part: &Part, at: usize, way: DVec3) -> Vec<Load> {
    let mut loads = vec![Load::default(); part.part_bodies.len()];
    loads[at].force = part.part_bodies[at].mass * way;
    loads
}

impl KnockOver {
    /// With the names of bodies in place of their numbers.
    pub fn named(self, ids: &[usize]) -> KnockOver {
        let of = |list: Vec<usize>| list.into_iter().map(|k| ids[k]).collect();
        KnockOver { body: ids[self.body], moving: of(self.moving), comes_down: of(self.comes_down), ..self }
    }
}
