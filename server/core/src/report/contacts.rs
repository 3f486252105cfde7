//! Figures of contacts: how deep bodies overlap, what hangs, and what the whole pile's contacts cannot carry.

use super::inputs::Figures;
use crate::geometry::contact::{self, Bearing};
use crate::measure::{self, Overlap};
use crate::sim::pile::REST_SPEED;
use crate::sim::whole::{REAL_CONTACT, Whole};
use crate::world::{BodyId, Touch, World};
use std::collections::BTreeMap;

/// A body is unsupported if its contacts leave more than this unbalanced, in its weight.
const UNBALANCED: f64 = 0.1;

/// Figures of all contacts of the end.
/// `forces`: also what the contacts of the whole pile cannot carry.
pub fn figures(world: &World, forces: bool) -> Figures {
    // `hanging` counts contacts up to d/200, which may be more than the thickness tolerance of thin props.
    let thinnest = world.present().map(|id| world.bodies()[id].thickness).fold(f64::INFINITY, f64::min);
    let touches = world.touches(REAL_CONTACT.max(contact::CARRYING_GAP / thinnest));
    let mut contacts: Vec<Bearing> = touches.iter().flat_map(|t| t.bearings(world)).collect();
    contacts.extend(world.glue_bearings());
    let is_movable = |id: BodyId| world.is_present(id) && !world.bodies()[id].role.stands();
    let at_rest: Vec<bool> =
        (0..world.bodies().len()).map(|id| is_movable(id) && world.speed(id) < REST_SPEED).collect();
    // Engine units: d is 1.
    let hanging = contact::hanging(&at_rest, &contacts, 1.0).len();
    let overlap = |t: &Touch| Overlap { depth: t.depth(), thickness: world.pair_thickness(t) };
    let penetration = measure::penetration(&touches.iter().map(overlap).collect::<Vec<_>>());
    let unsupported = if forces { unsupported(world) } else { None };
    BTreeMap::from([
        ("unsupported_fraction", unsupported),
        ("hanging", Some(hanging as f64)),
        ("penetration_max_rel", Some(penetration.max_rel)),
        ("penetration_mean_rel", Some(penetration.mean_rel)),
    ])
}

/// `unsupported_fraction`: share of the resting bodies that the best global distribution of contact forces found leaves
/// unbalanced by more than [`UNBALANCED`]. All contacts count, up to a gap of [`REAL_CONTACT`]. `None` where there is none.
fn unsupported(world: &World) -> Option<f64> {
    let whole = Whole::new(world, REAL_CONTACT);
    let missing = whole.missing(UNBALANCED).ok()?;
    let is_resting = |id: BodyId| world.speed(id) < REST_SPEED;
    let resting = whole.ids.iter().filter(|&&id| is_resting(id)).count();
    let unbalanced = |(&id, &e): (&BodyId, &f64)| is_resting(id) && e > UNBALANCED;
    let count = whole.ids.iter().zip(&missing).filter(|&pair| unbalanced(pair)).count();
    Some(count as f64 / resting.max(1) as f64)
}
