//! The preset that a study recommends.

use super::table::{Study, StudyRow, short};
use super::{REFERENCE, VariantKind};

/// Largest invisible errors: overlap as a share of the thickness; share of bodies that move once the pile is released;
/// shape as a share of the volume, unless the reference's own seeds differ by more. With one seed of the reference, by
/// how much they do is not known, and the shape does not count.
const GOOD: [(&str, f64); 3] = [("overlap", 0.01), ("imbalance", 0.15), ("shape", 0.03)];

impl Study {
    /// The recommended preset and the reason: the cheapest one without visible errors, or else the one with the fewest.
    pub fn advice(&self) -> Option<String> {
        let presets = || self.rows.iter().filter(|row| row.kind == VariantKind::Preset);
        let spread = |name: &str| match presets().find(|row| row.variant == self.reference) {
            Some(reference) if reference.seeds.len() == 1 => f64::INFINITY,
            reference => reference.and_then(|row| row.errors.get(name)).map_or(0.0, |error| error.high),
        };
        let most = |name: &str, good: f64| if name == "shape" { spread(name).max(good) } else { good };
        let misses = |row: &&StudyRow| GOOD.iter().filter(|(name, good)| error(row, name) > most(name, *good)).count();
        let chosen =
            presets().min_by(|a, b| misses(a).cmp(&misses(b)).then(a.cost.median.total_cmp(&b.cost.median)))?;
        let why = match misses(&chosen) {
            0 => "the cheapest preset without visible errors",
            _ => "every preset has visible errors, and this one has the fewest for its time",
        };
        let mut text =
            format!("Choose `{}`: {why}; it takes {} s of CPU time,", chosen.variant, short(chosen.cost.median));
        let errors = [
            ("overlap", "props overlap by ", " of their thickness"),
            ("imbalance", "", " of them move once the pile is released"),
            ("shape", "its shape differs from the reference's by ", " of the volume"),
        ];
        let parts = errors.iter().filter_map(|(name, before, after)| {
            Some(format!("{before}{}%{after}", short(100.0 * chosen.errors.get(name)?.median)))
        });
        text += &format!(" {}.", parts.collect::<Vec<_>>().join(", "));
        let others =
            presets().filter(|row| row.variant != chosen.variant && [REFERENCE, "draft"].contains(&&*row.variant));
        for row in others {
            let (cost, overlap) =
                (row.cost.median / chosen.cost.median, error(row, "overlap") / error(chosen, "overlap"));
            if cost.is_finite() && overlap.is_finite() && self.is_ranked("overlap") {
                text += &format!(
                    " `{}` takes {} times as long, and overlaps {} times as much.",
                    row.variant,
                    short(cost),
                    short(overlap)
                );
            }
        }
        let unranked = self.unranked();
        if !unranked.is_empty() {
            let names = unranked.join(" and ");
            text += &format!(" There are too few seeds to rank the presets by {names}: raise --seeds.");
        }
        Some(text)
    }
}

/// The median error; 0 for a figure that the scene does not have.
fn error(row: &StudyRow, name: &str) -> f64 {
    row.errors.get(name).map_or(0.0, |spread| spread.median)
}
