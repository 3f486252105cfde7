//! The hard cases: what breaks simulators must not break this one. `README.md` beside this file tells the figures; the
//! rows whose verdict is one of statics (boundary, units, duplicate, collinear, arch, wedge, and the verdicts of slope and overhang) are
//! tests of the analysis in `server/core/tests/equilibrium/`.
//!
//! The full size of the shortened rows: `cargo test --release --test hard -- --ignored`.

mod rows;

use rows::{Extent, Row};

/// Runs a row with what must pass it. An expected failure must fail: once it passes, it is none any more.
fn check(name: &str, extent: Extent) {
    let row: &Row = rows::of(name);
    for &engine in row.judged {
        let outcome = (row.run)(engine, extent);
        println!("{name}, {engine:?}: {}", outcome.told);
        match row.fails {
            None => assert!(outcome.passed, "{name}, {engine:?}: {}; it passes when: {}", outcome.told, row.passes_when),
            Some(why) => assert!(!outcome.passed, "{name} passes now ({}): it was to fail, since {why}", outcome.told),
        }
    }
}

macro_rules! rows {
    ($($name:ident),* $(,)?) => {
        $(#[test] fn $name() { check(stringify!($name), Extent::Short) })*

        #[test]
        fn every_row_is_a_test() {
            let tested = [$(stringify!($name)),*];
            assert!(rows::ROWS.iter().all(|row| tested.contains(&row.name)) && tested.len() == rows::ROWS.len());
        }
    };
}

rows!(
    card_tower, card_thin, card_pull, heavy_on_light, tower, thin_stack, edge_hover, overhang, slope, projectile, needles,
    overlap, coincident, nan_inside, spin, zero_g, balls, rest_sticks, rest_bananas, long, many, degenerate_mesh,
    bad_container, scaled_node,
);

macro_rules! full {
    ($($name:ident: $row:ident),* $(,)?) => {
        $(#[test] #[ignore = "minutes"] fn $name() { check(stringify!($row), Extent::Full) })*
    };
}

full!(
    card_tower_full: card_tower, card_thin_full: card_thin, tower_full: tower, balls_full: balls,
    rest_sticks_full: rest_sticks, rest_bananas_full: rest_bananas, long_full: long, many_full: many,
);
