//! Pockets: parts of the control mesh that the fill did not reach, since they are narrow, or since poured props cannot
//! get under an overhang.

use super::filling::Filling;
use glam::DVec3;

/// Distance between the sampled points, d.
const SPACING: f64 = 0.3;
/// A place belongs to a pocket if it is farther than this from every body's surface sphere, in d: gaps between props
/// are not pockets.
const REACH: f64 = 0.25;

/// Share of the container's volume in pockets.
pub fn fraction(filling: &Filling) -> f64 {
    let container = filling.task.container;
    let (origin, size, values) = container.distance.nodes();
    let spacing = container.distance.spacing();
    let stride = (SPACING / spacing).round().max(1.0) as usize;
    let counts = size.map(|n| n.div_ceil(stride));
    let step = spacing * stride as f64;
    let mut reached = vec![false; counts.iter().product()];
    let index = |[x, y, z]: [usize; 3]| (z * counts[1] + y) * counts[0] + x;
    for id in filling.world.present() {
        let center = filling.world.pose(id).translation;
        let radius = filling.world.body(id).radius + REACH;
        let low = ((center - radius - origin) / step).ceil().max(DVec3::ZERO).to_array();
        let high = ((center + radius - origin) / step).floor().to_array();
        let range = |k: usize| low[k] as usize..((high[k] + 1.0).max(0.0) as usize).min(counts[k]);
        for z in range(2) {
            for y in range(1) {
                for x in range(0) {
                    let p = origin + DVec3::new(x as f64, y as f64, z as f64) * step;
                    if p.distance_squared(center) <= radius * radius {
                        reached[index([x, y, z])] = true;
                    }
                }
            }
        }
    }
    let (mut inside, mut empty) = (0u64, 0u64);
    for z in 0..counts[2] {
        for y in 0..counts[1] {
            for x in 0..counts[0] {
                let node = (z * stride * size[1] + y * stride) * size[0] + x * stride;
                let height = origin.y + y as f64 * step;
                if values[node] <= 0.0 && height >= container.base {
                    inside += 1;
                    empty += u64::from(!reached[index([x, y, z])]);
                }
            }
        }
    }
    empty as f64 / inside.max(1) as f64
}
