//! Figures of how the bodies come in, and warnings about it.

use super::inputs::NamedFigures;
use crate::input::params::Params;
use crate::stages::entrance::{Entrance, EntranceFigures};
use std::collections::BTreeMap;

/// Cuts beyond this share of a thickness are seen.
const SEEN: f64 = 0.02;

/// What the planned motion took.
pub fn figures(entrance: &Entrance) -> NamedFigures {
    let EntranceFigures { guided_impulse, held_impulse, cut_max, ballistic_error, energy_growth, seconds, .. } =
        entrance.figures;
    BTreeMap::from([
        ("entrance_guided_impulse", Some(guided_impulse)),
        ("entrance_held_impulse", Some(held_impulse)),
        ("entrance_cut_max_rel", Some(cut_max)),
        ("entrance_ballistic_error_max", Some(ballistic_error)),
        ("entrance_energy_growth_rel", Some(energy_growth)),
        ("entrance_seconds", Some(seconds)),
    ])
}

/// Warnings where the motion is guided by more than is allowed, or cuts.
pub fn warnings(entrance: &Entrance, params: &Params) -> Vec<String> {
    let EntranceFigures { guided_impulse, cut_max, .. } = entrance.figures;
    let (allowed, mut warnings) = (params.entrance.plausibility, Vec::new());
    if guided_impulse > allowed {
        warnings.push(format!(
            "the entrance is guided: no contact gave {:.1} % of the momentum brought in (entrance.plausibility allows \
             {:.1} %); use a smaller entrance.spread, another entrance.order or more glue, or allow more",
            100.0 * guided_impulse,
            100.0 * allowed
        ));
    }
    if cut_max > SEEN {
        warnings.push(format!(
            "bodies that come in cut others by up to {:.0} % of the thinner one's thickness: no free way was found for \
             them; use a larger entrance.spread or entrance.duration",
            100.0 * cut_max
        ));
    }
    warnings
}
