//! Which preset a study speaks for.

use super::table::{Row, Study, short};
use super::{Kind, REFERENCE};

/// Nobody sees less: of a thickness; of the bodies, once the pile is let go; of the volume.
const GOOD: [(&str, f64); 3] = [("overlap", 0.006), ("imbalance", 0.15), ("shape", 0.03)];

impl Study {
    /// What to choose for this scene, and why: the cheapest preset in which nobody sees an error; where there is none, the one that
    /// comes nearest.
    pub fn advice(&self) -> Option<String> {
        let presets = || self.rows.iter().filter(|row| row.kind == Kind::Preset);
        let misses = |row: &&Row| GOOD.iter().filter(|(name, most)| error(row, name) > *most).count();
        let chosen =
            presets().min_by(|a, b| (misses(a), a.cost.median).partial_cmp(&(misses(b), b.cost.median)).unwrap())?;
        let why = match misses(&chosen) {
            0 => "the cheapest in which nobody sees an error",
            _ => "no preset is without errors that can be seen, and this one has the fewest for its time",
        };
        let mut text =
            format!("Choose `{}`: {why}; it takes {} s of CPU time,", chosen.variant, short(chosen.cost.median));
        let told = [
            ("overlap", "props overlap by", " of their thickness", 100.0, "%"),
            ("imbalance", "", " of them move once the pile is let go", 100.0, "%"),
            ("shape", "its shape is", " of its volume from the reference's", 100.0, "%"),
        ];
        let parts = told.iter().filter_map(|&(name, before, after, times, unit)| {
            let value = chosen.errors.get(name)?.median * times;
            Some(format!(
                "{}{}{unit}{after}",
                if before.is_empty() { String::new() } else { format!("{before} ") },
                short(value)
            ))
        });
        text += &format!(" {}.", parts.collect::<Vec<_>>().join(", "));
        let others =
            presets().filter(|row| row.variant != chosen.variant && [REFERENCE, "draft"].contains(&&*row.variant));
        for row in others {
            let (cost, overlap) =
                (row.cost.median / chosen.cost.median, error(row, "overlap") / error(&chosen, "overlap"));
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
