//! The order in which bodies come, found backward: from the finished pile, bodies leave one by one, each on a way that
//! is free, and without which no other falls.

use super::search::{Arrival, Search};
use crate::error::Error;
use crate::world::BodyId;
use cairn_statics::local::Analyser;
use rayon::prelude::*;

/// So many of the next bodies are looked at before the best of them is taken, although something is wrong with it.
const LOOKED_AT: usize = 24;
/// Bodies looked at in one go. A constant: the same on any machine.
const AT_ONCE: usize = 4;
/// What a body that falls without the one that leaves counts, in shares of momentum; and a cut of a thickness.
const FALL: f64 = 0.5;
const CUT: f64 = 10.0;

/// The bodies in the order in which they land, each with its way in. `wishes`: a number for each body that comes: they
/// should land in the order of these. `going`: called with the share that is done.
pub fn plan(
    search: &Search,
    wishes: &[(f64, BodyId)],
    going: &mut dyn FnMut(f64) -> Result<(), Error>,
) -> Result<Vec<(BodyId, Arrival)>, Error> {
    // The last to land leaves first.
    let mut wishes = wishes.to_vec();
    wishes.sort_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
    let mut left: Vec<BodyId> = wishes.into_iter().map(|(_, id)| id).collect();
    let count = left.len();
    let bodies = search.world.bodies().len();
    let mut is_left = vec![false; bodies];
    left.iter().for_each(|&id| is_left[id] = true);
    let mut known: Vec<Option<Option<Arrival>>> = vec![None; bodies];
    let mut carried: Vec<Option<bool>> = vec![None; bodies];
    let mut analyser = Analyser::new();
    let mut landed = Vec::with_capacity(count);
    while !left.is_empty() {
        going(landed.len() as f64 / count as f64)?;
        let window = &left[..left.len().min(LOOKED_AT)];
        let mut best: Option<(f64, usize)> = None;
        'window: for chunk in (0..window.len()).collect::<Vec<_>>().chunks(AT_ONCE) {
            let unknown: Vec<BodyId> = chunk.iter().map(|&k| window[k]).filter(|&id| known[id].is_none()).collect();
            let is_there = |id: BodyId| is_left[id];
            let found: Vec<Option<Arrival>> =
                unknown.par_iter().map(|&id| search.direct(id, &is_there, &mut Analyser::new())).collect();
            unknown.into_iter().zip(found).for_each(|(id, found)| known[id] = Some(found));
            for &place in chunk {
                let id = window[place];
                let Some(Some(arrival)) = &known[id] else { continue };
                let falls = falling(search, id, &is_left, &mut carried, &mut analyser);
                if arrival.is_good() && falls == 0 {
                    best = Some((0.0, place));
                    break 'window;
                }
                let cut = if arrival.passage.is_clear() { 0.0 } else { arrival.passage.cut };
                let price = CUT * cut + arrival.guided / arrival.momentum + FALL * falls as f64;
                if best.is_none_or(|(least, _)| price < least) {
                    best = Some((price, place));
                }
            }
        }
        // A body at the height at which bodies appear has no way in.
        let Some((_, place)) = best else { break };
        let id = left.remove(place);
        is_left[id] = false;
        let Some(Some(arrival)) = known[id].take() else { break };
        for other in search.supports.neighbours(id).into_iter().filter(|&other| is_left[other]) {
            carried[other] = None;
            // A free way stays free; another one is needed where less stops the body.
            if let Some(Some(found)) = &mut known[other] {
                search.weighed(other, &|id| is_left[id], found, &mut analyser);
            }
            if !known[other].as_ref().is_some_and(|found| found.as_ref().is_some_and(Arrival::is_good)) {
                known[other] = None;
            }
        }
        for &other in &left {
            let is_blocked =
                |found: &Option<Arrival>| found.as_ref().is_some_and(|f| f.passage.blockers.binary_search(&id).is_ok());
            let is_good = known[other].as_ref().is_some_and(|found| found.as_ref().is_some_and(Arrival::is_good));
            if !is_good && known[other].as_ref().is_some_and(is_blocked) {
                known[other] = None;
            }
        }
        landed.push((id, arrival));
    }
    landed.reverse();
    Ok(landed)
}

/// The number of bodies that are carried now, and fall without this one.
fn falling(
    search: &Search,
    without: BodyId,
    is_left: &[bool],
    carried: &mut [Option<bool>],
    analyser: &mut Analyser,
) -> usize {
    let mut falls = 0;
    for other in search.supports.neighbours(without).into_iter().filter(|&other| is_left[other]) {
        let is_carried = match carried[other] {
            Some(known) => known,
            None => search.supports.falls(other, &|id| is_left[id], analyser) == 0.0,
        };
        carried[other] = Some(is_carried);
        let stays = |id: BodyId| is_left[id] && id != without;
        falls += usize::from(is_carried && search.supports.falls(other, &stays, analyser) > 0.0);
    }
    falls
}
