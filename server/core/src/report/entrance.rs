//! Figures of how the bodies come in, and warnings about it.

use super::inputs::NamedFigures;
use cairn_input::params;
use cairn_show::entrance::{Entrance, EntranceFigures};
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

/// Warnings where the motion is guided by more than is asked for, or cuts.
pub fn warnings(found: &EntranceFigures, asked: &params::Entrance) -> Vec<String> {
    let allowed = if asked.kind == params::EntranceKind::Assemble { f64::INFINITY } else { asked.plausibility };
    let (guided, cut) = (100.0 * found.guided_impulse, 100.0 * found.cut_max);
    let mut warnings = Vec::new();
    if found.guided_impulse > allowed {
        let allowed = 100.0 * allowed;
        warnings.push(format!(
            "no contact gave {guided:.1} % of the momentum that the entrance brings in, and entrance.plausibility \
             allows {allowed:.1} %; use a smaller entrance.spread or another entrance.order, or allow more"
        ));
    }
    if found.cut_max > SEEN {
        warnings.push(format!(
            "bodies that come in cut others by up to {cut:.0} % of the thinner one's thickness: for some, no free way \
             was found; use a larger entrance.spread or entrance.duration"
        ));
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::says_only;
    use cairn_input::params::{Accuracy, Params};

    #[test]
    fn each_warning_about_an_entrance_has_its_cause() {
        let asked = Params::new(Accuracy::Standard).entrance;
        let free = EntranceFigures { guided_impulse: 0.01, cut_max: 0.01, ..EntranceFigures::default() };
        for (case, found, words) in [
            ("when all is well", free, &[] as &[&str]),
            (
                "when it is guided",
                EntranceFigures { guided_impulse: 0.051, ..free },
                &["no contact gave 5.1 % of the momentum that the entrance brings in, and entrance.plausibility \
                     allows 2.0 %; use a smaller entrance.spread or another entrance.order, or allow more"],
            ),
            (
                "when it cuts",
                EntranceFigures { cut_max: 0.3, ..free },
                &["bodies that come in cut others by up to 30 % of the thinner one's thickness: for some, no free \
                     way was found; use a larger entrance.spread or entrance.duration"],
            ),
        ] {
            says_only(case, &warnings(&found, &asked), words);
        }
    }
}
