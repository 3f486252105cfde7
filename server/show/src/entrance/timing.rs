//! When each body lands: spread over the duration, later where bodies would meet in the air.

use super::search::Arrival;
use super::sweep::{self, Flyer};
use cairn_engine::world::{BodyId, World};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// A body waits for so long, characteristic times, until another in the air is out of its way, so often at most.
const WAIT: f64 = 0.2;
const MOST_WAITS: usize = 60;

/// Times at which the bodies land, ascending; and by how much two of them cut each other in the air at most, in the
/// thickness of the thinner one. `start`: when the first one appears. Characteristic times.
pub fn landings(
    world: &World,
    bodies: &[(BodyId, Arrival)],
    start: f64,
    duration: f64,
    rng: &mut Pcg64Mcg,
) -> (Vec<f64>, f64) {
    let count = bodies.len();
    let flights: Vec<f64> = bodies.iter().map(|(_, arrival)| arrival.path.duration()).collect();
    let longest = flights.iter().copied().fold(0.0, f64::max);
    // The last one lands at the end; the others somewhere in their shares of the time.
    let slot = |k: usize, rng: &mut Pcg64Mcg| match k + 1 == count {
        true => duration,
        false => duration * (k as f64 + rng.random::<f64>()) / count as f64,
    };
    let mut landings: Vec<f64> = Vec::with_capacity(count);
    let mut deepest = 0.0f64;
    for (k, (id, arrival)) in bodies.iter().enumerate() {
        let wished = slot(k, rng).max(landings.last().copied().unwrap_or(0.0));
        let cut_at = |lands: f64| {
            let flyer = Flyer { id: *id, path: &arrival.path, lands };
            let others = landings.iter().zip(bodies).rev();
            // Nothing that began to fly before this is still in the air.
            let others = others.take_while(|(other, _)| **other + longest >= flyer.begins());
            let cuts = others.map(|(&lands, (id, arrival))| {
                sweep::meet(world, flyer, Flyer { id: *id, path: &arrival.path, lands })
            });
            cuts.fold(0.0, f64::max)
        };
        let waits = (0..MOST_WAITS).map(|wait| wished + WAIT * wait as f64);
        let tried = waits.map(|lands| (cut_at(lands), lands));
        let mut best: Option<(f64, f64)> = None;
        for (cut, lands) in tried {
            if best.is_none_or(|(least, _)| cut < least) {
                best = Some((cut, lands));
            }
            if cut <= sweep::ALLOWED {
                break;
            }
        }
        let (cut, lands) = best.unwrap_or((0.0, wished));
        deepest = deepest.max(cut);
        landings.push(lands);
    }
    // The first to appear does so at the start.
    let begins = landings.iter().zip(&flights).map(|(lands, flight)| lands - flight).fold(f64::INFINITY, f64::min);
    let shift = if begins.is_finite() { start - begins } else { 0.0 };
    landings.iter_mut().for_each(|lands| *lands += shift);
    (landings, deepest)
}
