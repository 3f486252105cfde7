//! The props and control meshes, one function each.

use crate::asset::Asset;
use crate::vector::{Point, mean};
use std::f64::consts::{PI, TAU};

/// 1 m long and 0.1 m thick, with a wood grain along it.
pub fn stick() -> Asset {
    let mut asset = Asset::with_texture(wood_grain());
    asset.cuboid([-0.5, 0.0, -0.05], [0.5, 0.1, 0.05], "wood");
    asset
}

pub fn cube() -> Asset {
    let mut asset = Asset::default();
    asset.cuboid([-0.1, 0.0, -0.1], [0.1, 0.2, 0.1], "red");
    asset
}

/// A box on the ground: its edges along x, y, z.
pub fn block([x, y, z]: [f64; 3], material: &'static str) -> Asset {
    let mut asset = Asset::default();
    asset.cuboid([-x / 2.0, 0.0, -z / 2.0], [x / 2.0, y, z / 2.0], material);
    asset
}

/// A dinner plate with a foot and a raised rim.
pub fn plate() -> Asset {
    let below = [[0.085, 0.0], [0.09, 0.004], [0.13, 0.018], [0.132, 0.021]];
    let above = [[0.13, 0.024], [0.09, 0.010], [0.0, 0.009]];
    turned(&[&[[0.0, 0.0]], &below[..], &above[..]].concat(), "china")
}

/// A bowl whose wall is 5 mm thick.
pub fn bowl() -> Asset {
    let below = [[0.035, 0.0], [0.052, 0.012], [0.067, 0.035], [0.075, 0.065]];
    let above = [[0.07, 0.065], [0.062, 0.036], [0.048, 0.016], [0.03, 0.006], [0.0, 0.005]];
    turned(&[&[[0.0, 0.0]], &below[..], &above[..]].concat(), "glaze")
}

/// A playing card, upright: 63 x 88 mm and a hundredth as thick, its face to the front and its back to the back.
pub fn card() -> Asset {
    let [side, height, thick] = [0.0315, 0.088, 0.00088 / 2.0];
    let corner = |i: usize| {
        let pick = |bit: usize, low: f64, high: f64| if i >> bit & 1 == 1 { high } else { low };
        [pick(0, -side, side), pick(1, 0.0, height), pick(2, -thick, thick)]
    };
    let mut asset = Asset::default();
    let sides: [([usize; 4], &'static str); 6] = [
        ([4, 5, 7, 6], "face"),
        ([0, 2, 3, 1], "back"),
        ([0, 4, 6, 2], "face"),
        ([1, 3, 7, 5], "face"),
        ([0, 1, 5, 4], "face"),
        ([2, 6, 7, 3], "face"),
    ];
    for (side, material) in sides {
        asset.flat(&side.map(corner), &[[0, 1, 2], [0, 2, 3]], material);
    }
    asset
}

/// A ball on the ground.
pub fn ball(radius: f64) -> Asset {
    const STEPS: usize = 16;
    let profile: Vec<[f64; 2]> = (0..=STEPS)
        .map(|i| {
            let (sin, cos) = (PI * (i as f64 / STEPS as f64 - 0.5)).sin_cos();
            let out = if i == 0 || i == STEPS { 0.0 } else { radius * cos };
            [out, radius + radius * sin]
        })
        .collect();
    turned(&profile, "steel")
}

/// Height of the cart's rim, m.
pub const CART_RIM: f64 = 0.7;

/// A box of planks on four wheels, 1.1 x 0.66 m inside.
pub fn cart() -> Asset {
    let [half_x, half_z, wall, floor] = [0.55, 0.33, 0.03, 0.28];
    let (out_x, out_z) = (half_x + wall, half_z + wall);
    let mut asset = Asset::default();
    asset.cuboid([-out_x, floor - wall, -out_z], [out_x, floor, out_z], "plank");
    asset.cuboid([-out_x, floor, -out_z], [out_x, CART_RIM, -half_z], "plank");
    asset.cuboid([-out_x, floor, half_z], [out_x, CART_RIM, out_z], "plank");
    asset.cuboid([-out_x, floor, -half_z], [-half_x, CART_RIM, half_z], "plank");
    asset.cuboid([half_x, floor, -half_z], [out_x, CART_RIM, half_z], "plank");
    let (radius, gap) = (0.17, 0.02);
    for (x, z) in [(-0.35, -1.0), (0.35, -1.0), (-0.35, 1.0), (0.35, 1.0)] {
        let near = out_z + gap;
        asset.disc([x, radius, z * near], radius, z * 0.05, "steel");
    }
    for x in [-0.35, 0.35] {
        asset.cuboid([x - 0.025, radius - 0.025, -out_z - gap], [x + 0.025, radius + 0.025, out_z + gap], "steel");
        asset.cuboid([x - 0.06, radius + 0.025, -0.28], [x + 0.06, floor - wall, 0.28], "plank");
    }
    asset
}

/// A heap on a rectangle of these half edges at height `base`: nearly upright at the sides and round above.
pub fn heap([half_x, half_z]: [f64; 2], base: f64, height: f64) -> Asset {
    const RINGS: usize = 12;
    const SIDES: usize = 48;
    // A rectangle with round corners, shrinking upward as a superellipse does.
    let at = |ring: usize, k: usize| -> Point {
        let up = ring as f64 / RINGS as f64;
        let out = (1.0 - up.powf(2.5)).powf(1.0 / 2.5);
        let (sin, cos) = (TAU * (k % SIDES) as f64 / SIDES as f64).sin_cos();
        let square = |v: f64| v.signum() * v.abs().powf(0.5);
        [out * half_x * square(cos), base + up * height, -out * half_z * square(sin)]
    };
    let mut asset = Asset::default();
    for k in 0..SIDES {
        asset.flat(&[[0.0, base, 0.0], at(0, k + 1), at(0, k)], &[[0, 1, 2]], "control");
        for ring in 0..RINGS {
            let top = ring + 1 == RINGS;
            let corners = [at(ring, k), at(ring, k + 1), at(ring + 1, k + 1), at(ring + 1, k)];
            if top {
                let peak = [corners[0], corners[1], [0.0, base + height, 0.0]];
                asset.flat(&peak, &[[0, 1, 2]], "control");
            } else {
                asset.flat(&corners, &[[0, 1, 2], [0, 2, 3]], "control");
            }
        }
    }
    asset
}

/// A ramp that winds once around the axis between two radii, climbing from one height to another, with upright sides.
pub fn spiral(inner: f64, outer: f64, [low, high]: [f64; 2]) -> Asset {
    const SIDES: usize = 72;
    // Open by a wedge, so that its beginning and its end do not touch.
    const WEDGE: f64 = 0.05;
    let at = |k: usize, radius: f64, top: bool| -> Point {
        let share = k as f64 / SIDES as f64;
        let (sin, cos) = (TAU * (1.0 - WEDGE) * share).sin_cos();
        [radius * cos, if top { low + (high - low) * share } else { 0.0 }, -radius * sin]
    };
    let mut asset = Asset::default();
    for k in 0..SIDES {
        let corner = |next: usize, radius: f64, top: bool| at(k + next, radius, top);
        let [a, b, c, d] =
            [corner(0, inner, true), corner(0, outer, true), corner(1, outer, true), corner(1, inner, true)];
        let [e, f, g, h] =
            [corner(0, inner, false), corner(0, outer, false), corner(1, outer, false), corner(1, inner, false)];
        for side in [[a, b, c, d], [e, h, g, f], [f, g, c, b], [e, a, d, h]] {
            asset.flat(&[side[0], side[1], side[2]], &[[0, 1, 2]], "control");
            asset.flat(&[side[0], side[2], side[3]], &[[0, 1, 2]], "control");
        }
    }
    let end = |k: usize| [at(k, inner, false), at(k, outer, false), at(k, outer, true), at(k, inner, true)];
    asset.flat(&end(0), &[[0, 1, 2], [0, 2, 3]], "control");
    let [a, b, c, d] = end(SIDES);
    asset.flat(&[a, d, c, b], &[[0, 1, 2], [0, 2, 3]], "control");
    asset
}

/// A hard cover, open at three sides, around a block of pages.
pub fn book() -> Asset {
    let [side, height, depth] = [0.08, 0.04, 0.24];
    let (board, inset) = (0.004, 0.005);
    let top = height - board;
    let (spine, edge) = (board - side, side - inset);
    let profile = [
        [-side, 0.],
        [side, 0.],
        [side, board],
        [spine, board],
        [spine, top],
        [side, top],
        [side, height],
        [-side, height],
    ];
    let caps = [[0, 1, 2], [0, 2, 3], [0, 3, 7], [3, 4, 7], [4, 5, 6], [4, 6, 7]];
    let mut asset = Asset::default();
    asset.extrusion(&profile, &caps, depth, "cover");
    asset.cuboid([spine, board, inset - depth / 2.0], [edge, top, depth / 2.0 - inset], "paper");
    asset
}

/// A bent, tapered tube with five soft edges and dark ends.
pub fn banana() -> Asset {
    const RINGS: usize = 25;
    const SIDES: usize = 15;
    let bend = 0.13;
    let mut points: Vec<Point> = Vec::new();
    for i in 0..RINGS {
        let along = i as f64 / (RINGS - 1) as f64;
        let (sin, cos) = (PI * (1.2 + 0.6 * along)).sin_cos();
        let body = (PI * (0.04 + 0.93 * along)).sin().powf(0.45);
        let stalk = if along > 0.85 { 1.0 - 3.5 * (along - 0.85) } else { 1.0 };
        for k in 0..SIDES {
            let turn = TAU * k as f64 / SIDES as f64;
            let radius = 0.019 * body * stalk * (1.0 + 0.06 * (5.0 * turn).cos());
            let out = bend + radius * turn.cos();
            points.push([out * cos, out * sin, -radius * turn.sin()]);
        }
    }
    let last = (RINGS - 1) * SIDES;
    points.extend([mean(&points[..SIDES]), mean(&points[last..])]);
    let lowest = points.iter().fold(f64::INFINITY, |low, p| low.min(p[1]));
    points.iter_mut().for_each(|p| p[1] -= lowest);
    let (mut skin, mut tips) = (Vec::new(), Vec::new());
    for k in 0..SIDES {
        let next = (k + 1) % SIDES;
        for i in 0..RINGS - 1 {
            let [a, b] = [i * SIDES + k, i * SIDES + next];
            let faces = if i == 0 || i + 3 > RINGS - 1 { &mut tips } else { &mut skin };
            faces.extend([[a, b + SIDES, a + SIDES], [a, b, b + SIDES]]);
        }
        tips.extend([[next, k, points.len() - 2], [last + k, last + next, points.len() - 1]]);
    }
    let mut asset = Asset::default();
    asset.smooth(&points, &[("banana", skin), ("tip", tips)]);
    asset
}

/// Half a ball, or half of one that is pressed flat.
pub fn dome(radius: f64, height: f64) -> Asset {
    const STEPS: usize = 12;
    let profile: Vec<[f64; 2]> = (0..=STEPS)
        .map(|i| {
            let (sin, cos) = (PI / 2.0 * i as f64 / STEPS as f64).sin_cos();
            if i == STEPS { [0.0, height] } else { [radius * cos, height * sin] }
        })
        .collect();
    revolved(&profile)
}

/// Arms and stem of thickness `u`: 3 u wide and high.
pub fn letter_t(u: f64) -> Asset {
    let (half, arm) = (u / 2.0, 1.5 * u);
    let (low, high) = (2.0 * u, 3.0 * u);
    let profile =
        [[-half, 0.], [half, 0.], [half, low], [arm, low], [arm, high], [-arm, high], [-arm, low], [-half, low]];
    let caps = [[0, 1, 2], [0, 2, 7], [2, 3, 4], [2, 4, 5], [2, 5, 7], [7, 5, 6]];
    let mut asset = Asset::default();
    asset.extrusion(&profile, &caps, u, "control");
    asset
}

/// A profile of (radius, height) from the base's rim up to a point on the axis, turned around it, with a flat base.
pub fn revolved(profile: &[[f64; 2]]) -> Asset {
    turned(&[&[[0.0, profile[0][1]]], profile].concat(), "control")
}

/// A profile of (radius, height) from one point on the axis up to another, turned around it.
pub fn turned(profile: &[[f64; 2]], material: &'static str) -> Asset {
    const SIDES: usize = 48;
    let mut asset = Asset::default();
    let at = |[r, y]: [f64; 2], k: usize| {
        let (sin, cos) = (TAU * (k % SIDES) as f64 / SIDES as f64).sin_cos();
        [r * cos, y, -r * sin]
    };
    for k in 0..SIDES {
        for pair in profile.windows(2) {
            let (low, high) = (pair[0], pair[1]);
            if low[0] == 0.0 {
                asset.flat(&[[0.0, low[1], 0.0], at(high, k + 1), at(high, k)], &[[0, 1, 2]], material);
                continue;
            }
            let corners = [at(low, k), at(low, k + 1), at(high, k + 1), at(high, k)];
            let faces: &[[usize; 3]] = if high[0] == 0.0 { &[[0, 1, 2]] } else { &[[0, 1, 2], [0, 2, 3]] };
            asset.flat(&corners[..faces.len() + 2], faces, material);
        }
    }
    asset
}

/// Long wavy fibres, light and dark.
fn wood_grain() -> Vec<u8> {
    const SIZE: [u32; 2] = [128, 64];
    let picture = image::RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| {
        let (u, v) = (TAU * f64::from(x) / f64::from(SIZE[0]), TAU * f64::from(y) / f64::from(SIZE[1]));
        let wave = v + 0.25 * u.sin() + 0.1 * (2.0 * u + 1.0).sin();
        let fibre = 0.5 + 0.3 * (3.0 * wave).sin() + 0.15 * (11.0 * v + 0.5 * u.cos()).sin() + 0.05 * (23.0 * v).sin();
        let blend = |dark: f64, light: f64| (dark + (light - dark) * fibre.clamp(0.0, 1.0)) as u8;
        image::Rgb([blend(138.0, 205.0), blend(102.0, 168.0), blend(70.0, 128.0)])
    });
    let mut png = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut png, image::ImageFormat::Png).expect("a picture in memory can be encoded");
    png.into_inner()
}
