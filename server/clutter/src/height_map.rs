//! How high each surface of a place stands with the bodies that were put down so far, cell by cell: where there is room
//! for another one is looked up, not guessed. SI.
//!
//! A body counts as what is below its outline, seen from above, up to its highest point: no two of them overlap.

use crate::surfaces::Surfaces;
use cairn_geometry::rectangle::convex_hull;
use glam::{DVec2, DVec3};

/// Largest edge of a cell, in the median prop's diameter.
const FINE: f64 = 0.1;

/// The cells of all surfaces of a place.
pub struct HeightMap {
    origin: [f64; 2],
    cell: f64,
    size: [usize; 2],
    /// Of the place and the bodies; infinite where no body may be. Shape `[surface][z][x]`.
    tops: Vec<Vec<f64>>,
    /// Of the place.
    floors: Vec<Vec<f64>>,
    ceilings: Vec<Vec<f64>>,
    /// The lowest floor of each surface.
    lowest: Vec<f64>,
}

/// The cells below a body, from that of its place on: each row's first and last.
pub struct Outline {
    /// Row, first column, last column.
    rows: Vec<(i64, i64, i64)>,
    /// From the lowest to the highest corner.
    height: f64,
    /// Of the body's place in its cell, in cells.
    within: [f64; 2],
}

/// A place where a body may begin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    pub surface: usize,
    /// Its cell: x, z.
    cell: [usize; 2],
    /// Height on which the body begins.
    pub bottom: f64,
    /// The same above the lowest floor of the surface.
    pub above: f64,
    /// Whether there is no other body below it.
    pub is_free: bool,
}

impl HeightMap {
    /// `diameter`: the median prop's. `aside`: distance of bodies from the edges of a surface.
    pub fn new(surfaces: &Surfaces, diameter: f64, aside: f64) -> HeightMap {
        let parts = (surfaces.cell / (FINE * diameter)).ceil().max(1.0) as usize;
        let cell = surfaces.cell / parts as f64;
        let size = surfaces.size.map(|count| count * parts);
        let reach = (aside / cell).ceil() as usize;
        let count = size[0] * size[1];
        let mut map = HeightMap {
            origin: surfaces.origin,
            cell,
            size,
            tops: Vec::new(),
            floors: Vec::new(),
            ceilings: Vec::new(),
            lowest: Vec::new(),
        };
        for surface in 0..surfaces.cells.len() {
            let (mut floors, mut ceilings) = (vec![f64::INFINITY; count], vec![f64::INFINITY; count]);
            for i in 0..count {
                let line = i / size[0] / parts * surfaces.size[0] + i % size[0] / parts;
                if let Some((low, high)) = surfaces.stretch(surface, line) {
                    (floors[i], ceilings[i]) = (low, high);
                }
            }
            map.lowest.push(floors.iter().copied().fold(f64::INFINITY, f64::min));
            let narrower = map.away_from_edges(&floors, reach);
            map.tops.push(narrower.clone());
            map.floors.push(narrower);
            map.ceilings.push(ceilings);
        }
        map
    }

    /// Closes cells that are near an edge or a closed one.
    fn away_from_edges(&self, floors: &[f64], reach: usize) -> Vec<f64> {
        let [width, depth] = self.size;
        let near = |at: usize, count: usize| at >= reach && at + reach < count;
        let mut along = floors.to_vec();
        for (i, floor) in along.iter_mut().enumerate() {
            let x = i % width;
            if !near(x, width) || (i - reach..=i + reach).any(|other| floors[other].is_infinite()) {
                *floor = f64::INFINITY;
            }
        }
        let mut both = along.clone();
        for (i, floor) in both.iter_mut().enumerate() {
            let z = i / width;
            let is_open = near(z, depth) && (z - reach..=z + reach).all(|z| along[z * width + i % width].is_finite());
            if !is_open {
                *floor = f64::INFINITY;
            }
        }
        both
    }

    /// The cells below a body at rotation and scale. `corners`: about its place. `within`: of that in its cell, from 0
    /// to 1.
    pub fn outline(&self, corners: &[DVec3], within: [f64; 2]) -> Outline {
        let (low, high) =
            corners.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p.y), high.max(p.y)));
        let at = |p: &DVec3| DVec2::new(p.x / self.cell + within[0], p.z / self.cell + within[1]);
        let hull = convex_hull(&corners.iter().map(at).collect::<Vec<_>>());
        let [first, last] = [f64::min, f64::max]
            .map(|pick: fn(f64, f64) -> f64| hull.iter().map(|p| p.y).reduce(pick).unwrap_or(0.0).floor() as i64);
        let row = |z: i64| {
            let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
            for (k, &a) in hull.iter().enumerate() {
                let b = hull[(k + 1) % hull.len()];
                for share in shares_in(a.y, b.y, z as f64) {
                    let x = a.x + share * (b.x - a.x);
                    (least, most) = (least.min(x), most.max(x));
                }
            }
            (z, least.floor() as i64, most.floor() as i64)
        };
        let rows = (first..=last).map(row).filter(|&(_, least, most)| least <= most).collect();
        Outline { rows, height: high - low, within }
    }

    /// Whether and how high a body may begin at a cell, lower than `limit` above its surface.
    fn look(&self, outline: &Outline, surface: usize, cell: [usize; 2], gap: f64, limit: f64) -> Option<Spot> {
        let limit = limit + self.lowest[surface] - gap;
        let (tops, floors, ceilings) = (&self.tops[surface], &self.floors[surface], &self.ceilings[surface]);
        let (mut top, mut ceiling, mut is_free) = (f64::NEG_INFINITY, f64::INFINITY, true);
        for &(row, first, last) in &outline.rows {
            let [z, first, last] = [cell[1] as i64 + row, cell[0] as i64 + first, cell[0] as i64 + last];
            if z < 0 || z >= self.size[1] as i64 || first < 0 || last >= self.size[0] as i64 {
                return None;
            }
            let start = z as usize * self.size[0];
            for i in start + first as usize..=start + last as usize {
                top = top.max(tops[i]);
                ceiling = ceiling.min(ceilings[i]);
                is_free &= tops[i] == floors[i];
            }
            if top >= limit || top == f64::INFINITY {
                return None;
            }
        }
        let bottom = top + gap;
        let above = bottom - self.lowest[surface];
        (bottom + outline.height <= ceiling).then_some(Spot { surface, cell, bottom, above, is_free })
    }

    /// The spot at a point of a surface, if the body has room there lower than `limit`.
    pub fn at(&self, outline: &Outline, surface: usize, [x, z]: [f64; 2], gap: f64, limit: f64) -> Option<Spot> {
        let cell = [x - self.origin[0], z - self.origin[1]].map(|way| way / self.cell);
        let is_inside = cell.iter().zip(self.size).all(|(at, count)| *at >= 0.0 && *at < count as f64);
        is_inside.then(|| cell.map(|at| at as usize)).and_then(|cell| self.look(outline, surface, cell, gap, limit))
    }

    /// The first spot without a body below it of all there are, in an order that begins at `first` and goes on by
    /// `stride`; where there is none, the lowest. `first`, `stride`: any numbers.
    pub fn search(&self, outline: &Outline, gap: f64, first: usize, stride: usize) -> Option<Spot> {
        let cells = self.size[0] * self.size[1];
        let all = cells * self.tops.len();
        let mut stride = stride % all.max(1);
        while common_divisor(stride, all) != 1 {
            stride += 1;
        }
        let mut best: Option<Spot> = None;
        let mut at = first % all.max(1);
        for _ in 0..all {
            let (surface, cell) = (at / cells, at % cells);
            // Most cells of a full surface end here.
            if self.tops[surface][cell].is_finite() {
                let limit = best.map_or(f64::INFINITY, |best| best.above);
                let found = self.look(outline, surface, [cell % self.size[0], cell / self.size[0]], gap, limit);
                best = found.or(best);
                if best.is_some_and(|best| best.is_free) {
                    return best;
                }
            }
            at = (at + stride) % all;
        }
        best
    }

    /// Closes the room below a body that is there. `corners`: about its place, `at`.
    pub fn keep(&mut self, corners: &[DVec3], surface: usize, at: DVec3) {
        let cell = [at.x - self.origin[0], at.z - self.origin[1]].map(|way| way / self.cell);
        let outline = self.outline(corners, cell.map(|at| at - at.floor()));
        let [x, z] = cell.map(|at| at.floor() as i64);
        let top = at.y + corners.iter().map(|corner| corner.y).fold(f64::NEG_INFINITY, f64::max);
        let [width, depth] = self.size.map(|count| count as i64);
        for &(row, first, last) in &outline.rows {
            let (row, first, last) = (z + row, (x + first).max(0), (x + last).min(width - 1));
            if (0..depth).contains(&row) && first <= last {
                let cells = (row * width + first) as usize..=(row * width + last) as usize;
                self.tops[surface][cells].iter_mut().for_each(|cell| *cell = cell.max(top));
            }
        }
    }

    /// Puts a body down, and returns where its place is: x, z.
    pub fn put(&mut self, outline: &Outline, spot: &Spot) -> [f64; 2] {
        let top = spot.bottom + outline.height;
        for &(row, first, last) in &outline.rows {
            let start = (spot.cell[1] as i64 + row) as usize * self.size[0];
            let [first, last] = [first, last].map(|column| start + (spot.cell[0] as i64 + column) as usize);
            self.tops[spot.surface][first..=last].iter_mut().for_each(|cell| *cell = cell.max(top));
        }
        [0, 1].map(|axis| self.origin[axis] + (spot.cell[axis] as f64 + outline.within[axis]) * self.cell)
    }
}

/// Shares of the way from `a` to `b` that are in the row `[z, z + 1]`: its ends there.
fn shares_in(a: f64, b: f64, z: f64) -> impl Iterator<Item = f64> {
    let [enters, leaves] = match b - a {
        0.0 if (z..=z + 1.0).contains(&a) => [0.0, 1.0],
        0.0 => [1.0, 0.0],
        way => {
            let [one, other] = [(z - a) / way, (z + 1.0 - a) / way];
            [one.min(other).max(0.0), one.max(other).min(1.0)]
        }
    };
    let ends = if enters <= leaves { vec![enters, leaves] } else { Vec::new() };
    ends.into_iter()
}

fn common_divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { common_divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_engine::shape::hull_mesh;
    use cairn_geometry::mesh::TriMesh;
    use cairn_input::scene::{Model, StaticModel};

    fn block(low: DVec3, high: DVec3) -> Vec<DVec3> {
        (0..8).map(|i| DVec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), high, low)).collect()
    }

    /// Boards of 1 m with their upper sides at these heights, m.
    fn boards(tops: &[f64]) -> Surfaces {
        let mut mesh = TriMesh::default();
        for &top in tops {
            mesh.append(&hull_mesh(&block(DVec3::new(0.0, top - 0.02, 0.0), DVec3::new(1.0, top, 1.0))));
        }
        Surfaces::new(&StaticModel { model: Model::new("boards", mesh), friction: 0.7, keys: Vec::new() }, 0.01)
    }

    fn cube(edge: f64) -> Vec<DVec3> {
        block(DVec3::splat(-edge / 2.0), DVec3::splat(edge / 2.0))
    }

    #[test]
    fn bodies_lie_side_by_side_while_there_is_room() {
        let surfaces = boards(&[0.1]);
        let mut map = HeightMap::new(&surfaces, 0.2, 0.0);
        let mut places: Vec<[f64; 2]> = Vec::new();
        let spot = loop {
            let outline = map.outline(&cube(0.19), [0.3, 0.6]);
            let n = places.len();
            let spot = map.search(&outline, 0.001, 7919 * n, 104_729 * n).unwrap();
            if !spot.is_free {
                break spot;
            }
            assert!((spot.bottom - 0.101).abs() < 1e-6, "{spot:?}");
            places.push(map.put(&outline, &spot));
        };
        // At random, about half of the area is covered before there is no room.
        assert!((10..=25).contains(&places.len()), "{}", places.len());
        for (k, one) in places.iter().enumerate() {
            assert!(one.iter().all(|at| (0.0949..=0.9051).contains(at)), "{one:?} is beyond the edge");
            for other in &places[k + 1..] {
                let apart = (one[0] - other[0]).abs().max((one[1] - other[1]).abs());
                assert!(apart > 0.189_999, "{one:?} {other:?}");
            }
        }
        assert!((spot.bottom - (0.101 + 0.19 + 0.001)).abs() < 1e-6, "on another: {spot:?}");
        assert!(map.search(&map.outline(&cube(1.1), [0.5; 2]), 0.001, 0, 1).is_none(), "larger than the board");
    }

    #[test]
    fn ceilings_and_edges_bound_where_a_body_begins() {
        let surfaces = boards(&[0.1, 0.4]);
        let map = HeightMap::new(&surfaces, 0.2, 0.1);
        for k in 0..40 {
            let high = map.search(&map.outline(&cube(0.35), [0.5; 2]), 0.001, 991 * k, 7).unwrap();
            assert!(high.bottom > 0.4, "it does not fit below the upper board: {high:?}");
            let outline = map.outline(&cube(0.2), [0.5; 2]);
            let mut copy = HeightMap::new(&surfaces, 0.2, 0.1);
            let place = copy.put(&outline, &map.search(&outline, 0.001, 991 * k, 7).unwrap());
            assert!(place.iter().all(|at| (0.2..=0.8).contains(at)), "{place:?} is too near an edge");
        }
    }
}
