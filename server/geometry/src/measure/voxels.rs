//! Cubic cells on a lattice, and closing by an exact Euclidean distance transform.

use crate::TOLERANCE;
use glam::DVec3;
use rayon::prelude::*;

/// Cells of one size; cell `[i, j, k]` has its centre at `origin + (i + 1/2, j + 1/2, k + 1/2) cell`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lattice {
    pub origin: DVec3,
    /// Metres.
    pub cell: f64,
}

impl Lattice {
    /// The cell that holds a point; far points saturate.
    pub fn cell_of(&self, p: DVec3) -> [i64; 3] {
        ((p - self.origin) / self.cell).floor().to_array().map(|x| x as i64)
    }

    pub fn centre(&self, [x, y, z]: [i64; 3]) -> DVec3 {
        self.origin + (DVec3::new(x as f64, y as f64, z as f64) + 0.5) * self.cell
    }
}

/// A box of lattice cells, each full (1) or empty (0).
#[derive(Clone, Debug)]
pub(super) struct CellBlock {
    /// The first cell.
    pub lo: [i64; 3],
    /// Cells along X, Y, Z.
    pub size: [usize; 3],
    /// Shape `[z][y][x]`.
    pub cells: Vec<u8>,
}

impl CellBlock {
    /// The empty block of the cells from `lo` up to but without `hi`.
    pub fn new(lo: [i64; 3], hi: [i64; 3]) -> CellBlock {
        let size = [0, 1, 2].map(|a| (hi[a] - lo[a]).max(0) as usize);
        CellBlock { lo, size, cells: vec![0; size.iter().product()] }
    }

    pub fn get(&self, at: [i64; 3]) -> bool {
        let [x, y, z] = [0, 1, 2].map(|a| at[a] - self.lo[a]);
        let inside = [x, y, z].iter().zip(self.size).all(|(&x, n)| x >= 0 && (x as usize) < n);
        inside && self.cells[(z as usize * self.size[1] + y as usize) * self.size[0] + x as usize] != 0
    }

    pub fn count(&self) -> usize {
        self.cells.iter().filter(|&&c| c != 0).count()
    }

    /// Calls `fill` on every row along X, with the first cell of the row; rows run in parallel.
    pub fn rows_mut(&mut self, fill: impl Fn([i64; 3], &mut [u8]) + Sync) {
        let ([nx, ny, _], [x, y, z]) = (self.size, self.lo);
        if nx == 0 {
            return;
        }
        let row = |(i, row): (usize, &mut [u8])| fill([x, y + (i % ny) as i64, z + (i / ny) as i64], row);
        self.cells.par_chunks_mut(nx).enumerate().for_each(row);
    }

    /// Cells full in both.
    pub fn common(&self, other: &CellBlock) -> usize {
        let [nx, ny, _] = self.size;
        let at = |i: usize| {
            let [x, y, z] = [i % nx, i / nx % ny, i / (nx * ny)].map(|x| x as i64);
            [self.lo[0] + x, self.lo[1] + y, self.lo[2] + z]
        };
        self.cells.par_iter().enumerate().filter(|(i, c)| **c != 0 && other.get(at(*i))).count()
    }

    /// Empties the cells that are empty in a block of the same cells.
    pub fn keep_common(&mut self, other: &CellBlock) {
        self.cells.iter_mut().zip(&other.cells).for_each(|(cell, other)| *cell &= other);
    }

    /// Empties the cells that are full in the other block.
    pub fn subtract(&mut self, other: &CellBlock) {
        self.rows_mut(|[x, y, z], row| {
            let full = |i: usize| other.get([x + i as i64, y, z]);
            row.iter_mut().enumerate().for_each(|(i, cell)| *cell &= u8::from(!full(i)));
        });
    }

    /// Fills the cells that are full in the other block.
    pub fn add(&mut self, other: &CellBlock) {
        self.rows_mut(|[x, y, z], row| {
            let full = |i: usize| other.get([x + i as i64, y, z]);
            row.iter_mut().enumerate().for_each(|(i, cell)| *cell |= u8::from(full(i)));
        });
    }

    /// The layers along Y, each with its middle, in cells, and how many of its cells are full.
    pub fn layers(&self) -> impl Iterator<Item = (f64, usize)> {
        let [nx, ny, _] = self.size;
        let mut counts = vec![0usize; ny];
        for (i, row) in self.cells.chunks(nx.max(1)).enumerate() {
            counts[i % ny] += row.iter().filter(|&&c| c != 0).count();
        }
        let low = self.lo[1];
        counts.into_iter().enumerate().map(move |(i, count)| ((low + i as i64) as f64 + 0.5, count))
    }

    /// Dilates by a ball of `radius` cells, then erodes by it: fills gaps narrower than the ball. The full cells must
    /// keep that far from the block's border.
    pub fn close(&mut self, radius: f64) {
        // Squares are whole numbers: one that rounding has put just below the radius's belongs to it.
        let square = (radius * radius * (1.0 + TOLERANCE)).min(f64::from(FAR - 1)) as i32;
        // Each transform returns the axes Y and Z swapped; two of them put things back.
        let [nx, ny, nz] = self.size;
        let dilated = distance_transform(&self.cells, self.size, 1);
        let dilated: Vec<u8> = dilated.into_par_iter().map(|d| (d <= square) as u8).collect();
        let eroded = distance_transform(&dilated, [nx, nz, ny], 0);
        self.cells.par_iter_mut().zip(eroded).for_each(|(cell, d)| *cell = (d > square) as u8);
    }
}

/// Farther than any distance within a block (squared, in cells), with room to add one.
const FAR: i32 = i32::MAX / 4;

/// Squared distance (cells) from each cell to the nearest one of the wanted value: Felzenszwalb & Huttenlocher,
/// "Distance transforms of sampled functions" (2012). Takes shape `[z][y][x]`, returns shape `[y][z][x]`.
fn distance_transform(cells: &[u8], [nx, ny, nz]: [usize; 3], wanted: u8) -> Vec<i32> {
    if cells.is_empty() {
        return Vec::new();
    }
    let mut planes = vec![FAR; cells.len()];
    planes.par_chunks_mut(nx * ny).zip(cells.par_chunks(nx * ny)).for_each(|(out, cells)| {
        for (out, row) in out.chunks_mut(nx).zip(cells.chunks(nx)) {
            along_row(row, wanted, out);
        }
        let mut scratch = LowerEnvelope::new(ny);
        for x in 0..nx {
            scratch.column(ny, |y| out[y * nx + x]);
            for y in 0..ny {
                out[y * nx + x] = scratch.result[y];
            }
        }
    });
    let mut turned = vec![FAR; cells.len()];
    turned.par_chunks_mut(nx * nz).enumerate().for_each(|(y, out)| {
        let mut scratch = LowerEnvelope::new(nz);
        for x in 0..nx {
            scratch.column(nz, |z| planes[(z * ny + y) * nx + x]);
            for z in 0..nz {
                out[z * nx + x] = scratch.result[z];
            }
        }
    });
    turned
}

/// Squared distance along a row to the nearest wanted cell.
fn along_row(row: &[u8], wanted: u8, out: &mut [i32]) {
    // A row is shorter than 2^14 cells or so (blocks are capped): its square fits.
    let mut sweep = |order: &mut dyn Iterator<Item = usize>| {
        let mut steps = FAR;
        for x in order {
            steps = if row[x] == wanted { 0 } else { steps.saturating_add(1) };
            out[x] = out[x].min(steps.saturating_mul(steps)).min(FAR);
        }
    };
    sweep(&mut (0..row.len()));
    sweep(&mut (0..row.len()).rev());
}

/// Buffers for the lower envelope of parabolas over a column.
struct LowerEnvelope {
    values: Vec<i32>,
    result: Vec<i32>,
    /// Places of the parabolas in the envelope, and where each takes over.
    places: Vec<usize>,
    starts: Vec<f64>,
}

impl LowerEnvelope {
    fn new(n: usize) -> LowerEnvelope {
        LowerEnvelope { values: vec![0; n], result: vec![0; n], places: vec![0; n], starts: vec![0.0; n + 1] }
    }

    /// `result[q]` = min over p of value(p) + (q - p)^2.
    fn column(&mut self, n: usize, value: impl Fn(usize) -> i32) {
        let mut any = false;
        for q in 0..n {
            self.values[q] = value(q);
            any |= self.values[q] < FAR;
        }
        if !any {
            self.result[..n].fill(FAR);
            return;
        }
        let f = |q: usize| self.values[q] as f64 + (q * q) as f64;
        let mut top: Option<usize> = None;
        for q in (0..n).filter(|&q| self.values[q] < FAR) {
            let mut start = f64::NEG_INFINITY;
            while let Some(t) = top {
                let p = self.places[t];
                start = (f(q) - f(p)) / (2.0 * (q - p) as f64);
                if start > self.starts[t] {
                    break;
                }
                top = t.checked_sub(1);
                start = f64::NEG_INFINITY;
            }
            let next = top.map_or(0, |t| t + 1);
            self.places[next] = q;
            self.starts[next] = start;
            top = Some(next);
        }
        let last = top.unwrap_or(0);
        self.starts[last + 1] = f64::INFINITY;
        let mut at = 0;
        for q in 0..n {
            while self.starts[at + 1] < q as f64 {
                at += 1;
            }
            let p = self.places[at];
            let step = q.abs_diff(p) as i32;
            self.result[q] = (self.values[p] + step * step).min(FAR);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_transform_is_exact() {
        let size = [9, 7, 8];
        let [nx, ny, nz] = size;
        let full = |i: usize| ((i * 2654435761) >> 7).is_multiple_of(29);
        let cells: Vec<u8> = (0..nx * ny * nz).map(|i| full(i) as u8).collect();
        let at = |i: usize| [i % nx, i / nx % ny, i / (nx * ny)].map(|x| x as i32);
        let transformed = distance_transform(&cells, size, 1);
        for i in 0..cells.len() {
            let [x, y, z] = at(i);
            let square = |j: usize| at(j).iter().zip([x, y, z]).map(|(a, b)| (a - b) * (a - b)).sum::<i32>();
            let exact = (0..cells.len()).filter(|&j| cells[j] == 1).map(square).min().unwrap();
            assert_eq!(transformed[(y as usize * nz + z as usize) * nx + x as usize], exact);
        }
    }

    #[test]
    fn closing_fills_narrow_gaps_only() {
        let mut block = CellBlock::new([0; 3], [40, 20, 20]);
        block.rows_mut(|[_, y, z], row| {
            if (6..14).contains(&y) && (6..14).contains(&z) {
                row.iter_mut().enumerate().for_each(|(x, c)| {
                    *c = matches!(x, 6..12 | 14..20 | 30..34) as u8;
                });
            }
        });
        let before = block.count();
        block.close(3.0);
        assert!(block.get([12, 9, 9]) && block.get([13, 9, 9]) && !block.get([25, 9, 9]) && !block.get([12, 5, 9]));
        // The two layers of the gap, less a rim of at most one cell into which the ball dips from outside.
        assert!((before + 2 * 6 * 6..=before + 2 * 8 * 8).contains(&block.count()));
    }

    #[test]
    fn an_empty_block_closes_to_nothing() {
        let mut block = CellBlock::new([0; 3], [5, 5, 5]);
        block.close(2.0);
        assert_eq!(block.count(), 0);
        CellBlock::new([0; 3], [0, 5, 5]).close(2.0);
    }
}
