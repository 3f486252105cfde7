//! The corners and the planes of a hull side by side, so that the processor looks at several of them at once.

use glam::Quat;
use rapier3d::math::{Pose, Vector};
use rapier3d::parry::bounding_volume::Aabb;
use wide::f32x8;

/// Some points side by side: their coordinates along each axis. The last of several is filled up with its last point.
pub type CornerLanes = [f32x8; 3];
/// What is looked at in one go.
pub const LANES: usize = 8;

/// Some planes side by side. The last of several is filled up with its last plane.
#[derive(Clone, Copy, Debug)]
pub struct PlaneLanes {
    /// Unit, outwards.
    pub normal: [f32x8; 3],
    /// Distance from the origin along the normal.
    pub offset: f32x8,
}

impl PlaneLanes {
    /// Distances of a point from the planes, moved out to `scale` times as far; positive outside.
    pub fn distances(&self, p: Vector, scale: f32) -> f32x8 {
        dot(&self.normal, p) - self.offset * f32x8::splat(scale)
    }
}

/// Of vectors side by side with one.
pub fn dot([x, y, z]: &[f32x8; 3], v: Vector) -> f32x8 {
    *x * f32x8::splat(v.x) + *y * f32x8::splat(v.y) + *z * f32x8::splat(v.z)
}

/// Lane by lane, the greater one. For numbers that are compared, never stored: which of two zeros it is differs from
/// processor to processor.
pub fn greater(a: f32x8, b: f32x8) -> f32x8 {
    a.fast_max(b)
}

/// The greatest of some lanes.
pub fn greatest(lanes: f32x8) -> f32 {
    let [a, b, c, d, e, f, g, h] = lanes.to_array();
    let more = |a: f32, b: f32| if a > b { a } else { b };
    more(more(more(a, b), more(c, d)), more(more(e, f), more(g, h)))
}

/// Where a number that is in one of these lanes is first.
pub fn position(lanes: &[f32x8], number: f32) -> usize {
    let wanted = f32x8::splat(number);
    for (chunk, values) in lanes.iter().enumerate() {
        let bits = values.simd_eq(wanted).to_bitmask();
        if bits != 0 {
            return chunk * LANES + bits.trailing_zeros() as usize;
        }
    }
    0
}

pub(super) fn lanes(points: &[Vector]) -> Vec<CornerLanes> {
    let of = |chunk: &[Vector]| [0, 1, 2].map(|axis| eight(chunk, |p| p[axis]));
    points.chunks(LANES).map(of).collect()
}

/// Planes by their normals and distances from the origin.
pub(super) fn plane_lanes(planes: &[(Vector, f32)]) -> Vec<PlaneLanes> {
    let of = |chunk: &[(Vector, f32)]| PlaneLanes {
        normal: [0, 1, 2].map(|axis| eight(chunk, |plane| plane.0[axis])),
        offset: eight(chunk, |plane| plane.1),
    };
    planes.chunks(LANES).map(of).collect()
}

/// A number of each of up to eight things, filled up with that of the last.
pub fn eight<T>(chunk: &[T], number: impl Fn(&T) -> f32) -> f32x8 {
    let mut lane = [0.0; LANES];
    for (k, lane) in lane.iter_mut().enumerate() {
        *lane = number(&chunk[k.min(chunk.len() - 1)]);
    }
    f32x8::new(lane)
}

/// The number of the first point that is outermost in a direction.
pub fn outermost(lanes: &[CornerLanes], direction: Vector) -> usize {
    let mut heights = [f32x8::ZERO; CHUNKS];
    let (mut best, mut first) = (f32::NEG_INFINITY, 0);
    // Nearly always one round.
    for (round, lanes) in lanes.chunks(CHUNKS).enumerate() {
        let mut greater = f32x8::splat(f32::NEG_INFINITY);
        for (lane, height) in lanes.iter().zip(&mut heights) {
            *height = dot(lane, direction);
            greater = greater.fast_max(*height);
        }
        let top = greatest(greater);
        if top > best {
            (best, first) = (top, round * CHUNKS * LANES + position(&heights[..lanes.len()], top));
        }
    }
    first
}

/// Lanes of heights that are kept at once.
const CHUNKS: usize = 16;

/// The height of the outermost point in a direction.
pub fn top(lanes: &[CornerLanes], direction: Vector) -> f32 {
    greatest(lanes.iter().fold(f32x8::splat(f32::NEG_INFINITY), |best, lane| greater(dot(lane, direction), best)))
}

/// The heights of all points in a direction; returns that of the outermost one.
pub fn heights(lanes: &[CornerLanes], direction: Vector, heights: &mut Vec<f32x8>) -> f32 {
    heights.clear();
    let mut best = f32x8::splat(f32::NEG_INFINITY);
    heights.extend(lanes.iter().map(|lane| {
        let height = dot(lane, direction);
        best = greater(height, best);
        height
    }));
    greatest(best)
}

/// One number after the other.
pub fn flat(lanes: &[f32x8], number: usize) -> f32 {
    lanes[number / LANES].as_array()[number % LANES]
}

/// The box around points, `scale` times as far out, at a pose: to the last bit as the geometry library has it.
pub(super) fn aabb(lanes: &[CornerLanes], scale: f32, position: &Pose) -> Aabb {
    let Quat { x: a, y: b, z: c, w } = position.rotation;
    let (straight, twice) = (w * w - (a * a + b * b + c * c), w * 2.0);
    let [a, b, c, straight, twice] = [a, b, c, straight, twice].map(f32x8::splat);
    let mut low = [f32x8::splat(f32::INFINITY); 3];
    let mut high = [f32x8::splat(f32::NEG_INFINITY); 3];
    for lane in lanes {
        let [x, y, z] = lane.map(|unit| unit * f32x8::splat(scale));
        let along = (x * a + y * b + z * c) * f32x8::splat(2.0);
        let turned = [
            x * straight + a * along + (b * z - c * y) * twice,
            y * straight + b * along + (c * x - a * z) * twice,
            z * straight + c * along + (a * y - b * x) * twice,
        ];
        for axis in 0..3 {
            low[axis] = low[axis].fast_min(turned[axis]);
            high[axis] = greater(turned[axis], high[axis]);
        }
    }
    let (least, most) = (low.map(|lane| -greatest(-lane)), high.map(greatest));
    Aabb::new(Vector::from(least) + position.translation, Vector::from(most) + position.translation)
}
