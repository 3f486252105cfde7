//! The repairs that make a mesh face outward, and their description for a person.

use super::Flat;
use crate::counted;

/// The repairs of [`super::oriented`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Repair {
    /// Triangles with two equal corners, removed.
    pub degenerate: usize,
    /// Second copies of triangles, removed.
    pub duplicates: usize,
    /// The treatment of triangles of no area.
    pub flat: Flat,
    /// Triangles turned to face the same way as those around them.
    pub turned: usize,
    /// Parts that were inside out as a whole, and now face outward.
    pub inside_out: usize,
    /// Parts that are cavities in others: these face inward.
    pub cavities: usize,
    /// Edges that no turning makes consistent: the surface has one side only, as a Moebius strip.
    pub unorientable: usize,
    /// There were too many parts to look for cavities.
    pub cavities_not_sought: bool,
}

impl Repair {
    /// One sentence for each thing that was done or could not be done; nothing for a clean mesh.
    pub fn describe(&self) -> Vec<String> {
        const TRIANGLES: [&str; 2] = ["triangle", "triangles"];
        const PARTS: [&str; 2] = ["part", "parts"];
        let found = [
            (self.degenerate, TRIANGLES, "removed, because two corners are equal"),
            (self.flat.folded + self.flat.dropped, TRIANGLES, "of no area merged with those beside them"),
            (self.flat.left, TRIANGLES, "of no area left, which could not be taken away"),
            (self.duplicates, TRIANGLES, "removed, because they were there twice"),
            (self.turned, TRIANGLES, "turned to face the same way as those around them"),
            (self.inside_out, PARTS, "turned, because they were inside out"),
            (self.cavities, PARTS, "found to be a cavity in others"),
            (self.unorientable, ["edge", "edges"], "left inconsistent: the surface has one side only"),
        ];
        let sentence = |(n, what, fate): &(usize, [&str; 2], &str)| format!("{} {fate}", counted(*n, what[0], what[1]));
        let mut sentences: Vec<String> = found.iter().filter(|(n, ..)| *n > 0).map(sentence).collect();
        if self.cavities_not_sought {
            sentences.push("there are too many parts to look for cavities: all count as solids".to_owned());
        }
        sentences
    }
}
