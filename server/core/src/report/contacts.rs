//! Figures of contacts: how deep bodies overlap, which bodies hang, and which ones the contacts of the whole pile
//! cannot carry.

use super::inputs::NamedFigures;
use cairn_analysis::pile_equilibrium::PileEquilibrium;
use cairn_engine::world::{BodyId, ContactPair, PairSide, World};
use cairn_geometry::contact::{self, Bearing, REAL_CONTACT};
use cairn_geometry::measure::{self, Overlap};
use cairn_input::error::Error;
use cairn_motion::pile::REST_SPEED;
use cairn_statics::glue::GlueError;
use std::collections::BTreeMap;
use std::ops::ControlFlow;

/// A body is unsupported if its contacts leave more than this unbalanced, in its weight.
const UNBALANCED: f64 = 0.1;

/// The gap up to which [`figures`] need the contact pairs, in thicknesses of the thinner body. `hanging` counts
/// contacts up to d/200, which is more than [`REAL_CONTACT`] where props are thin.
pub fn widest_gap(world: &World) -> f64 {
    let thinnest = world.present().map(|id| world.bodies()[id].thickness).fold(f64::INFINITY, f64::min);
    REAL_CONTACT.max(contact::CARRYING_GAP / thinnest)
}

/// Figures of all contacts at the end. `pairs`: up to [`widest_gap`].
pub fn figures(world: &World, pairs: &[ContactPair]) -> NamedFigures {
    let mut contacts: Vec<Bearing> = pairs.iter().flat_map(|pair| pair.bearings(world)).collect();
    contacts.extend(world.glue_bearings());
    let is_movable = |id: BodyId| world.is_present(id) && !world.bodies()[id].role.stands();
    let at_rest: Vec<bool> =
        (0..world.bodies().len()).map(|id| is_movable(id) && world.speed(id) < REST_SPEED).collect();
    // Engine units: d is 1.
    let hanging = contact::hanging(&at_rest, &contacts, 1.0).len();
    let overlap = |pair: &ContactPair| Overlap { depth: pair.depth(), thickness: world.pair_thickness(pair) };
    let is_scenery = |pair: &&ContactPair| matches!(pair.b, PairSide::Scenery | PairSide::Moving);
    let (scenery, rest): (Vec<_>, Vec<_>) = pairs.iter().partition(is_scenery);
    let penetration =
        |pairs: &[&ContactPair]| measure::penetration(&pairs.iter().copied().map(overlap).collect::<Vec<_>>());
    let (penetration, scenery) = (penetration(&rest), penetration(&scenery));
    BTreeMap::from([
        ("scenery_penetration_max_rel", (scenery.pairs > 0).then_some(scenery.max_rel)),
        ("scenery_penetration_mean_rel", (scenery.pairs > 0).then_some(scenery.mean_rel)),
        ("hanging", Some(hanging as f64)),
        ("penetration_max_rel", Some(penetration.max_rel)),
        ("penetration_mean_rel", Some(penetration.mean_rel)),
        ("penetration_p95_rel", Some(penetration.p95_rel)),
    ])
}

/// Bodies that cut a piece of scenery.
pub struct Cut {
    /// Index among the scenery of its kind: what stands still, or what moves.
    pub piece: usize,
    pub moves: bool,
    pub bodies: usize,
    /// Of the deepest, engine units.
    pub depth: f64,
}

/// A body that reaches deeper into scenery than this, in its thickness, cuts it.
const CUTS: f64 = 0.1;

/// What is known of a body and of scenery that stands still, where contacts may not show it. Engine units.
#[derive(Default)]
pub struct InScenery {
    /// Depth in solid scenery: it may be so deep that it meets no surface.
    pub buried: f64,
    /// The piece that goes through its middle, as [`Cut::piece`], and how far the body reaches through it.
    pub pierced: Option<(usize, f64)>,
}

/// The bodies that cut scenery, piece by piece.
pub fn cuts(world: &World, of: impl Fn(BodyId) -> InScenery) -> Vec<Cut> {
    let mut cuts = BTreeMap::<(bool, usize), Cut>::new();
    for id in world.present() {
        let InScenery { buried, pierced } = of(id);
        let met = world.scenery_overlaps(id).into_iter();
        let mut depths: BTreeMap<(bool, usize), f64> = met.map(|(piece, depth)| (piece, depth.max(buried))).collect();
        if let Some((piece, depth)) = pierced {
            depths.entry((false, piece)).and_modify(|known| *known = known.max(depth)).or_insert(depth);
        }
        if depths.is_empty() {
            depths.insert((false, usize::MAX), buried);
        }
        let most = CUTS * world.bodies()[id].thickness;
        for ((moves, piece), depth) in depths.into_iter().filter(|(_, depth)| *depth > most) {
            let cut = cuts.entry((moves, piece)).or_insert(Cut { piece, moves, bodies: 0, depth: 0.0 });
            (cut.bodies, cut.depth) = (cut.bodies + 1, cut.depth.max(depth));
        }
    }
    cuts.into_values().collect()
}

/// Support of the whole pile by contacts alone.
#[derive(Default)]
pub struct PileSupport {
    /// `unsupported_fraction`: share of the resting bodies that the best global distribution of contact forces found
    /// leaves unbalanced by more than [`UNBALANCED`]. All contacts count, up to a gap of [`REAL_CONTACT`]. `None` where
    /// there is none.
    pub unsupported: Option<f64>,
    /// Those bodies, ascending.
    pub bodies: Vec<BodyId>,
    pub iterations: u64,
}

/// Looks for contact forces that balance the whole pile.
pub fn support(world: &World, going: &mut dyn FnMut() -> ControlFlow<()>) -> Result<PileSupport, Error> {
    let equilibrium = PileEquilibrium::new(world, REAL_CONTACT);
    let (missing, iterations) = match equilibrium.missing(UNBALANCED, going) {
        Ok(found) => found,
        Err(GlueError::Cancelled) => return Err(Error::Cancelled),
        Err(_) => return Ok(PileSupport::default()),
    };
    let is_resting = |id: BodyId| world.speed(id) < REST_SPEED;
    let ids = &equilibrium.assembly.ids;
    let resting = ids.iter().filter(|&&id| is_resting(id)).count();
    let unbalanced = |(&id, &e): (&BodyId, &f64)| is_resting(id) && e > UNBALANCED;
    let bodies: Vec<BodyId> = ids.iter().zip(&missing).filter(|&pair| unbalanced(pair)).map(|(&id, _)| id).collect();
    Ok(PileSupport { unsupported: Some(bodies.len() as f64 / resting.max(1) as f64), bodies, iterations })
}
