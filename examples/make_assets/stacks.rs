//! Things as they stand on each other, for an analysis.

use crate::asset::Asset;
use std::f64::consts::{PI, TAU};

/// A dry-stone arch of 15 stones between two piers: its middle line is a semicircle of 1 m, and the stones are 0.2 m
/// thick.
pub fn arch() -> Vec<(String, Asset)> {
    const STONES: usize = 15;
    const PIER: f64 = 0.6;
    let mut things = Vec::new();
    for (name, x) in [("left pier", -1.0), ("right pier", 1.0)] {
        let mut pier = Asset::default();
        pier.cuboid([x - 0.2, 0.0, -0.15], [x + 0.2, PIER, 0.15], "stone");
        things.push((name.to_owned(), pier));
    }
    for k in 0..STONES {
        let at = |joint: usize, radius: f64| {
            let angle = PI * joint as f64 / STONES as f64;
            [radius * angle.cos(), PIER + radius * angle.sin()]
        };
        let profile = [at(k, 0.9), at(k, 1.1), at(k + 1, 1.1), at(k + 1, 0.9)];
        let mut stone = Asset::default();
        stone.extrusion(&profile, &[[0, 1, 2], [0, 2, 3]], 0.3, "brick");
        let name = if k == STONES / 2 { "keystone".to_owned() } else { format!("stone {}", k + 1) };
        things.push((name, stone));
    }
    things
}

/// A table that is laid: plates, glasses, books, and a board that reaches over the edge, held down by a jug.
pub fn table() -> Vec<(String, Asset)> {
    const TOP: f64 = 0.74;
    let mut table = Asset::default();
    table.cuboid([-0.7, TOP - 0.04, -0.4], [0.7, TOP, 0.4], "timber");
    for (x, z) in [(-0.6, -0.3), (0.6, -0.3), (-0.6, 0.3), (0.6, 0.3)] {
        table.cuboid([x - 0.04, 0.0, z - 0.04], [x + 0.04, TOP - 0.04, z + 0.04], "timber");
    }
    let mut things = vec![("table".to_owned(), table)];
    let mut add = |name: &str, asset: Asset| things.push((name.to_owned(), asset));
    let mut height = TOP;
    for (k, radius) in [0.14, 0.14, 0.14, 0.11].into_iter().enumerate() {
        add(&format!("plate {}", k + 1), round([-0.4, height, 0.1], radius, 0.02, "china"));
        height += 0.02;
    }
    add("bowl", round([-0.4, height, 0.1], 0.07, 0.06, "glaze"));
    add("glass 1", round([-0.1, TOP, 0.2], 0.035, 0.14, "glaze"));
    add("glass 2", round([0.05, TOP, 0.28], 0.035, 0.14, "glaze"));
    let mut tray = Asset::default();
    tray.cuboid([-0.17, TOP + 0.14, 0.15], [0.12, TOP + 0.15, 0.33], "steel");
    add("tray", tray);
    add("candle", round([-0.02, TOP + 0.15, 0.24], 0.03, 0.1, "paper"));
    let mut height = TOP;
    for (k, (x, material)) in [(0.0, "cover"), (0.03, "back"), (0.075, "red"), (0.14, "cover")].into_iter().enumerate()
    {
        let mut book = Asset::default();
        book.cuboid([x - 0.08, height, -0.35], [x + 0.16, height + 0.035, -0.17], material);
        add(&format!("book {}", k + 1), book);
        height += 0.035;
    }
    let mut board = Asset::default();
    board.cuboid([0.45, TOP, -0.05], [1.0, TOP + 0.02, 0.2], "plank");
    add("board", board);
    add("jug", round([0.52, TOP + 0.02, 0.07], 0.06, 0.22, "paint"));
    add("bread", {
        let mut bread = Asset::default();
        bread.cuboid([0.8, TOP + 0.02, 0.03], [0.95, TOP + 0.1, 0.12], "banana");
        bread
    });
    things
}

/// An upright prism of many sides on a place.
fn round([x, y, z]: [f64; 3], radius: f64, height: f64, material: &'static str) -> Asset {
    const SIDES: usize = 24;
    let at = |k: usize, y: f64| {
        let (sin, cos) = (TAU * (k % SIDES) as f64 / SIDES as f64).sin_cos();
        [x + radius * sin, y, z + radius * cos]
    };
    let mut asset = Asset::default();
    for k in 0..SIDES {
        let corners = [at(k, y), at(k + 1, y), at(k + 1, y + height), at(k, y + height)];
        asset.flat(&corners, &[[0, 1, 2], [0, 2, 3]], material);
        asset.flat(&[[x, y + height, z], at(k, y + height), at(k + 1, y + height)], &[[0, 1, 2]], material);
        asset.flat(&[[x, y, z], at(k + 1, y), at(k, y)], &[[0, 1, 2]], material);
    }
    asset
}
