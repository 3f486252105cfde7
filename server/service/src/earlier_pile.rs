//! Piles as earlier versions stored them, before bodies had numbers of their own.

use cairn_core::report::bake::{BakedBody, BakedGlue, BakedPile, BakedSolid, BakedWorld};
use cairn_geometry::pose::Pose;

/// A [`BakedPile`] of before. Its fields are in the order in which they were written.
#[derive(serde::Deserialize)]
pub struct EarlierPile {
    fps: f64,
    bodies: Vec<EarlierBody>,
    frames: Vec<Vec<Pose>>,
    scenery: Vec<Vec<Pose>>,
    glue: Option<BakedGlue>,
    solids: Vec<BakedSolid>,
    world: BakedWorld,
}

#[derive(serde::Deserialize)]
struct EarlierBody {
    prop: usize,
    scale: f64,
    first_frame: usize,
    mass_factor: f64,
    is_pinned: bool,
}

impl From<EarlierPile> for BakedPile {
    fn from(pile: EarlierPile) -> BakedPile {
        let EarlierPile { fps, bodies, frames, scenery, glue, solids, world } = pile;
        let body = |(number, body): (usize, EarlierBody)| {
            let EarlierBody { prop, scale, first_frame, mass_factor, is_pinned } = body;
            BakedBody { prop, number, scale, first_frame, mass_factor, is_pinned }
        };
        let bodies = bodies.into_iter().enumerate().map(body).collect();
        // How many of them were the fill's is not known: a later bake cannot begin from it.
        BakedPile { fps, bodies, filled: 0, frames, scenery, glue, solids, world }
    }
}
