//! The hard cases, one row each: what builds it, what passing means, and what was measured. Tests run the rows;
//! `tests/studies/hard_cases.rs` prints them as a table.
#![allow(dead_code, reason = "the tests and the example use different parts")]

pub mod edges;
pub mod energy;
pub mod engines;
pub mod gltf;
pub mod hits;
pub mod inputs;
pub mod piles;
pub mod places;
pub mod scenes;
pub mod stacks;
pub mod starts;

use engines::Engine::{self, Cairn, Plain, Uncontrolled};

/// How large a case is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// As the tests run it.
    Short,
    /// As the row says.
    Full,
}

/// What a case came to.
pub struct Outcome {
    /// The figures that decide.
    pub summary: String,
    pub passed: bool,
}

/// Of several parts: all must pass.
pub fn all(parts: impl IntoIterator<Item = (String, bool)>) -> Outcome {
    let (summary, passed): (Vec<String>, Vec<bool>) = parts.into_iter().unzip();
    Outcome { summary: summary.join("; "), passed: passed.into_iter().all(|p| p) }
}

pub struct Row {
    pub name: &'static str,
    pub passes_when: &'static str,
    pub run: fn(Engine, Extent) -> Outcome,
    /// What must pass.
    pub judged: &'static [Engine],
    /// What can run it.
    pub shown: &'static [Engine],
    /// Where it is not passed, and why: listed, and judged to fail.
    pub misses: &'static [Miss],
}

/// A row that one engine misses at one size.
pub struct Miss {
    pub engine: Engine,
    pub extent: Extent,
    pub why: &'static str,
}

impl Row {
    /// Why this engine misses the row at this size, if it does.
    pub fn miss(&self, engine: Engine, extent: Extent) -> Option<&'static str> {
        self.misses.iter().find(|miss| miss.engine == engine && miss.extent == extent).map(|miss| miss.why)
    }

    const fn missed(self, misses: &'static [Miss]) -> Row {
        Row { misses, ..self }
    }
}

const ALL: &[Engine] = &[Cairn, Uncontrolled, Plain];
const BOTH: &[Engine] = &[Cairn, Uncontrolled];
const ONE: &[Engine] = &[Cairn];

const fn row(
    name: &'static str,
    passes_when: &'static str,
    run: fn(Engine, Extent) -> Outcome,
    judged: &'static [Engine],
    shown: &'static [Engine],
) -> Row {
    Row { name, passes_when, run, judged, shown, misses: &[] }
}

/// All rows, in the order of the table.
pub const ROWS: &[Row] = &[
    row(
        "card_tower",
        "a house of 40 cards, thickness 1:100, friction 0.7: moves < 2 % of its height in 60 s, penetration < 12 % of \
         a thickness; at 0.2 it falls",
        stacks::card_tower,
        ONE,
        ALL,
    ),
    row("card_thin", "the same, of cards 0.1 mm thick", stacks::card_thin, ONE, ALL),
    row(
        "card_pull",
        "one of two cards that lean against each other is pulled out: the other falls within 0.5 s",
        stacks::card_pull,
        BOTH,
        ALL,
    ),
    row("heavy_on_light", "a cube on a cube, 10, 100, 1000 : 1: sinks < 1 %", stacks::heavy_on_light, BOTH, ALL),
    row("heaviest_on_light", "the same at 10000:1: sinks < 1 %", stacks::heaviest_on_light, BOTH, ALL).missed(&[
        Miss {
            engine: Uncontrolled,
            extent: Extent::Short,
            why: "no contact of the engine carries so much: it sinks through, and only the plan's warning says so",
        },
    ]),
    row(
        "heaviest_is_told",
        "the same: the report warns of the masses at 10000:1, and not at 10:1",
        stacks::heaviest_is_told,
        BOTH,
        BOTH,
    ),
    row(
        "tower",
        "10 cubes of 1 mm, 1 cm, 10 cm, 1 m, 100 m: sinks < 5 %, moves sideways < 1 % of its height in 20 s",
        stacks::tower,
        BOTH,
        ALL,
    ),
    row(
        "thin_stack",
        "900 books of 40 mm in 20 columns: mean penetration < 1 % of a thickness",
        stacks::thin_stack,
        ONE,
        ALL,
    ),
    row(
        "edge_hover",
        "a 10 mm cube pushed over a table's edge: drops within 10 % of its edge of the exact place",
        edges::edge_hover,
        BOTH,
        ALL,
    ),
    row(
        "overhang",
        "5 blocks that overhang by sum 1/2i: stand at -1 %, fall at +1 %",
        edges::overhang,
        &[Uncontrolled],
        ALL,
    ),
    row(
        "slope",
        "a block on a slope, friction 0, 0.05, 0.7, 1, 1.5, in 4 azimuths: slips from atan mu +- 2 % or 0.1 degrees on",
        edges::slope,
        &[Uncontrolled],
        ALL,
    ),
    row(
        "projectile",
        "a ball of 1, 10, 100 times a cube's mass at 1, 10, 100 m/s into a held wall: it leaves no cube behind that \
         it did not go around, no energy is gained (< 2 % of what it brings), none lost",
        hits::projectile,
        BOTH,
        ALL,
    ),
    row(
        "needles",
        "60 rods of 1:100 fall in a heap: no point faster than 2 sqrt(2 g h), none lost",
        starts::needles,
        BOTH,
        ALL,
    ),
    row("overlap", "27 cubes that overlap by 25 %: no faster than 1 m/s, none tunnels", starts::overlap, BOTH, ALL),
    row("coincident", "20 cubes at one pose: no faster than 3 m/s, all end apart", starts::coincident, BOTH, ALL),
    row(
        "nan_inside",
        "a body's state becomes NaN: it is named and set aside, bodies apart from it stay bit-identical, the bake \
         says so",
        starts::nan_inside,
        ONE,
        ONE,
    ),
    row(
        "spin",
        "a disk spun upright on the ground for 60 s: energy grows < 0.5 %",
        energy::spin,
        &[Uncontrolled],
        &[Uncontrolled, Plain],
    ),
    row(
        "zero_g",
        "a tumbling brick without gravity for 60 s: energy grows < 0.5 %",
        energy::zero_g,
        &[Uncontrolled],
        &[Uncontrolled, Plain],
    ),
    row(
        "far",
        "a pile of sticks 1, 360 and 1,000 km from the origin: the same as at the origin within d/1000",
        places::far,
        BOTH,
        BOTH,
    ),
    row(
        "fast_scenery",
        "a wall of 8 mm that starts at 4 m/s goes through none of three cubes of 20 mm",
        places::fast_scenery,
        BOTH,
        ALL,
    ),
    row(
        "conveyor",
        "a block on a slab that moves at 1 m/s from the first frame on slides by v^2 / 2 mu g within 10 %",
        places::conveyor,
        BOTH,
        ALL,
    ),
    row(
        "turntable",
        "stacks of two blocks on a plate that turns by 10 rad: each stays within 1 % of its radius r while \
         w^2 r < 0.9 mu g, and slides at 1.1",
        places::turntable,
        BOTH,
        ALL,
    ),
    row(
        "chain",
        "8 rings that hang in each other: no faster than 0.5 m/s, each stays below the one above as far as both \
         shapes are exact, rest",
        places::chain,
        BOTH,
        ALL,
    ),
    row(
        "falls_once",
        "a cone and a column of sticks that nothing holds in the end: no body falls again after a second of rest, \
         free fall within 1 %",
        places::falls_once,
        BOTH,
        BOTH,
    ),
    row("balls", "1000 spheres in a heap come to rest and stay (200 in the tests)", piles::balls, BOTH, ALL),
    row(
        "rolling",
        "a ball that rolls at 1 m/s slows by c g / 1.4 within 5 %, c its rolling resistance",
        piles::rolling,
        &[Uncontrolled],
        ALL,
    ),
    row(
        "rest_sticks",
        "609 sticks (150 in the tests): at rest within 2 s of the last release in the median of seven seeds; in each, \
         creep < d/100 in 60 s (20), none hanging, none lost",
        piles::rest_sticks,
        ONE,
        BOTH,
    ),
    row(
        "rest_bananas",
        "1000 nonconvex bananas (80 in the tests): the same of one seed, in 60 s (10)",
        piles::rest_bananas,
        ONE,
        BOTH,
    ),
    row("long", "a held pile for 10 minutes (1 in the tests): drifts < d/100", piles::long, ONE, ONE),
    row("many", "10,000 and 100,000 bodies (1,000 in the tests): finishes, none lost", piles::many, ONE, ONE),
    row(
        "degenerate_mesh",
        "no area, flat, empty, one triangle, inside out: an error that names the mesh, or a stated fallback",
        inputs::degenerate_mesh,
        ONE,
        ONE,
    ),
    row(
        "bad_container",
        "open, non-manifold, inverted, several parts, self-intersecting: filled and nothing lost, or refused with the \
         reason",
        inputs::bad_container,
        ONE,
        ONE,
    ),
    row("scaled_node", "a node scaled by (2, 0.5, -3): mass within 1 %, faces outward", inputs::scaled_node, ONE, ONE),
];

/// The row of a name.
pub fn of(name: &str) -> &'static Row {
    ROWS.iter().find(|row| row.name == name).expect("a row of this name")
}
