//! Pictures of triangles in parallel projection: silhouettes from the side, heights from above.

use glam::DVec2;
use std::ops::Range;

/// A rectangle of square pixels; pixel `[i, j]` has its centre at `lo + (i + 1/2, j + 1/2) pixel`.
#[derive(Clone, Copy, Debug)]
pub(super) struct PixelGrid {
    pub lo: DVec2,
    /// Metres.
    pub pixel: f64,
    pub width: usize,
    pub height: usize,
}

impl PixelGrid {
    /// The pixels of the given size that cover a rectangle.
    pub fn covering(lo: DVec2, hi: DVec2, pixel: f64) -> PixelGrid {
        let count = ((hi - lo) / pixel).ceil().max(DVec2::ONE);
        PixelGrid { lo, pixel, width: count.x as usize, height: count.y as usize }
    }

    pub fn len(&self) -> usize {
        self.width * self.height
    }

    /// Calls `visit(index, point)` for every pixel of the grid whose centre lies in the triangle.
    pub fn cover(&self, triangle: [DVec2; 3], mut visit: impl FnMut(usize, DVec2)) {
        self.rows(triangle, |j, columns| {
            for i in columns {
                let centre = self.lo + (DVec2::new(i as f64, j as f64) + 0.5) * self.pixel;
                visit(j * self.width + i, centre);
            }
        });
    }

    /// Calls `visit(indices)` for the pixels of each row whose centres lie in the triangle.
    pub fn spans(&self, triangle: [DVec2; 3], mut visit: impl FnMut(Range<usize>)) {
        self.rows(triangle, |j, columns| visit(j * self.width + columns.start..j * self.width + columns.end));
    }

    /// Calls `visit(row, columns)` for the pixels of each row whose centres lie in the triangle.
    fn rows(&self, triangle: [DVec2; 3], mut visit: impl FnMut(usize, Range<usize>)) {
        let [a, b, c] = triangle.map(|p| (p - self.lo) / self.pixel - 0.5);
        let (lo, hi) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
        let rows = steps(lo, hi, self.height);
        // Most triangles of a fine mesh lie between pixel centres.
        if rows.is_empty() || steps(a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x), self.width).is_empty() {
            return;
        }
        for j in rows {
            let y = j as f64;
            let mut span = (f64::INFINITY, f64::NEG_INFINITY);
            for (p, q) in [(a, b), (b, c), (c, a)] {
                if (p.y <= y) != (q.y <= y) {
                    let x = p.x + (q.x - p.x) * ((y - p.y) / (q.y - p.y));
                    span = (span.0.min(x), span.1.max(x));
                }
            }
            visit(j, steps(span.0, span.1, self.width));
        }
    }
}

/// The whole numbers from `lo` to `hi` that are below `n`.
fn steps(lo: f64, hi: f64, n: usize) -> Range<usize> {
    let first = lo.ceil().max(0.0);
    let end = (hi.floor() + 1.0).min(n as f64);
    if first < end { first as usize..end as usize } else { 0..0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_that_share_an_edge_leave_no_crack() {
        let frame = PixelGrid::covering(DVec2::ZERO, DVec2::splat(10.0), 0.1);
        let corners = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0), (3.7, 6.1)].map(|(x, y)| DVec2::new(x, y));
        let mut hits = vec![0; frame.len()];
        for k in 0..4 {
            frame.cover([corners[k], corners[(k + 1) % 4], corners[4]], |i, _| hits[i] += 1);
        }
        assert!(hits.iter().all(|&h| h >= 1));
        assert_eq!(frame.len(), 10_000);
    }

    #[test]
    fn pixels_outside_are_left_out() {
        let frame = PixelGrid::covering(DVec2::ZERO, DVec2::ONE, 0.25);
        let mut count = 0;
        frame.cover([DVec2::new(-9.0, -9.0), DVec2::new(9.0, -9.0), DVec2::new(0.0, 30.0)], |_, _| count += 1);
        assert_eq!(count, 16);
        frame.cover([DVec2::new(5.0, 0.0), DVec2::new(9.0, 0.0), DVec2::new(5.0, 3.0)], |_, _| count += 1);
        assert_eq!(count, 16);
    }
}
