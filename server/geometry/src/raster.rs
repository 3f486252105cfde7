//! Heights of triangles at the cells of a grid seen from above.

use glam::DVec2;

/// Calls `met` with the index of a cell, that of a sample of it, and a height, wherever the triangle is above or below
/// a sample. `samples`: their places in a cell, along each axis, in cells from its middle. `triangle`: the corners seen
/// from above, with their heights; metres.
pub fn rasterise(
    triangle: [(DVec2, f64); 3],
    cell: f64,
    size: [usize; 2],
    samples: &[f64],
    mut met: impl FnMut(usize, usize, f64),
) {
    let [(a, ya), (b, yb), (c, yc)] = triangle;
    let area = (b - a).perp_dot(c - a);
    if area.abs() < 1e-12 * cell * cell {
        return;
    }
    let low = (a.min(b).min(c) / cell).floor().max(DVec2::ZERO);
    let high = (a.max(b).max(c) / cell).ceil();
    for z in low.y as usize..(high.y.max(0.0) as usize).min(size[1]) {
        for x in low.x as usize..(high.x.max(0.0) as usize).min(size[0]) {
            for sample in 0..samples.len().pow(2) {
                let off = DVec2::new(samples[sample % samples.len()], samples[sample / samples.len()]);
                let p = (DVec2::new(x as f64, z as f64) + 0.5 + off) * cell;
                let (v, w) = ((p - a).perp_dot(c - a) / area, (b - a).perp_dot(p - a) / area);
                if v >= -1e-9 && w >= -1e-9 && v + w <= 1.0 + 1e-9 {
                    met(z * size[0] + x, sample, ya + v * (yb - ya) + w * (yc - ya));
                }
            }
        }
    }
}
