//! Signed distance on a regular grid: a query in constant time for loops that ask millions of times.

use super::MeshInterior;
use crate::enlarged_cell;
use glam::DVec3;
use rayon::prelude::*;

/// Cells beyond the region's box on each side, so that a gradient just outside is still interpolated.
const MARGIN: f64 = 2.0;
/// Far from the surface, only every so many nodes along each axis have exact values.
const COARSER: usize = 4;

/// Signed distance to a [`MeshInterior`] at the nodes of a cubic grid around it: negative inside, metres.
/// Between nodes it is trilinear: the error is a fraction of a cell near edges and on the medial axis, and second
/// order elsewhere. A wall thinner than a cell may vanish. Nodes farther from the surface than was asked for are
/// interpolated themselves, between nodes four cells apart.
#[derive(Clone, Debug)]
pub struct DistanceGrid {
    /// The first node.
    origin: DVec3,
    spacing: f64,
    /// Nodes along X, Y, Z.
    size: [usize; 3],
    /// Shape `[z][y][x]`, metres.
    values: Vec<f64>,
    capped: bool,
}

impl DistanceGrid {
    /// A grid of the wanted spacing (metres), or of the finest one that needs no more than `max_nodes`
    /// (at least a thousand are used): see [`DistanceGrid::spacing`] and [`DistanceGrid::capped`]. `exact`: values are
    /// exact this far inside and outside of the surface, metres.
    pub fn new(region: &MeshInterior, spacing: f64, max_nodes: usize, exact: [f64; 2]) -> DistanceGrid {
        assert!(spacing > 0.0 && spacing.is_finite());
        let max_nodes = max_nodes.max(1000) as f64;
        let (lo, hi) = region.bounds();
        let extent = hi - lo;
        let nodes = |h: f64| (extent / h).ceil() + DVec3::splat(2.0 * MARGIN + 1.0);
        let (h, _) = enlarged_cell(spacing, 1.05, max_nodes, nodes);
        let cells = (extent / h).ceil();
        let size = [cells.x, cells.y, cells.z].map(|n| (n + 2.0 * MARGIN) as usize + 1);
        let origin = (lo + hi) / 2.0 - (cells / 2.0 + MARGIN) * h;
        // Without a surface all around, a side is not known by the distance.
        let far = (!region.is_open()).then(|| {
            let size = size.map(|n| (n - 1).div_ceil(COARSER) + 1);
            let far = DistanceGrid { origin, spacing: h * COARSER as f64, size, values: Vec::new(), capped: false };
            far.filled(region, |_, _| None)
        });
        let grid = DistanceGrid { origin, spacing: h, size, values: Vec::new(), capped: h > spacing };
        grid.filled(region, |p, [x, y, z]| {
            let far = far.as_ref()?;
            let near = [x, y, z].map(|n| (n + COARSER / 2) / COARSER);
            let value = far.values[(near[2] * far.size[1] + near[1]) * far.size[0] + near[0]];
            let node = origin + DVec3::from_array(near.map(|n| n as f64)) * far.spacing;
            let is_exact = value.abs() - p.distance(node) <= exact[usize::from(value > 0.0)];
            (!is_exact).then(|| far.interpolate((p - origin) / far.spacing))
        })
    }

    /// With values for its nodes. `known`: the value of a node, by its place and its numbers, where it is not needed
    /// exactly.
    fn filled(
        mut self,
        region: &MeshInterior,
        known: impl Fn(DVec3, [usize; 3]) -> Option<f64> + Sync,
    ) -> DistanceGrid {
        let (origin, [nx, ny, nz], h) = (self.origin, self.size, self.spacing);
        self.values = vec![0.0; nx * ny * nz];
        self.values.par_chunks_mut(nx).enumerate().for_each(|(row, values)| {
            let (y, z) = (row % ny, row / ny);
            let start = origin + DVec3::new(0.0, y as f64, z as f64) * h;
            fill_row(region, start, h, values, |p, x| known(p, [x, y, z]));
        });
        self
    }

    /// Removes the inside of `other`, a grid around the same place, from the region.
    pub fn cut_out(&mut self, other: &DistanceGrid) {
        let [nx, ny, _] = self.size;
        let (origin, spacing) = (self.origin, self.spacing);
        self.values.par_iter_mut().enumerate().for_each(|(i, value)| {
            let node = DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / nx / ny) as f64);
            *value = value.max(-other.signed_distance(origin + node * spacing));
        });
    }

    /// Removes the inside of a region from this one. The region's points are those of the grid times `scale`, plus
    /// `origin`. Nodes that are farther outside than `reach` stay as they are.
    pub fn cut_out_region(&mut self, region: &MeshInterior, (scale, origin): (f64, DVec3), reach: f64) {
        let ([nx, ny, _], first, h) = (self.size, self.origin, self.spacing);
        self.values.par_chunks_mut(nx).enumerate().for_each(|(row, values)| {
            if values.iter().all(|value| *value > reach) {
                return;
            }
            let start = first + DVec3::new(0.0, (row % ny) as f64, (row / ny) as f64) * h;
            let mut cut = vec![0.0; nx];
            fill_row(region, start * scale + origin, h * scale, &mut cut, |_, _| None);
            values.iter_mut().zip(cut).for_each(|(value, cut)| *value = value.max(-cut / scale));
        });
    }

    /// Removes the places that no ball of this radius reaches, although one would in `before`: the same grid before
    /// something was cut out. Narrow places that it had already stay.
    pub fn remove_narrow(&mut self, before: &DistanceGrid, radius: f64) {
        let (now, then) = (self.reached(radius), before.reached(radius));
        let nodes = self.values.iter_mut().zip(now.into_iter().zip(then));
        let narrow = nodes.filter(|(value, (now, then))| **value <= 0.0 && !now && *then);
        narrow.for_each(|(value, _)| *value = f64::MIN_POSITIVE.max(-*value));
    }

    /// The nodes that a ball of this radius inside the region reaches.
    fn reached(&self, radius: f64) -> Vec<bool> {
        let size = self.size.map(|n| n as i64);
        let cells = (radius / self.spacing).ceil() as i64;
        let index = |[x, y, z]: [i64; 3]| ((z * size[1] + y) * size[0] + x) as usize;
        let is_reached = |i: usize| {
            let value = self.values[i];
            if value > 0.0 || value <= -radius {
                return value <= 0.0;
            }
            let at =
                [i % self.size[0], i / self.size[0] % self.size[1], i / self.size[0] / self.size[1]].map(|n| n as i64);
            let range = |k: usize| (at[k] - cells).max(0)..(at[k] + cells + 1).min(size[k]);
            // Half a cell more: the middle of the ball need not be a node.
            let reach = radius / self.spacing + 0.5;
            let is_near = |p: [i64; 3]| (0..3).map(|k| ((p[k] - at[k]) as f64).powi(2)).sum::<f64>() <= reach * reach;
            let half = self.spacing / 2.0;
            range(2).any(|z| {
                range(1).any(|y| range(0).any(|x| is_near([x, y, z]) && self.values[index([x, y, z])] <= half - radius))
            })
        };
        (0..self.values.len()).into_par_iter().map(is_reached).collect()
    }

    /// Raises the values of nodes that are no farther outside than `reach`, column by column along Y. `of`: the new
    /// values of a column, from its foot and its old values.
    pub fn raise_columns(&mut self, reach: f64, of: impl Fn(DVec3, &[f64]) -> Vec<f64> + Sync) {
        let ([nx, ny, nz], first, h) = (self.size, self.origin, self.spacing);
        let values = &self.values;
        let raised = |i: usize| {
            let (x, z) = (i % nx, i / nx);
            let column: Vec<f64> = (0..ny).map(|y| values[(z * ny + y) * nx + x]).collect();
            if column.iter().all(|value| *value > reach) {
                return None;
            }
            Some((x, z, of(first + DVec3::new(x as f64, 0.0, z as f64) * h, &column)))
        };
        let raised: Vec<_> = (0..nx * nz).into_par_iter().filter_map(raised).collect();
        for (x, z, column) in raised {
            for (y, value) in column.into_iter().enumerate() {
                let at = (z * ny + y) * nx + x;
                self.values[at] = self.values[at].max(value);
            }
        }
    }

    /// The first node, the nodes along X, Y, Z, and the values, shape `[z][y][x]`, metres.
    pub fn nodes(&self) -> (DVec3, [usize; 3], &[f64]) {
        (self.origin, self.size, &self.values)
    }

    /// Metres between nodes.
    pub fn spacing(&self) -> f64 {
        self.spacing
    }

    /// Whether the spacing is coarser than asked for, because of the limit on nodes.
    pub fn capped(&self) -> bool {
        self.capped
    }

    /// Signed distance, metres, negative inside. Beyond the grid, the distance to the grid's box is added.
    pub fn signed_distance(&self, p: DVec3) -> f64 {
        let (near, beyond) = self.clamp(p);
        self.interpolate(near) + beyond.length() * self.spacing
    }

    /// The direction in which the distance grows, outward from the region; its length is about 1, and smaller
    /// where surfaces on several sides are equally near.
    pub fn gradient(&self, p: DVec3) -> DVec3 {
        let (near, beyond) = self.clamp(p);
        if beyond.length_squared() > 0.0 {
            return beyond.normalize();
        }
        let slope = |axis: DVec3| self.interpolate(near + axis / 2.0) - self.interpolate(near - axis / 2.0);
        DVec3::from_array(DVec3::AXES.map(slope)) / self.spacing
    }

    /// The point in cells from the origin, moved into the grid, and the distance by which it was moved.
    fn clamp(&self, p: DVec3) -> (DVec3, DVec3) {
        let cells = (p - self.origin) / self.spacing;
        let last = DVec3::from_array(self.size.map(|n| (n - 1) as f64));
        let near = cells.clamp(DVec3::ZERO, last);
        (near, cells - near)
    }

    /// `cells` from the origin; clamped to the grid.
    fn interpolate(&self, cells: DVec3) -> f64 {
        let last = DVec3::from_array(self.size.map(|n| (n - 2) as f64));
        let low = cells.floor().clamp(DVec3::ZERO, last);
        let t = (cells - low).clamp(DVec3::ZERO, DVec3::ONE);
        let [nx, ny, _] = self.size;
        let at = (low.z as usize * ny + low.y as usize) * nx + low.x as usize;
        let lerp = |a: f64, b: f64, t: f64| a + (b - a) * t;
        let along_x = |at: usize| lerp(self.values[at], self.values[at + 1], t.x);
        let along_y = |at: usize| lerp(along_x(at), along_x(at + nx), t.y);
        lerp(along_y(at), along_y(at + nx * ny), t.z)
    }
}

/// One row along X. The neighbour's triangle is a good first guess, and two nodes are on the same side when the
/// surface is farther than the step between them: most nodes need neither a full search nor a winding number. `known`:
/// values that are not looked for.
fn fill_row(
    region: &MeshInterior,
    start: DVec3,
    h: f64,
    values: &mut [f64],
    known: impl Fn(DVec3, usize) -> Option<f64>,
) {
    let mut guess = 0;
    let mut last: Option<f64> = None;
    for (x, value) in values.iter_mut().enumerate() {
        let p = start + DVec3::X * (x as f64 * h);
        *value = known(p, x).unwrap_or_else(|| {
            let (distance, place) = region.distance_near(p, guess);
            guess = place;
            let inside = match last {
                Some(v) if v.abs() > h && !region.is_open() => v < 0.0,
                _ => region.contains(p),
            };
            if inside { -distance } else { distance }
        });
        last = Some(*value);
    }
}
