//! Figures of contacts: how deep bodies overlap, what hangs, and what the whole pile's contacts cannot carry.

use super::inputs::Figures;
use cairn_statics::glue::GlueError;
use crate::error::Error;
use crate::geometry::contact::{self, Bearing};
use crate::measure::{self, Overlap};
use crate::sim::pile::REST_SPEED;
use crate::sim::whole::{REAL_CONTACT, Whole};
use crate::world::{BodyId, ContactPair, World};
use std::collections::BTreeMap;
use std::ops::ControlFlow;

/// A body is unsupported if its contacts leave more than this unbalanced, in its weight.
const UNBALANCED: f64 = 0.1;

/// Figures of all contacts of the end.
pub fn figures(world: &World) -> Figures {
    // `hanging` counts contacts up to d/200, which may be more than the thickness tolerance of thin props.
    let thinnest = world.present().map(|id| world.bodies()[id].thickness).fold(f64::INFINITY, f64::min);
    let touches = world.contact_pairs(REAL_CONTACT.max(contact::CARRYING_GAP / thinnest));
    let mut contacts: Vec<Bearing> = touches.iter().flat_map(|t| t.bearings(world)).collect();
    contacts.extend(world.glue_bearings());
    let is_movable = |id: BodyId| world.is_present(id) && !world.bodies()[id].role.stands();
    let at_rest: Vec<bool> =
        (0..world.bodies().len()).map(|id| is_movable(id) && world.speed(id) < REST_SPEED).collect();
    // Engine units: d is 1.
    let hanging = contact::hanging(&at_rest, &contacts, 1.0).len();
    let overlap = |t: &ContactPair| Overlap { depth: t.depth(), thickness: world.pair_thickness(t) };
    let penetration = measure::penetration(&touches.iter().map(overlap).collect::<Vec<_>>());
    BTreeMap::from([
        ("hanging", Some(hanging as f64)),
        ("penetration_max_rel", Some(penetration.max_rel)),
        ("penetration_mean_rel", Some(penetration.mean_rel)),
        ("penetration_p95_rel", Some(penetration.p95_rel)),
    ])
}

/// What the contacts of the whole pile can carry.
#[derive(Default)]
pub struct Support {
    /// `unsupported_fraction`: share of the resting bodies that the best global distribution of contact forces found leaves
    /// unbalanced by more than [`UNBALANCED`]. All contacts count, up to a gap of [`REAL_CONTACT`]. `None` where there is none.
    pub unsupported: Option<f64>,
    /// Those bodies, rising.
    pub bodies: Vec<BodyId>,
    pub iterations: u64,
}

/// Weighs the whole pile.
pub fn support(world: &World, going: &mut dyn FnMut() -> ControlFlow<()>) -> Result<Support, Error> {
    let whole = Whole::new(world, REAL_CONTACT);
    let (missing, iterations) = match whole.missing(UNBALANCED, going) {
        Ok(found) => found,
        Err(GlueError::Cancelled) => return Err(Error::Cancelled),
        Err(_) => return Ok(Support::default()),
    };
    let is_resting = |id: BodyId| world.speed(id) < REST_SPEED;
    let resting = whole.ids.iter().filter(|&&id| is_resting(id)).count();
    let unbalanced = |(&id, &e): (&BodyId, &f64)| is_resting(id) && e > UNBALANCED;
    let bodies: Vec<BodyId> =
        whole.ids.iter().zip(&missing).filter(|&pair| unbalanced(pair)).map(|(&id, _)| id).collect();
    Ok(Support { unsupported: Some(bodies.len() as f64 / resting.max(1) as f64), bodies, iterations })
}
