//! The volume IoU: bodies stamped onto the measurer's lattice, closed, and compared with the control mesh's cells.

use super::shape_measurer::{MOST_CELLS, ShapeMeasurer, placed, ratio};
use super::voxels::CellBlock;
use super::{Instances, ShapeIou};
use crate::mesh::bounds;
use crate::pose::Pose;
use glam::DVec3;

/// First cell, and the one after the last.
type CellBox = [[i64; 3]; 2];

impl ShapeMeasurer<'_> {
    /// Volume IoU of the closed pile and the control mesh.
    pub fn shape_iou(&self, pile: &Instances) -> ShapeIou {
        let boxes: Vec<CellBox> = pile.bodies.iter().map(|b| self.body_box(b)).collect();
        let with_core: Vec<CellBox> = boxes.iter().copied().chain(self.core_box()).collect();
        let (clip, block) = self.pile_grid(&with_core);
        let is_beyond = |b: &CellBox| (0..3).any(|a| b[0][a] < clip[0][a] || b[1][a] > clip[1][a]);
        let beyond: Vec<_> = boxes.iter().zip(pile.bodies).filter(|(b, _)| is_beyond(b)).map(|(_, b)| b).collect();
        let lost = beyond.iter().map(|body| {
            let samples = &self.solid(body).samples;
            let outside = |p: &DVec3| {
                let at = self.lattice.cell_of(placed(body, *p));
                (0..3).any(|a| at[a] < clip[0][a] || at[a] >= clip[1][a])
            };
            self.volume(body) * ratio(samples.iter().filter(|p| outside(p)).count() as f64, samples.len() as f64)
        });
        let lost: f64 = lost.sum();
        let mut stamped = self.stamp(pile, &boxes, clip, block);
        self.core.iter().for_each(|core| stamped.add(core));
        ShapeIou {
            value: self.iou(stamped, lost),
            solid: self.solid_iou,
            cell: self.lattice.cell,
            wanted_cell: self.wanted_cell,
            capped: self.lattice.cell > self.wanted_cell,
            beyond: beyond.len(),
        }
    }

    /// Whether a point is in the closed pile.
    pub fn covered(&self, pile: &Instances) -> impl Fn(DVec3) -> bool {
        let boxes: Vec<CellBox> = pile.bodies.iter().map(|b| self.body_box(b)).collect();
        let with_core: Vec<CellBox> = boxes.iter().copied().chain(self.core_box()).collect();
        let (clip, block) = self.pile_grid(&with_core);
        let mut cells = self.stamp(pile, &boxes, clip, block);
        self.core.iter().for_each(|core| cells.add(core));
        cells.close(self.closing());
        let lattice = self.lattice;
        move |p| cells.get(lattice.cell_of(p))
    }

    /// The cells that bodies may fill (the control mesh's box, and as much again on each side as the cap allows), and
    /// an empty block that holds the bodies within, with room to close them.
    fn pile_grid(&self, boxes: &[CellBox]) -> (CellBox, CellBlock) {
        let control = self.cells_of(self.region.bounds());
        let room = self.closing_room();
        let mut margin = (0..3).map(|a| control[1][a] - control[0][a]).max().unwrap_or(0);
        loop {
            let clip = [control[0].map(|x| x - margin), control[1].map(|x| x + margin)];
            let (mut lo, mut hi) = (clip[1], clip[0]);
            for b in boxes.iter().filter(|b| (0..3).all(|a| b[0][a] < clip[1][a] && b[1][a] > clip[0][a])) {
                for a in 0..3 {
                    lo[a] = lo[a].min(b[0][a].max(clip[0][a]));
                    hi[a] = hi[a].max(b[1][a].min(clip[1][a]));
                }
            }
            if (0..3).any(|a| lo[a] >= hi[a]) {
                return (clip, CellBlock::new(clip[0], clip[0]));
            }
            let (lo, hi) = (lo.map(|x| x - room), hi.map(|x| x + room));
            let cells: f64 = (0..3).map(|a| (hi[a] - lo[a]) as f64).product();
            // A pile may spread: four times as many as the control mesh has, about 200 MB while closing.
            if cells <= 4.0 * MOST_CELLS as f64 || margin == 0 {
                return (clip, CellBlock::new(lo, hi));
            }
            margin = margin * 4 / 5;
        }
    }

    /// The cells that the core may take.
    fn core_box(&self) -> Option<CellBox> {
        self.core.as_ref().map(|_| self.cells_of(self.region.bounds()))
    }

    /// Fills the cells of `block` within `clip` whose centres are in a body; `boxes` are the bodies'.
    fn stamp(&self, pile: &Instances, boxes: &[CellBox], clip: CellBox, mut block: CellBlock) -> CellBlock {
        let mut layers = vec![Vec::new(); block.size[2]];
        let first = block.lo[2];
        for (i, b) in boxes.iter().enumerate() {
            let last = (first + layers.len() as i64).min(clip[1][2]);
            for z in b[0][2].max(clip[0][2]).max(first)..b[1][2].min(last) {
                layers[(z - first) as usize].push(i);
            }
        }
        block.rows_mut(|at, row| {
            let [x, y, z] = at;
            if y < clip[0][1] || y >= clip[1][1] {
                return;
            }
            for &i in layers[(z - first) as usize].iter().filter(|&&i| boxes[i][0][1] <= y && y < boxes[i][1][1]) {
                let from = boxes[i][0][0].max(clip[0][0]).max(x);
                let to = boxes[i][1][0].min(clip[1][0]).min(x + row.len() as i64);
                if from < to {
                    let row = &mut row[(from - x) as usize..(to - x) as usize];
                    self.stamp_row(&pile.bodies[i], [from, y, z], row);
                }
            }
        });
        block
    }

    fn stamp_row(&self, body: &(usize, f64, Pose), at: [i64; 3], row: &mut [u8]) {
        let solid = self.solid(body);
        let back = body.2.rotation.inverse();
        let start = back * (self.lattice.centre(at) - body.2.translation) / body.1;
        let step = back * DVec3::X * (self.lattice.cell / body.1);
        // The stretch of the row inside the solid's box: one slab per axis.
        let (mut first, mut last) = (0.0f64, row.len() as f64 - 1.0);
        for a in 0..3 {
            let (lo, hi) = (solid.lo[a], solid.lo[a] + solid.cell[a] * solid.size[a] as f64);
            let (s, t) = ((lo - start[a]) / step[a], (hi - start[a]) / step[a]);
            if step[a] == 0.0 {
                // Along the slab: `contains` decides.
                continue;
            }
            first = first.max(s.min(t));
            last = last.min(s.max(t));
        }
        let (first, last) = (first.ceil().max(0.0), last.floor());
        if first > last {
            return;
        }
        for (i, cell) in row.iter_mut().enumerate().take(last as usize + 1).skip(first as usize) {
            if *cell == 0 && solid.contains(start + step * i as f64) {
                *cell = 1;
            }
        }
    }

    /// The cells that may hold a part of the body.
    fn body_box(&self, body: &(usize, f64, Pose)) -> CellBox {
        let solid = self.solid(body);
        let corner = |i: usize| {
            let pick = DVec3::from_array([0, 1, 2].map(|a| (i >> a & 1) as f64 * solid.size[a] as f64));
            placed(body, solid.lo + solid.cell * pick)
        };
        self.cells_of(bounds((0..8).map(corner)))
    }

    fn cells_of(&self, (lo, hi): (DVec3, DVec3)) -> CellBox {
        // Bodies that flew away by light years must not overflow the numbers of cells.
        let bounded = |p: DVec3| self.lattice.cell_of(p).map(|x| x.clamp(-(1 << 40), 1 << 40));
        [bounded(lo), bounded(hi).map(|x| x + 1)]
    }

    fn closing_room(&self) -> i64 {
        self.closing().ceil() as i64 + 1
    }
}
