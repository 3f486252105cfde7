//! Which bodies may be removed, and an order in which all come apart.

use super::standing::Found;
use super::{Going, PileContacts};
use cairn_engine::world::BodyId;
use cairn_input::error::Error;
use cairn_statics::removal::{Outcome, Removals};
use std::ops::ControlFlow;

/// What becomes of the others without a body.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Removal {
    /// They are proven to stand.
    pub is_safe: bool,
    /// Neither that they stand nor that one falls is proven: take it for unsafe.
    pub is_open: bool,
    /// Bodies that begin to move, ascending: what rests on these goes too.
    pub moving: Vec<usize>,
}

impl Removal {
    fn of(outcome: &Outcome) -> Removal {
        Removal {
            is_safe: matches!(outcome, Outcome::Safe { .. }),
            is_open: *outcome == Outcome::Open,
            moving: if let Outcome::Falls { moving } = outcome { moving.clone() } else { Vec::new() },
        }
    }

    /// With the names of bodies in place of their numbers.
    pub fn named(self, ids: &[BodyId]) -> Removal {
        Removal { moving: self.moving.iter().map(|&k| ids[k]).collect(), ..self }
    }
}

/// The answers.
pub struct Apart {
    /// `None` for a body that falls as it is. Shape `[body]`.
    pub removals: Vec<Option<Removal>>,
    pub order: Vec<usize>,
    /// Ascending.
    pub stuck: Vec<usize>,
    pub programs: u64,
}

/// Looks at the removal of these bodies, in their order, and ends with the first that is safe where `until_safe`.
/// `None` for a body that falls as it is.
pub fn of_some(
    pile: &PileContacts,
    found: &Found,
    bodies: &[usize],
    until_safe: bool,
    going: &mut Going,
) -> Result<Vec<(usize, Option<Removal>)>, Error> {
    let internal = |error: cairn_statics::global::GlobalProblemError| Error::Internal(error.to_string());
    let mut removals = Removals::new(pile.problem(), found.forces.clone(), found.shares.clone());
    (0..pile.bodies.len()).filter(|&body| found.falls[body]).for_each(|body| removals.take(body, &[]));
    let mut answers = Vec::new();
    for (number, &body) in bodies.iter().enumerate() {
        let fraction = number as f64 / bodies.len() as f64;
        going.on(fraction)?;
        if found.falls[body] {
            answers.push((body, None));
            continue;
        }
        let removal = Removal::of(&removals.without(body, &mut || going.flow(fraction)).map_err(internal)?);
        let is_last = until_safe && removal.is_safe;
        answers.push((body, Some(removal)));
        if is_last {
            break;
        }
    }
    Ok(answers)
}

/// Looks at each removal, then takes bodies away from the top, one after another.
pub fn of(pile: &PileContacts, found: &Found, going: &mut Going) -> Result<Apart, Error> {
    let count = pile.bodies.len();
    let internal = |error: cairn_statics::global::GlobalProblemError| Error::Internal(error.to_string());
    let mut removals = Removals::new(pile.problem(), found.forces.clone(), found.shares.clone());
    // What falls is not there.
    (0..count).filter(|&body| found.falls[body]).for_each(|body| removals.take(body, &[]));
    // From the top, where most may go; where some are equally high, in their order.
    let mut left: Vec<usize> = (0..count).filter(|&body| !found.falls[body]).collect();
    let height = |body: usize| pile.bodies[body].center_of_mass.y;
    left.sort_by(|&a, &b| height(b).total_cmp(&height(a)).then(a.cmp(&b)));
    let mut answers = vec![None; count];
    for (number, &body) in left.iter().enumerate() {
        let fraction = 0.1 + 0.4 * number as f64 / count as f64;
        going.on(fraction)?;
        let outcome = removals.without(body, &mut || going.flow(fraction)).map_err(internal)?;
        answers[body] = Some(Removal::of(&outcome));
    }
    // Nothing near has gone since it was found that it cannot go.
    let is_safe = |removal: &Option<Removal>| removal.as_ref().is_some_and(|removal| removal.is_safe);
    let mut is_known: Vec<bool> = answers.iter().map(|removal| !is_safe(removal)).collect();
    let mut order = Vec::new();
    loop {
        let fraction = 0.5 + 0.3 * order.len() as f64 / count.max(1) as f64;
        let mut next = None;
        for (place, &body) in left.iter().enumerate() {
            if is_known[body] {
                continue;
            }
            going.on(fraction)?;
            let outcome = removals.without(body, &mut || going.flow(fraction)).map_err(internal)?;
            if let Outcome::Safe { forces } = outcome {
                next = Some((place, body, forces));
                break;
            }
            is_known[body] = true;
        }
        let Some((place, body, forces)) = next else { break };
        let near = removals.neighbours(body);
        for &neighbour in &near {
            is_known[neighbour] = false;
            removals.neighbours(neighbour).into_iter().for_each(|one| is_known[one] = false);
        }
        removals.take(body, &forces);
        left.remove(place);
        order.push(body);
    }
    left.sort_unstable();
    if going.flow(0.8) == ControlFlow::Break(()) {
        return Err(Error::Cancelled);
    }
    Ok(Apart { removals: answers, order, stuck: left, programs: removals.programs })
}
