//! The corners of a hull side by side, so that the processor looks at several of them at once.

use glam::Quat;
use rapier3d::math::{Pose, Vector};
use rapier3d::parry::bounding_volume::Aabb;
use std::sync::Arc;

/// Some points side by side: their coordinates along each axis. The last of several is filled up with its last point.
pub(super) type Lanes = [[f32; LANES]; 3];
/// Points that are compared in one go.
const LANES: usize = 8;

pub(super) fn lanes(points: &[Vector]) -> Arc<[Lanes]> {
    let of = |chunk: &[Vector]| {
        let at = |k: usize| chunk[k.min(chunk.len() - 1)];
        [std::array::from_fn(|k| at(k).x), std::array::from_fn(|k| at(k).y), std::array::from_fn(|k| at(k).z)]
    };
    points.chunks(LANES).map(of).collect()
}

/// The number of the first point that is outermost in a direction.
pub(super) fn outermost(lanes: &[Lanes], direction: Vector) -> usize {
    let (mut best, mut chunk) = ([f32::NEG_INFINITY; LANES], [0u32; LANES]);
    for (number, [x, y, z]) in lanes.iter().enumerate() {
        for k in 0..LANES {
            let height = x[k] * direction.x + y[k] * direction.y + z[k] * direction.z;
            let is_higher = height > best[k];
            best[k] = if is_higher { height } else { best[k] };
            chunk[k] = if is_higher { number as u32 } else { chunk[k] };
        }
    }
    let number = |k: usize| chunk[k] as usize * LANES + k;
    let first = |a: usize, b: usize| {
        let is_later = best[b] > best[a] || best[b] == best[a] && number(b) < number(a);
        if is_later { b } else { a }
    };
    number((1..LANES).fold(0, first))
}

/// The box around points at a pose, to the last bit as the geometry library has it.
pub(super) fn aabb(lanes: &[Lanes], position: &Pose) -> Aabb {
    let Quat { x: a, y: b, z: c, w } = position.rotation;
    let (straight, twice) = (w * w - (a * a + b * b + c * c), w * 2.0);
    let mut low = [[f32::INFINITY; LANES]; 3];
    let mut high = [[f32::NEG_INFINITY; LANES]; 3];
    for [x, y, z] in lanes {
        for k in 0..LANES {
            let (x, y, z) = (x[k], y[k], z[k]);
            let along = (x * a + y * b + z * c) * 2.0;
            let turned = [
                x * straight + a * along + (b * z - c * y) * twice,
                y * straight + b * along + (c * x - a * z) * twice,
                z * straight + c * along + (a * y - b * x) * twice,
            ];
            for axis in 0..3 {
                low[axis][k] = low[axis][k].min(turned[axis]);
                high[axis][k] = high[axis][k].max(turned[axis]);
            }
        }
    }
    let least = low.map(|lane| lane.into_iter().fold(f32::INFINITY, f32::min));
    let most = high.map(|lane| lane.into_iter().fold(f32::NEG_INFINITY, f32::max));
    Aabb::new(Vector::from(least) + position.translation, Vector::from(most) + position.translation)
}
