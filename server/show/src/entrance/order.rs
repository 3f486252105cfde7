//! The order in which bodies come, found backward: from the finished pile, bodies leave one by one, each on a way that
//! is free, and without which no other falls. Where one falls all the same, it leaves next: it is held for a short
//! time.

use super::search::{Arrival, GOOD, Search};
use cairn_engine::world::BodyId;
use cairn_input::error::Error;
use cairn_statics::local::Analyser;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// So many of the next bodies are looked at before the best of them is taken, although something is wrong with it.
const LOOKED_AT: usize = 24;
/// Bodies looked at in one go. A constant: the same on any machine.
const AT_ONCE: usize = 4;
/// What a body that falls without the one that leaves counts, in shares of momentum; and a cut of a thickness.
const FALL: f64 = 1.0;
const CUT: f64 = 30.0;

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
    // Bodies that fall as soon as they are released, since what carries them has left.
    let mut fallen: BTreeSet<BodyId> = BTreeSet::new();
    let mut analyser = Analyser::new();
    let mut landed = Vec::with_capacity(count);
    while !left.is_empty() {
        going(landed.len() as f64 / count as f64)?;
        let (first, others): (Vec<BodyId>, Vec<BodyId>) = left.iter().partition(|id| fallen.contains(id));
        let window: Vec<BodyId> = first.into_iter().chain(others).take(LOOKED_AT).collect();
        let mut best: Option<(f64, BodyId)> = None;
        'window: for chunk in (0..window.len()).collect::<Vec<_>>().chunks(AT_ONCE) {
            let unknown: Vec<BodyId> = chunk.iter().map(|&k| window[k]).filter(|&id| known[id].is_none()).collect();
            let is_there = |id: BodyId| is_left[id];
            let found: Vec<Option<Arrival>> =
                unknown.par_iter().map(|&id| search.direct(id, &is_there, &mut Analyser::new())).collect();
            unknown.into_iter().zip(found).for_each(|(id, found)| known[id] = Some(found));
            for id in chunk.iter().map(|&k| window[k]) {
                let Some(Some(arrival)) = &known[id] else { continue };
                let falls = falling(search, id, &is_left, &fallen, &mut carried, &mut analyser);
                // What holds a body that has fallen is not spared by waiting.
                let guided = if fallen.contains(&id) { 0.0 } else { arrival.guided / arrival.momentum };
                let cut = if arrival.passage.is_clear() { 0.0 } else { arrival.passage.cut };
                if cut == 0.0 && guided <= GOOD && falls == 0.0 {
                    best = Some((0.0, id));
                    break 'window;
                }
                let price = CUT * cut + guided + FALL * falls;
                if best.is_none_or(|(least, _)| price < least) {
                    best = Some((price, id));
                }
            }
        }
        // A body at the height at which bodies appear has no way in.
        let Some((_, id)) = best else { break };
        left.retain(|&other| other != id);
        fallen.remove(&id);
        is_left[id] = false;
        let Some(Some(arrival)) = known[id].take() else { break };
        for other in search.supports.neighbours(id).into_iter().filter(|&other| is_left[other]) {
            carried[other] = None;
            if search.supports.falls(other, &|id| is_left[id], &mut analyser) > 0.0 {
                fallen.insert(other);
            }
            fallen.extend(search.supports.floating(other, &|id| is_left[id]));
            // A free way stays free; another one is needed where less stops the body.
            if let Some(Some(found)) = &mut known[other] {
                search.weighed(other, &|id| is_left[id], found, &mut analyser);
            }
            forget(&mut known[other], |_| true);
        }
        for &other in &left {
            forget(&mut known[other], |found| found.passage.blockers.binary_search(&id).is_ok());
        }
        landed.push((id, arrival));
    }
    landed.reverse();
    Ok(landed)
}

/// A way in that is not good is looked for again, where a better one may be there now.
fn forget(known: &mut Option<Option<Arrival>>, may_be_better: impl Fn(&Arrival) -> bool) {
    let Some(Some(found)) = known else { return };
    if !found.is_good() && may_be_better(found) {
        *known = None;
    }
}

/// What falls without this body, of what is carried now: shares of the bodies' weights, summed. `fallen`: those known
/// to fall already.
fn falling(
    search: &Search,
    without: BodyId,
    is_left: &[bool],
    fallen: &BTreeSet<BodyId>,
    carried: &mut [Option<bool>],
    analyser: &mut Analyser,
) -> f64 {
    let (mut falls, mut float) = (0.0, BTreeSet::new());
    let stands = |id: &BodyId| is_left[*id] && !fallen.contains(id);
    for other in search.supports.neighbours(without).into_iter().filter(stands) {
        let is_carried = match carried[other] {
            Some(known) => known,
            None => search.supports.falls(other, &|id| is_left[id], analyser) == 0.0,
        };
        carried[other] = Some(is_carried);
        let stays = |id: BodyId| is_left[id] && id != without;
        if is_carried && !float.contains(&other) {
            falls += search.supports.falls(other, &stays, analyser);
            float.extend(search.supports.floating(other, &stays));
        }
    }
    falls + float.len() as f64
}
