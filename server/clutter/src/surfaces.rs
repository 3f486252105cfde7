//! The surfaces of a place on which bodies may begin: the bottom of a bin, the boards of a shelf, the top of a table.
//!
//! Vertical lines through a grid are asked for the gaps between scenery; gaps whose floors join are one surface. SI.

use cairn_engine::shape::hull_mesh;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::topology::DisjointSets;
use cairn_input::scene::{Scene, StaticModel};
use cairn_prepare::surroundings::Surroundings;
use glam::DVec3;
use rayon::prelude::*;

/// Lines along the longer side of a place. The walls of a bin are a thirtieth of its width and more.
const LINES: f64 = 96.0;
/// Floors of neighboring lines join up to this slope; a wall is steeper, a bowl is not.
const SLOPE: f64 = 2.0;
/// A surface of less than this share of the largest one's area is a rim, a rung or a handle.
const LEAST_SHARE: f64 = 0.2;
/// A center of mass may be below its floor by this many lines: a floor of a grid is as exact as its slope.
const BELOW: f64 = 1.0;

/// A place has walls if more than this share of the edges of its surfaces has one.
const WALLED: f64 = 0.9;

/// A gap above a floor.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    low: f64,
    high: f64,
    surface: usize,
}

/// Where bodies may begin.
pub struct Surfaces {
    /// Lowest corner: x, z.
    pub origin: [f64; 2],
    /// Edge of a line's cell.
    pub cell: f64,
    /// Lines along x and z.
    pub size: [usize; 2],
    /// Shape `[z][x]`.
    lines: Vec<Vec<Stretch>>,
    /// The lines of each surface.
    pub cells: Vec<Vec<usize>>,
    /// Lowest and highest corner of the place, m.
    pub bounds: (DVec3, DVec3),
    /// Height of the lowest floor, m: a body below it has left the place.
    pub lowest: f64,
    /// Whether walls keep bodies in nearly all around.
    pub has_walls: bool,
    /// `None`: no room is near it.
    around: Option<Surroundings>,
}

impl Surfaces {
    /// `clearance`: least height of a gap, m: the thinnest prop's.
    pub fn new(place: &StaticModel, clearance: f64) -> Surfaces {
        let (low, high) = place.model.mesh.bounds();
        let extent = high - low;
        let longest = extent.x.max(extent.z);
        let cell = longest / LINES;
        let size = [extent.x, extent.z].map(|side| ((side / cell).ceil() as usize).max(1));
        let scene = Scene { statics: vec![place.clone()], ..Scene::default() };
        let margin = DVec3::new(cell, extent.max_element(), cell);
        let around = Surroundings::new(&scene, &block(low - margin, high + margin), None);
        let gaps = |i: usize| {
            let p = DVec3::new(
                low.x + (0.5 + (i % size[0]) as f64) * cell,
                0.0,
                low.z + (0.5 + (i / size[0]) as f64) * cell,
            );
            let gaps = around.as_ref().map(|around| around.gaps(p)).unwrap_or_default();
            let is_free = |gap: &cairn_prepare::surroundings::Gap| {
                !gap.taken && gap.low.is_finite() && gap.high - gap.low >= clearance
            };
            gaps.into_iter().filter(is_free).map(|gap| Stretch { low: gap.low, high: gap.high, surface: 0 }).collect()
        };
        let lines = (0..size[0] * size[1]).into_par_iter().map(gaps).collect();
        let mut surfaces = Surfaces {
            origin: [low.x, low.z],
            cell,
            size,
            lines,
            cells: Vec::new(),
            bounds: (low, high),
            lowest: low.y,
            has_walls: false,
            around,
        };
        surfaces.join();
        surfaces.has_walls = surfaces.walled() > WALLED;
        let floors = surfaces.lines.iter().flatten().map(|stretch| stretch.low);
        surfaces.lowest = floors.fold(f64::INFINITY, f64::min);
        surfaces
    }

    /// Gives each stretch its surface, and leaves out those of small ones.
    fn join(&mut self) {
        let first: Vec<usize> = (self.lines.iter())
            .scan(0, |sum, line| {
                let first = *sum;
                *sum += line.len();
                Some(first)
            })
            .collect();
        let count = self.lines.iter().map(Vec::len).sum();
        let mut sets = DisjointSets::new(count);
        let steep = SLOPE * self.cell;
        for i in 0..self.lines.len() {
            let right = (i % self.size[0] + 1 < self.size[0]).then_some(i + 1);
            let next = (i + self.size[0] < self.lines.len()).then_some(i + self.size[0]);
            for other in right.into_iter().chain(next) {
                for (a, one) in self.lines[i].iter().enumerate() {
                    for (b, another) in self.lines[other].iter().enumerate() {
                        if (one.low - another.low).abs() <= steep {
                            sets.join(first[i] + a, first[other] + b);
                        }
                    }
                }
            }
        }
        let mut areas = vec![0usize; count];
        (0..count).for_each(|k| areas[sets.find(k)] += 1);
        let largest = areas.iter().copied().max().unwrap_or(0) as f64;
        let mut names = vec![None; count];
        for (i, &first) in first.iter().enumerate() {
            let mut kept = Vec::new();
            for (a, stretch) in self.lines[i].iter().enumerate() {
                let set = sets.find(first + a);
                if (areas[set] as f64) < LEAST_SHARE * largest {
                    continue;
                }
                let surface = *names[set].get_or_insert_with(|| {
                    self.cells.push(Vec::new());
                    self.cells.len() - 1
                });
                self.cells[surface].push(i);
                kept.push(Stretch { surface, ..*stretch });
            }
            self.lines[i] = kept;
        }
    }

    /// Share of the edges of the surfaces beyond which there is something higher.
    fn walled(&self) -> f64 {
        let (mut edges, mut walls) = (0, 0);
        for (surface, cells) in self.cells.iter().enumerate() {
            for &line in cells {
                let own = self.lines[line].iter().find(|stretch| stretch.surface == surface).map_or(0.0, |own| own.low);
                let [x, z] = [(line % self.size[0]) as i64, (line / self.size[0]) as i64];
                for [dx, dz] in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
                    let [x, z] = [x + dx, z + dz];
                    let is_inside = (0..self.size[0] as i64).contains(&x) && (0..self.size[1] as i64).contains(&z);
                    let other = if is_inside { &self.lines[(z as usize) * self.size[0] + x as usize][..] } else { &[] };
                    if other.iter().any(|stretch| stretch.surface == surface) {
                        continue;
                    }
                    edges += 1;
                    let (corner, edge) = self.corner(line);
                    let [x, z] = [corner[0] + edge * (0.5 + dx as f64), corner[1] + edge * (0.5 + dz as f64)];
                    let above = own + 2.0 * edge;
                    let from = DVec3::new(corner[0] + edge / 2.0, above, corner[1] + edge / 2.0);
                    walls += i32::from(self.is_between(from, DVec3::new(x, above, z)));
                }
            }
        }
        f64::from(walls) / f64::from(edges.max(1))
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// m^2.
    pub fn area(&self, surface: usize) -> f64 {
        self.cells[surface].len() as f64 * self.cell * self.cell
    }

    /// A corner of a line's cell, and the cell's edge: x, z.
    pub fn corner(&self, line: usize) -> ([f64; 2], f64) {
        let [x, z] = [line % self.size[0], line / self.size[0]].map(|n| n as f64 * self.cell);
        ([self.origin[0] + x, self.origin[1] + z], self.cell)
    }

    /// Mean of a surface's lines: x, z.
    pub fn middle(&self, surface: usize) -> [f64; 2] {
        let cells = &self.cells[surface];
        let sum = cells.iter().fold([0.0; 2], |sum, &line| {
            let (corner, _) = self.corner(line);
            [sum[0] + corner[0], sum[1] + corner[1]]
        });
        sum.map(|s| s / cells.len().max(1) as f64 + self.cell / 2.0)
    }

    /// Floor and ceiling of a surface at a line.
    pub fn stretch(&self, surface: usize, line: usize) -> Option<(f64, f64)> {
        let own = self.lines[line].iter().find(|stretch| stretch.surface == surface)?;
        Some((own.low, own.high))
    }

    /// Whether the place is between two points, or the first is in it.
    pub fn is_between(&self, from: DVec3, to: DVec3) -> bool {
        self.around.as_ref().is_some_and(|around| around.between(from, to).is_some() || around.is_solid_at(from))
    }

    /// Whether a point is above a surface and below what is over it.
    pub fn contains(&self, p: DVec3) -> bool {
        self.surface_below(p).is_some()
    }

    /// The surface above which a point is, below what is over it.
    pub fn surface_below(&self, p: DVec3) -> Option<usize> {
        let [x, z] = [(p.x - self.origin[0]) / self.cell, (p.z - self.origin[1]) / self.cell];
        let is_inside = x >= 0.0 && z >= 0.0 && x < self.size[0] as f64 && z < self.size[1] as f64;
        let line = is_inside.then(|| &self.lines[z as usize * self.size[0] + x as usize])?;
        let is_here = |stretch: &&Stretch| (stretch.low - BELOW * self.cell..=stretch.high).contains(&p.y);
        line.iter().find(is_here).map(|stretch| stretch.surface)
    }
}

/// A closed box between two corners.
fn block(low: DVec3, high: DVec3) -> TriMesh {
    let corner = |i: usize| DVec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), high, low);
    hull_mesh(&(0..8).map(corner).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_input::scene::Model;

    fn place(boxes: &[([f64; 3], [f64; 3])]) -> StaticModel {
        let mut mesh = TriMesh::default();
        boxes.iter().for_each(|(low, high)| mesh.append(&block(DVec3::from(*low), DVec3::from(*high))));
        StaticModel { model: Model::new("place", mesh), friction: 0.7, keys: Vec::new() }
    }

    #[test]
    fn a_shelf_has_a_surface_for_each_board() {
        let boards = [0.1, 0.5, 0.9].map(|y| ([0.0, y, 0.0], [1.0, y + 0.02, 0.3]));
        let sides = [0.0, 0.98].map(|x| ([x, 0.0, 0.0], [x + 0.02, 1.2, 0.3]));
        let surfaces = Surfaces::new(&place(&[&boards[..], &sides[..]].concat()), 0.05);
        assert_eq!(surfaces.cells.len(), 3);
        let room = surfaces.stretch(1, surfaces.cells[1][0]).unwrap();
        assert!((room.0 - 0.52).abs() < 1e-6 && (room.1 - 0.9).abs() < 1e-6, "{room:?}");
        assert_eq!(surfaces.stretch(1, 0), None, "a side of the shelf is there");
        assert!(!surfaces.has_walls);
        assert!(surfaces.contains(DVec3::new(0.5, 0.6, 0.1)) && !surfaces.contains(DVec3::new(0.5, 0.05, 0.1)));
        assert!((surfaces.area(0) - 0.29).abs() < 0.02, "{}", surfaces.area(0));
    }

    #[test]
    fn the_rim_of_a_bin_is_no_surface() {
        let walls = [
            ([0.0, 0.0, 0.0], [0.4, 0.01, 0.4]),
            ([0.0, 0.0, 0.0], [0.012, 0.2, 0.4]),
            ([0.388, 0.0, 0.0], [0.4, 0.2, 0.4]),
            ([0.0, 0.0, 0.0], [0.4, 0.2, 0.012]),
            ([0.0, 0.0, 0.388], [0.4, 0.2, 0.4]),
        ];
        let surfaces = Surfaces::new(&place(&walls), 0.01);
        assert_eq!(surfaces.cells.len(), 1);
        assert!(surfaces.has_walls);
        let middle = surfaces.middle(0);
        assert!(middle.iter().all(|m| (m - 0.2).abs() < 0.01), "{middle:?}");
        assert_eq!(surfaces.stretch(0, 0), None, "a wall is there");
        assert!(surfaces.stretch(0, surfaces.cells[0][0]).is_some());
    }
}
