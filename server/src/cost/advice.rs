//! Which preset a study speaks for.

use super::table::{Row, Study, short};
use super::{Kind, REFERENCE};

/// Nobody sees less: of a thickness; of the bodies, once the pile is let go; of the volume, where the reference's own seeds do not differ by
/// more.
const GOOD: [(&str, f64); 3] = [("overlap", 0.006), ("imbalance", 0.15), ("shape", 0.03)];

impl Study {
    /// What to choose for this scene, and why: the cheapest preset in which nobody sees an error; where there is none, the one that
    /// comes nearest.
    pub fn advice(&self) -> Option<String> {
        let presets = || self.rows.iter().filter(|row| row.kind == Kind::Preset);
        let spread = |name: &str| {
            let reference = presets().find(|row| row.variant == self.reference);
            reference.and_then(|row| row.errors.get(name)).map_or(0.0, |error| error.high)
        };
        let most = |name: &str, good: f64| if name == "shape" { spread(name).max(good) } else { good };
        let misses = |row: &&Row| GOOD.iter().filter(|(name, good)| error(row, name) > most(name, *good)).count();
        let chosen =
            presets().min_by(|a, b| misses(a).cmp(&misses(b)).then(a.cost.median.total_cmp(&b.cost.median)))?;
        let why = match misses(&chosen) {
            0 => "the cheapest in which nobody sees an error",
            _ => "no preset is without errors that can be seen, and this one has the fewest for its time",
        };
        let mut text =
            format!("Choose `{}`: {why}; it takes {} s of CPU time,", chosen.variant, short(chosen.cost.median));
        let told = [
            ("overlap", "props overlap by ", " of their thickness"),
            ("imbalance", "", " of them move once the pile is let go"),
            ("shape", "its shape is ", " of its volume from the reference's"),
        ];
        let parts = told.iter().filter_map(|(name, before, after)| {
            Some(format!("{before}{}%{after}", short(100.0 * chosen.errors.get(name)?.median)))
        });
        text += &format!(" {}.", parts.collect::<Vec<_>>().join(", "));
        let others =
            presets().filter(|row| row.variant != chosen.variant && [REFERENCE, "draft"].contains(&&*row.variant));
        for row in others {
            let (cost, overlap) =
                (row.cost.median / chosen.cost.median, error(row, "overlap") / error(chosen, "overlap"));
            if cost.is_finite() && overlap.is_finite() {
                text += &format!(
                    " `{}` takes {} times as long, and overlaps {} times as much.",
                    row.variant,
                    short(cost),
                    short(overlap)
                );
            }
        }
        Some(text)
    }
}

/// A figure that the scene does not have is no error.
fn error(row: &Row, name: &str) -> f64 {
    row.errors.get(name).map_or(0.0, |spread| spread.median)
}
