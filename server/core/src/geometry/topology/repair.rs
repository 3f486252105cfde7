//! The repairs that make a mesh face outward, and their description for a person.

use super::Flat;

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
        let counted = [
            (self.degenerate, "triangles with two equal corners were removed"),
            (self.flat.folded + self.flat.dropped, "triangles of no area were merged with those beside them"),
            (self.flat.left, "triangles of no area could not be taken away"),
            (self.duplicates, "triangles that were there twice were removed"),
            (self.turned, "triangles were turned to face the same way as those around them"),
            (self.inside_out, "parts were inside out and were turned"),
            (self.cavities, "parts are cavities in others"),
            (self.unorientable, "edges cannot be made consistent: the surface has one side only"),
        ];
        let mut sentences: Vec<String> =
            counted.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
        if self.cavities_not_sought {
            sentences.push("there are too many parts to look for cavities: all count as solids".to_owned());
        }
        sentences
    }
}
