//! Figures of what a camera sees where bodies meet.

use super::inputs::{NamedFigures, ReportInputs};
use crate::sight::{SeenBodies, carried};
use cairn_engine::world::{ContactPair, PairSide, World};
use std::collections::{BTreeMap, BTreeSet};

/// Collision shapes touch up to this gap, in thicknesses of the thinner body.
const TOUCHING: f64 = 0.005;

/// The names of the figures.
const NAMES: [&str; 9] = [
    "foot_load",
    "hanging_visible",
    "visible_cut_share",
    "visible_depth_mean_rel",
    "visible_depth_p95_rel",
    "visible_depth_max_rel",
    "visible_gap_p95_rel",
    "visible_depth_p95",
    "visible_gap_p95",
];

/// All figures are null.
pub fn nothing() -> NamedFigures {
    NAMES.iter().map(|&name| (name, None)).collect()
}

/// The figures of the last frame, and the number of pairs of bodies behind them. `pairs`: at least those that touch.
pub fn figures(inputs: &ReportInputs, world: &World, pairs: &[ContactPair]) -> (NamedFigures, u64) {
    let frame = inputs.pile.frames.last().map_or(&[][..], Vec::as_slice);
    // By their place in the list of those that are still there.
    let present: Vec<usize> = world.present().filter(|&id| id < frame.len()).collect();
    let place: BTreeMap<usize, usize> = present.iter().enumerate().map(|(place, &id)| (id, place)).collect();
    let body = |&id: &usize| (inputs.pile.bodies[id].prop, inputs.pile.bodies[id].scale, frame[id]);
    let bodies: Vec<_> = present.iter().map(body).collect();
    let seen = SeenBodies::new(inputs.scene, inputs.shapes, bodies);
    let touching: BTreeSet<[usize; 2]> = pairs
        .iter()
        .filter(|pair| pair.points.iter().any(|p| p.gap <= TOUCHING * world.pair_thickness(pair)))
        .filter_map(|pair| match pair.b {
            PairSide::Body(b) => Some([*place.get(&pair.a)?, *place.get(&b)?]),
            _ => None,
        })
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    let all = inputs.params.accuracy.traits().looks_at_all;
    let sight = seen.sight();
    let found = sight.visible(&touching, all);
    let (carried, gap) = (carried(pairs, world), inputs.params.accuracy.traits().visible_contact);
    let ground = inputs.params.ground.then_some(inputs.ground);
    let stands = |i: usize| carried.contains(&present[i]) || seen.is_on_ground(&sight, i, gap, ground);
    let hanging = sight.hanging(gap, stands);
    let feet = (0..present.len()).filter(|&i| stands(i)).count();
    let values = [
        (feet > 0).then(|| present.len() as f64 / feet as f64),
        Some(hanging.len() as f64),
        Some(found.cut_share),
        Some(found.depth_mean),
        Some(found.depth_p95),
        Some(found.depth_max),
        found.gap_p95,
        Some(found.depth_p95_length),
        found.gap_p95_length,
    ];
    (NAMES.into_iter().zip(values).collect(), found.pairs)
}
