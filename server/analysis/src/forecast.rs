//! What becomes of a pile without one of its bodies: for bodies that are about to be taken away.

use super::apart::{self, Removal};
use super::{AnalysisOptions, Going, PileContacts, Touch, loads, own, standing};
use cairn_engine::world::{BodyId, World};
use cairn_input::error::Error;
use cairn_input::observer::Observer;

/// What is known before a body is taken away.
pub struct PileForecast {
    /// Each pair with its force.
    pub touches: Vec<Touch>,
    /// Of the bodies that were asked for, in their order; `None` for one that falls as it is.
    pub removals: Vec<(BodyId, Option<Removal>)>,
    /// Bodies that rest on each body, ascending. Shape `[body]`.
    pub rest_on: Vec<Vec<BodyId>>,
}

/// Looks at the removal of these bodies one by one, and ends with the first that is safe where `until_safe`.
pub fn forecast(
    world: &World,
    options: &AnalysisOptions,
    bodies: &[BodyId],
    until_safe: bool,
    observer: &mut dyn Observer,
) -> Result<PileForecast, Error> {
    let pile = PileContacts::new(world, options.gap);
    let mut going = Going { observer, bodies: pile.bodies.len(), last: 0.0 };
    let own = own::of(&pile, &mut going)?;
    let found = standing::of(&pile, &own, options.friction_share, &mut going)?;
    let index = |id: &BodyId| pile.ids.binary_search(id).ok();
    let asked: Vec<usize> = bodies.iter().filter_map(index).collect();
    let answers = apart::of_some(&pile, &found, &asked, until_safe, &mut going)?;
    let loads = loads::of(&pile, &found.forces);
    let mut rest_on = vec![Vec::new(); world.bodies().len()];
    for (k, &id) in pile.ids.iter().enumerate() {
        rest_on[id] = loads.rests_on(k).into_iter().map(|k| pile.ids[k]).collect();
    }
    Ok(PileForecast {
        touches: pile.touches(&found.forces),
        removals: answers.into_iter().map(|(k, one)| (pile.ids[k], one.map(|one| one.named(&pile.ids)))).collect(),
        rest_on,
    })
}
