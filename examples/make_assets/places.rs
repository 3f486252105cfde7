//! Scenery, one function each: what piles lie on, in and around.

use crate::asset::Asset;
use crate::shapes::turned;
use crate::vector::Point;

/// Hills of 6 x 6 m, up to 1.1 m high, closed by a flat bottom.
pub fn hills() -> Asset {
    const N: usize = 28;
    const HALF: f64 = 3.0;
    let height = |x: f64, z: f64| {
        0.55 + 0.28 * (1.1 * x + 0.4).sin() * (0.9 * z).cos() + 0.1 * (2.3 * x - 1.9 * z).sin() + 0.1 * x
    };
    let at = |i: usize, k: usize| [i, k].map(|n| (2.0 * n as f64 / N as f64 - 1.0) * HALF);
    let top = |i: usize, k: usize| -> Point {
        let [x, z] = at(i, k);
        [x, height(x, z), z]
    };
    let bottom = |i: usize, k: usize| -> Point {
        let [x, z] = at(i, k);
        [x, 0.0, z]
    };
    let points: Vec<Point> = (0..=N).flat_map(|i| (0..=N).map(move |k| top(i, k))).collect();
    let index = |i: usize, k: usize| i * (N + 1) + k;
    let cells = || (0..N).flat_map(|i| (0..N).map(move |k| (i, k)));
    let faces = cells().flat_map(|(i, k)| {
        let [a, b, c, d] = [index(i, k), index(i, k + 1), index(i + 1, k), index(i + 1, k + 1)];
        [[a, b, c], [b, d, c]]
    });
    let mut asset = Asset::default();
    asset.smooth(&points, &[("grass", faces.collect())]);
    for k in 0..N {
        let side = |low: [usize; 2], next: [usize; 2]| {
            [bottom(low[0], low[1]), bottom(next[0], next[1]), top(next[0], next[1]), top(low[0], low[1])]
        };
        for corners in
            [side([0, k], [0, k + 1]), side([N, k + 1], [N, k]), side([k + 1, 0], [k, 0]), side([k, N], [k + 1, N])]
        {
            asset.flat(&corners, &[[0, 1, 2], [0, 2, 3]], "soil");
        }
    }
    // Around the rim, and from its middle.
    let rim = (0..N).map(|i| bottom(i, 0)).chain((0..N).map(|k| bottom(N, k)));
    let rim = rim.chain((0..N).map(|i| bottom(N - i, N))).chain((0..N).map(|k| bottom(0, N - k)));
    let corners: Vec<Point> = rim.chain([[0.0; 3]]).collect();
    let faces: Vec<[usize; 3]> = (0..4 * N).map(|i| [i, (i + 1) % (4 * N), 4 * N]).collect();
    asset.flat(&corners, &faces, "soil");
    asset
}

/// An open box of sheet steel, 1.2 x 0.8 x 0.7 m inside.
pub fn bin() -> Asset {
    open_box([0.6, 0.4, 0.02, 0.72])
}

/// A tray, 0.56 x 0.4 m inside, 0.1 m deep.
pub fn tray() -> Asset {
    open_box([0.28, 0.2, 0.01, 0.11])
}

/// Half of the inner width and depth, thickness of walls and floor, and height.
fn open_box([half_x, half_z, wall, high]: [f64; 4]) -> Asset {
    let (out_x, out_z) = (half_x + wall, half_z + wall);
    let mut asset = Asset::default();
    asset.cuboid([-out_x, 0.0, -out_z], [out_x, wall, out_z], "paint");
    asset.cuboid([-out_x, wall, -out_z], [out_x, high, -half_z], "paint");
    asset.cuboid([-out_x, wall, half_z], [out_x, high, out_z], "paint");
    asset.cuboid([-out_x, wall, -half_z], [-half_x, high, half_z], "paint");
    asset.cuboid([half_x, wall, -half_z], [out_x, high, half_z], "paint");
    asset
}

/// A desk of 1.4 x 0.8 m, 0.72 m high.
pub fn desk() -> Asset {
    let mut asset = Asset::default();
    asset.cuboid([-0.7, 0.69, -0.4], [0.7, 0.72, 0.4], "timber");
    for (x, z) in [(-0.66, -0.36), (0.62, -0.36), (-0.66, 0.32), (0.62, 0.32)] {
        asset.cuboid([x, 0.0, z], [x + 0.04, 0.69, z + 0.04], "steel");
    }
    asset
}

/// A pillar of 0.4 m, 2.4 m high.
pub fn pillar() -> Asset {
    let profile = [[0.0, 0.0], [0.32, 0.0], [0.32, 0.12], [0.2, 0.16], [0.2, 2.2], [0.3, 2.28], [0.3, 2.4], [0.0, 2.4]];
    turned(&profile, "stone")
}

/// Five steps of 0.2 x 0.35 m, 3 m wide.
pub fn stairs() -> Asset {
    let mut asset = Asset::default();
    for step in 0..5 {
        let (x, up) = (-0.875 + 0.35 * f64::from(step), 0.2 * f64::from(step));
        asset.cuboid([x, 0.0, -1.5], [x + 0.35, up + 0.2, 1.5], "stone");
    }
    asset
}

/// A rack of two boards on four posts, 1.8 m wide.
pub fn rack() -> Asset {
    let mut asset = Asset::default();
    for (low, high) in [(0.3, 0.33), (0.75, 0.78)] {
        asset.cuboid([-0.9, low, -0.32], [0.9, high, 0.32], "timber");
    }
    for (x, z) in [(-0.86, -0.3), (0.82, -0.3), (-0.86, 0.26), (0.82, 0.26)] {
        asset.cuboid([x, 0.0, z], [x + 0.04, 1.2, z + 0.04], "steel");
    }
    asset
}

/// A jar with a neck, 0.3 m wide and 0.4 m high, its wall 6 mm thick.
pub fn jar() -> Asset {
    let outside = [[0.14, 0.0], [0.15, 0.012], [0.15, 0.27], [0.11, 0.34], [0.11, 0.4]];
    let inside = [[0.104, 0.4], [0.104, 0.338], [0.144, 0.267], [0.144, 0.014], [0.134, 0.006], [0.0, 0.006]];
    turned(&[&[[0.0, 0.0]], &outside[..], &inside[..]].concat(), "glaze")
}

/// A block beside the middle, for two piles.
pub fn beside(x: f64) -> Asset {
    let mut asset = Asset::default();
    asset.cuboid([x - 0.75, 0.0, -0.5], [x + 0.75, 0.9, 0.5], "control");
    asset
}
