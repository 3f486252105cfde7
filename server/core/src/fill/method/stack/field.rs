//! The room in the container as a height field: for each cell of a grid seen from above, how high the pile stands there
//! and how high it may grow.

use cairn_engine::world::BodyId;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::raster::rasterise;
use glam::{DQuat, DVec2, DVec3};
use rayon::prelude::*;

/// Points of a cell at which heights are sampled, along each axis, cells from its middle. The outermost leave a margin:
/// a body that reaches less far into a cell is not in it.
const SAMPLES: [f64; 3] = [-0.4, 0.0, 0.4];
/// A body that is laid down touches the pile where it is this near below, in the body's thickness.
const TOUCHING: f64 = 0.25;

/// Seen along the pile's own axes: X and Z of the world, turned about Y.
pub struct HeightField {
    /// From the world to the pile's axes.
    pub turn: DQuat,
    /// Corner of the first cell, and the edge of a cell; engine units.
    origin: DVec2,
    pub cell: f64,
    pub size: [usize; 2],
    /// Intervals of height in which each column is inside the container, ascending.
    intervals: Vec<Vec<[f64; 2]>>,
    /// Height of the pile, and the highest that it may reach; shape `[z][x]`. A column without room has an infinite
    /// floor.
    floor: Vec<f64>,
    ceiling: Vec<f64>,
    /// The bodies that the floor is made of.
    owner: Vec<BodyId>,
}

/// No body: the ground, or the container.
const NOBODY: BodyId = BodyId::MAX;

/// A body from below and from above, in cells.
pub struct Footprint {
    pub size: [usize; 2],
    /// Cells that the body is over, each with the body's lowest and highest point there.
    cells: Vec<Covered>,
    /// The body's centre of mass, relative to the corner of the first cell and to the height of the lowest point.
    pub center: DVec3,
    /// From the lowest point to the highest.
    pub height: f64,
}

struct Covered {
    at: [usize; 2],
    low: f64,
    high: f64,
}

/// A place for a footprint.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    pub at: [usize; 2],
    /// Height of the body's lowest point.
    pub height: f64,
    /// Mean height of the gap below it.
    pub gap: f64,
    /// The centre of mass is above the cells where it touches the pile.
    pub stable: bool,
    /// The body that carries most of it, and the share of its footprint that this one is below.
    pub on: Option<(BodyId, f64)>,
}

impl Footprint {
    /// The triangles of a body about its centre of mass, in the pile's axes. `shift`: from the middle of its cells, as
    /// far as they have room.
    pub fn new(triangles: &[[DVec3; 3]], cell: f64, shift: DVec2) -> Footprint {
        let points = || triangles.iter().flatten();
        let low = points().fold(DVec3::INFINITY, |a, &p| a.min(p));
        let high = points().fold(DVec3::NEG_INFINITY, |a, &p| a.max(p));
        let edges = DVec2::new(high.x - low.x, high.z - low.z) / cell;
        // A body that reaches into another cell, but meets no sample there, does not need that cell.
        let count = (edges - SNUG).ceil().max(DVec2::ONE);
        let slack = (count - edges).max(DVec2::ZERO) / 2.0 * cell;
        let size = [count.x as usize, count.y as usize];
        let offset = DVec2::new(-low.x, -low.z) + slack + shift.clamp(-slack, slack);
        let mut low_at = vec![f64::INFINITY; size[0] * size[1]];
        let mut high_at = vec![f64::NEG_INFINITY; size[0] * size[1]];
        for triangle in triangles {
            rasterise(
                triangle.map(|p| (DVec2::new(p.x, p.z) + offset, p.y - low.y)),
                cell,
                size,
                &SAMPLES,
                |i, _, y| {
                    low_at[i] = low_at[i].min(y);
                    high_at[i] = high_at[i].max(y);
                },
            );
        }
        let covered = (0..low_at.len()).filter(|&i| low_at[i] <= high_at[i]);
        let cells =
            covered.map(|i| Covered { at: [i % size[0], i / size[0]], low: low_at[i], high: high_at[i] }).collect();
        Footprint { size, cells, center: DVec3::new(offset.x, -low.y, offset.y), height: high.y - low.y }
    }
}

/// Cells by which a body may reach beyond the ones that it is given.
pub const SNUG: f64 = 0.02;

impl HeightField {
    /// The inside of a mesh that faces inward, from `base` up, in cells of this edge, along axes that are turned by
    /// `turn`. Bodies may reach through floors and ceilings by `leeway`.
    pub fn new(container: &TriMesh, base: f64, turn: DQuat, cell: f64, leeway: f64) -> HeightField {
        let points: Vec<DVec3> = container.points.iter().map(|&p| turn * p).collect();
        let flat = || points.iter().map(|p| DVec2::new(p.x, p.z));
        let origin = flat().fold(DVec2::INFINITY, DVec2::min);
        let extent = flat().fold(DVec2::NEG_INFINITY, DVec2::max) - origin;
        let size = [0, 1].map(|k| (extent[k] / cell + SNUG).floor().max(1.0) as usize);
        let corners = container.triangles.iter().map(|t| t.map(|v| points[v as usize]));
        let mut crossings: Vec<Vec<(usize, f64, i32)>> = vec![Vec::new(); size[0] * size[1]];
        for [a, b, c] in corners {
            let enters = if (b - a).cross(c - a).y > 0.0 { 1 } else { -1 };
            let placed = [a, b, c].map(|p| (DVec2::new(p.x, p.z) - origin, p.y));
            rasterise(placed, cell, size, &SAMPLES, |cell, sample, y| crossings[cell].push((sample, y, enters)));
        }
        let intervals = crossings.into_iter().map(|crossings| column(crossings, base, leeway)).collect();
        let mut field =
            HeightField { turn, origin, cell, size, intervals, floor: vec![], ceiling: vec![], owner: vec![] };
        field.clear();
        field
    }

    /// Keeps the parts of each column that are free at all of its samples. `free`: the free parts of the vertical line
    /// through a point of the world. Bodies may reach beyond them by `leeway`.
    pub fn keep_free(&mut self, leeway: f64, free: impl Fn(DVec3) -> Vec<[f64; 2]> + Sync) {
        let ([width, _], cell, origin, turn) = (self.size, self.cell, self.origin, self.turn.inverse());
        self.intervals.par_iter_mut().enumerate().for_each(|(i, intervals)| {
            for sample in 0..SAMPLES.len().pow(2) {
                if intervals.is_empty() {
                    return;
                }
                let off = DVec2::new(SAMPLES[sample % SAMPLES.len()], SAMPLES[sample / SAMPLES.len()]);
                let p = origin + (DVec2::new((i % width) as f64, (i / width) as f64) + 0.5 + off) * cell;
                let free = free(turn * DVec3::new(p.x, 0.0, p.y));
                let meet = |a: &[f64; 2]| {
                    let both = free.iter().map(|b| [a[0].max(b[0] - leeway), a[1].min(b[1] + leeway)]);
                    both.filter(|part| part[1] > part[0]).collect::<Vec<_>>()
                };
                *intervals = intervals.iter().flat_map(meet).collect();
            }
        });
        self.clear();
    }

    /// Edges of the rectangle around the container, the longer one first.
    pub fn extent(&self) -> DVec2 {
        DVec2::new(self.size[0] as f64, self.size[1] as f64) * self.cell
    }

    /// Takes all bodies out.
    pub fn clear(&mut self) {
        self.floor = self.intervals.iter().map(|i| i.first().map_or(f64::INFINITY, |i| i[0])).collect();
        self.ceiling = self.intervals.iter().map(|i| i.first().map_or(f64::NEG_INFINITY, |i| i[1])).collect();
        self.owner = vec![NOBODY; self.floor.len()];
    }

    /// The pile's own coordinates of a point: X and Z in cells.
    fn cells(&self, p: DVec3) -> DVec2 {
        let p = self.turn * p;
        (DVec2::new(p.x, p.z) - self.origin) / self.cell
    }

    /// The centre of mass of a body at this place, in the world.
    pub fn center(&self, footprint: &Footprint, spot: &Spot) -> DVec3 {
        let corner = self.origin + DVec2::new(spot.at[0] as f64, spot.at[1] as f64) * self.cell;
        let p = DVec3::new(corner.x, spot.height, corner.y) + footprint.center;
        self.turn.inverse() * p
    }

    /// The lowest spot of the footprint with its first cell here. `None` if it has no room, or lies higher than `most`.
    /// `deep`: the body's thickness; deeper gaps count as that.
    pub fn lay(&self, footprint: &Footprint, at: [usize; 2], most: f64, deep: f64) -> Option<Spot> {
        let first = at[1] * self.size[0] + at[0];
        let index = |c: &Covered| first + c.at[1] * self.size[0] + c.at[0];
        let mut height = f64::NEG_INFINITY;
        for c in &footprint.cells {
            height = height.max(self.floor[index(c)] - c.low);
            if height > most {
                return None;
            }
        }
        if footprint.cells.iter().any(|c| height + c.high > self.ceiling[index(c)]) {
            return None;
        }
        let mut gap = 0.0;
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let mut owners: Vec<(BodyId, usize)> = Vec::new();
        for c in &footprint.cells {
            let below = height + c.low - self.floor[index(c)];
            gap += below.min(deep);
            if below <= TOUCHING * deep {
                let p = DVec2::new(c.at[0] as f64, c.at[1] as f64);
                (low, high) = (low.min(p), high.max(p + 1.0));
                let owner = self.owner[index(c)];
                match owners.iter_mut().find(|(known, _)| *known == owner) {
                    Some((_, cells)) => *cells += 1,
                    None => owners.push((owner, 1)),
                }
            }
        }
        let center = DVec2::new(footprint.center.x, footprint.center.z) / self.cell;
        let stable = low.cmplt(center - MARGIN).all() && high.cmpgt(center + MARGIN).all();
        let most =
            owners.into_iter().filter(|(owner, _)| *owner != NOBODY).max_by_key(|&(owner, cells)| (cells, owner));
        let on = most.map(|(owner, cells)| (owner, cells as f64 / footprint.cells.len() as f64));
        Some(Spot { at, height, gap: gap / footprint.cells.len().max(1) as f64, stable, on })
    }

    /// Nothing lies above the middle of this body, whose centre of mass is here.
    pub fn is_topmost(&self, body: BodyId, center: DVec3) -> bool {
        let cell = self.cells(center);
        let [x, z] = [cell.x.max(0.0) as usize, cell.y.max(0.0) as usize];
        x < self.size[0] && z < self.size[1] && self.owner[z * self.size[0] + x] == body
    }

    /// The spot of a footprint whose centre of mass is here, even if it overlaps the pile. `None` if the container has
    /// no room.
    pub fn lay_at(&self, footprint: &Footprint, center: DVec3) -> Option<Spot> {
        let corner = self.cells(center) - DVec2::new(footprint.center.x, footprint.center.z) / self.cell;
        let (corner, height) = (corner.round(), center.y - footprint.center.y);
        if corner.min_element() < 0.0 {
            return None;
        }
        let at = [corner.x as usize, corner.y as usize];
        let fits = |c: &Covered| {
            let [x, z] = [0, 1].map(|k| at[k] + c.at[k]);
            x < self.size[0] && z < self.size[1] && height + c.high <= self.ceiling[z * self.size[0] + x]
        };
        footprint.cells.iter().all(fits).then_some(Spot { at, height, gap: 0.0, stable: true, on: None })
    }

    /// How many fewer of these fit into the row and into the file that run through this place, at its height, when one
    /// lies here; and how many slots, too narrow for another one, it leaves toward the first cells, or toward the last.
    /// `edges`: of the others, in cells. `deep`: the body's thickness.
    pub fn loss(
        &self,
        footprint: &Footprint,
        spot: &Spot,
        edges: [usize; 2],
        deep: f64,
        toward_last: bool,
    ) -> (usize, usize) {
        let middle = spot.height + footprint.height / 2.0;
        let is_free = |i: &usize| self.floor[*i] < middle && self.ceiling[*i] > middle;
        let carries = |i: &usize| is_free(i) && self.floor[*i] >= spot.height - TOUCHING * deep;
        let loss = |axis: usize| {
            let edge = footprint.size[axis];
            let across = spot.at[1 - axis] + footprint.size[1 - axis] / 2;
            let index = |at: usize| if axis == 0 { across * self.size[0] + at } else { at * self.size[0] + across };
            // Cells in which others may lie, on this side: cells that carry, and a part of a body beyond them.
            let room = |cells: &mut dyn Iterator<Item = usize>| {
                let mut cells = cells.map(index).peekable();
                let mut carried = 0;
                while cells.next_if(|i| carries(i)).is_some() {
                    carried += 1;
                }
                let beyond = cells.take_while(is_free).count() as f64;
                f64::from(carried) + beyond.min(OVERHANG * edge as f64)
            };
            let before = room(&mut (0..spot.at[axis]).rev());
            let after = room(&mut (spot.at[axis] + edge..self.size[axis]));
            let fit = |room: f64| (room / edges[axis] as f64 + 1e-9).floor() as usize;
            let lost = fit(before + edge as f64 + after).saturating_sub(fit(before) + 1 + fit(after));
            let beside = if toward_last { after } else { before };
            (lost, usize::from(beside > 0.0 && fit(beside) == 0))
        };
        let ((a, b), (c, d)) = (loss(0), loss(1));
        (a + c, b + d)
    }

    /// Raises the floor by a body that lies there. `least`: if less room than that is left, the column continues
    /// above its ceiling.
    pub fn put(&mut self, footprint: &Footprint, spot: &Spot, body: BodyId, least: f64) {
        for c in &footprint.cells {
            let i = (spot.at[1] + c.at[1]) * self.size[0] + spot.at[0] + c.at[0];
            self.raise(i, spot.height + c.high, body, least);
        }
    }

    /// Raises the floor by a body at any place, whose triangles are in the world's axes.
    pub fn put_as_it_lies(&mut self, triangles: &[[DVec3; 3]], body: BodyId, least: f64) {
        let (cell, size) = (self.cell, self.size);
        let mut tops = std::collections::BTreeMap::<usize, f64>::new();
        for triangle in triangles {
            let placed = triangle.map(|p| (self.cells(p) * cell, p.y));
            rasterise(placed, cell, size, &SAMPLES, |i, _, y| {
                let top = tops.entry(i).or_insert(y);
                *top = top.max(y);
            });
        }
        for (i, top) in tops {
            self.raise(i, top, body, least);
        }
    }

    fn raise(&mut self, i: usize, top: f64, body: BodyId, least: f64) {
        if top > self.floor[i] {
            self.floor[i] = top;
            self.owner[i] = body;
        }
        if self.floor[i] + least > self.ceiling[i] {
            self.go_on(i);
        }
    }

    /// Continues with the next part of the column, if there is one.
    fn go_on(&mut self, i: usize) -> bool {
        let next = self.intervals[i].iter().find(|next| next[0] >= self.ceiling[i] && next[1] > self.floor[i]);
        let Some(&[floor, ceiling]) = next else { return false };
        (self.floor[i], self.ceiling[i], self.owner[i]) = (floor.max(self.floor[i]), ceiling, NOBODY);
        true
    }

    /// Continues above room that can no longer be filled, such as the hole of an arch. Returns whether there is more
    /// room.
    pub fn go_on_above(&mut self) -> bool {
        (0..self.floor.len()).filter(|&i| self.go_on(i)).count() > 0
    }
}

/// The share of a body that may lie beyond the cells that carry it.
const OVERHANG: f64 = 0.4;
/// The centre of mass must be this far within the cells where a body touches the pile, cells.
const MARGIN: f64 = 0.25;

/// The parts of a column that are inside at all its samples, from below. A crossing: its sample, its height, and 1
/// where it leads into the container from below, -1 where it leads out.
fn column(mut crossings: Vec<(usize, f64, i32)>, base: f64, leeway: f64) -> Vec<[f64; 2]> {
    crossings.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(b.2.cmp(&a.2)));
    let mut common = vec![[f64::NEG_INFINITY, f64::INFINITY]];
    for sample in 0..SAMPLES.len().pow(2) {
        let (mut depth, mut parts, mut open) = (0, Vec::new(), 0.0);
        for &(_, y, enters) in crossings.iter().filter(|c| c.0 == sample) {
            if depth == 0 && enters > 0 {
                open = y;
            }
            depth += enters;
            if depth == 0 && enters < 0 {
                parts.push([open - leeway, y + leeway]);
            }
        }
        let meet = |a: &[f64; 2]| parts.iter().map(|b| [a[0].max(b[0]), a[1].min(b[1])]).collect::<Vec<_>>();
        common = common.iter().flat_map(meet).filter(|part| part[1] > part[0]).collect();
    }
    let above = |part: [f64; 2]| [part[0].max(base), part[1]];
    common.into_iter().map(above).filter(|part| part[1] > part[0]).collect()
}
