//! Measures piles of the same props against one control mesh. Everything that depends on the shapes alone (solids, the
//! control mesh's cells) is prepared once; a pile is then measured as often as wanted, always on the same lattice.
//!
//! Time and memory are bounded: grids are capped and say so. The same pile gives the same bits for any number of
//! threads: work is split by rows and bodies, and sums run in their order.

use super::Instances;
use super::extent::{PointCluster, clusters, percentile};
use super::solid::{PropSize, SolidCells};
use super::voxels::{CellBlock, Lattice};
use crate::interior::MeshInterior;
use crate::mesh::TriMesh;
use crate::pose::Pose;
use crate::{RESOLUTION, enlarged_cell};
use glam::DVec3;
use rayon::prelude::*;

/// Most cells of the grid around the control mesh, and of all props' solids together, one of which has half of them at
/// most: 4 million, about 60 MB while closing.
pub(super) const MOST_CELLS: usize = 1 << 22;
/// A cell is at most this share of the median smallest extent (the definition of `shape_iou`).
const CELL_OF_THICKNESS: f64 = 0.5;
/// A prop's own cells are this much finer than the grid's, so that its faces are not moved by half a cell.
const SOLID_FINER: f64 = 3.0;
/// Total sample points, and bounds per body. The error of a body's volume share is 1.6 % with the most samples, 12 %
/// with the fewest. The fewest are taken in piles of so many bodies that single bodies do not matter.
const ALL_SAMPLES: usize = 1 << 20;
const SAMPLES: (usize, usize) = (16, 1024);
/// The share of the volume that `height_p95_rel` looks below.
pub(super) const HEIGHT_SHARE: f64 = 0.95;

/// A control mesh and props, prepared for measuring.
pub struct ShapeMeasurer<'a> {
    pub(super) control: &'a TriMesh,
    pub(super) region: &'a MeshInterior,
    pub(super) props: &'a [TriMesh],
    pub(super) solids: Vec<Option<SolidCells>>,
    /// Shape `[prop][cluster]`: the points that the prop's triangles use.
    pub(super) clusters: Vec<Vec<PointCluster>>,
    /// d, metres.
    pub(super) diameter: f64,
    pub(super) wanted_cell: f64,
    pub(super) lattice: Lattice,
    pub(super) control_cells: CellBlock,
    pub(super) solid_iou: f64,
    pub(super) solid_height: f64,
    /// Cells of the control mesh that a core takes, where there is one: they belong to every pile.
    pub(super) core: Option<CellBlock>,
    /// Cells of the control mesh that are no room, where scenery takes some: they belong to no pile.
    taken: Option<CellBlock>,
    /// Share of the control mesh that is room.
    pub(super) room_share: f64,
}

impl<'a> ShapeMeasurer<'a> {
    /// `region` is that of `control`, which is closed (an open one is measured as capped, and `protrusion_rel` may then
    /// miss a vertex near a cap); `pile` decides d and the cell, and must have a body.
    pub fn new(control: &'a TriMesh, region: &'a MeshInterior, pile: &Instances<'a>) -> ShapeMeasurer<'a> {
        assert!(!pile.bodies.is_empty(), "a pile without bodies has no diameter");
        let largest_scale = |prop: usize| {
            let scales = pile.bodies.iter().filter(|b| b.0 == prop).map(|b| b.1);
            scales.fold(0.0, f64::max)
        };
        let outlines: Vec<Option<PropSize>> = (0..pile.props.len())
            .into_par_iter()
            .map(|i| (largest_scale(i) > 0.0).then(|| PropSize::new(&pile.props[i])))
            .collect();
        let median = |size: fn(&PropSize) -> f64| {
            let sizes = pile.bodies.iter().filter_map(|b| outlines[b.0].as_ref().map(|o| size(o) * b.1));
            percentile(&sizes.collect::<Vec<_>>(), 0.5)
        };
        let diameter = 2.0 * median(|o| o.radius);
        let wanted_cell = (CELL_OF_THICKNESS * median(|o| o.thickness)).min(RESOLUTION * diameter);
        let (lattice, mut control_cells) = control_grid(region, wanted_cell, diameter / 2.0);
        control_cells.rows_mut(|at, row| region.mark_row(lattice.centre(at), lattice.cell, row));
        let used = outlines.iter().flatten().count();
        let max_cells = MOST_CELLS / used.max(2);
        let max_samples = (ALL_SAMPLES / pile.bodies.len()).clamp(SAMPLES.0, SAMPLES.1);
        let solid = |(i, outline): (usize, &Option<PropSize>)| {
            let outline = outline.as_ref()?;
            let wanted = (lattice.cell / largest_scale(i)).min(outline.thickness) / SOLID_FINER;
            Some(SolidCells::new(outline, wanted, max_cells, max_samples))
        };
        let mut measurer = ShapeMeasurer {
            control,
            region,
            props: pile.props,
            solids: outlines.par_iter().enumerate().map(solid).collect(),
            clusters: pile.props.par_iter().map(clusters).collect(),
            diameter,
            wanted_cell,
            lattice,
            solid_height: layer_height(&control_cells, HEIGHT_SHARE) * lattice.cell,
            control_cells,
            solid_iou: 0.0,
            core: None,
            taken: None,
            room_share: 1.0,
        };
        measurer.solid_iou = measurer.iou(measurer.control_cells.clone(), 0.0);
        measurer
    }

    /// The same for piles in the room that is left of the control mesh, by points in SI: the rest counts as outside.
    pub fn within(mut self, is_room: impl Fn(DVec3) -> bool + Sync) -> ShapeMeasurer<'a> {
        let lattice = self.lattice;
        let mut taken = self.control_cells.clone();
        taken.rows_mut(|at, row| {
            let start = lattice.centre(at);
            let is_taken = |i: usize| !is_room(start + DVec3::X * (i as f64 * lattice.cell));
            row.iter_mut().enumerate().for_each(|(i, cell)| *cell = u8::from(*cell != 0 && is_taken(i)));
        });
        let all = self.control_cells.count() as f64;
        self.control_cells.subtract(&taken);
        self.room_share = ratio(self.control_cells.count() as f64, all);
        self.taken = Some(taken);
        self.solid_height = layer_height(&self.control_cells, HEIGHT_SHARE) * lattice.cell;
        self.solid_iou = self.iou(self.control_cells.clone(), 0.0);
        self
    }

    /// The same for piles around a core, which counts as a part of them.
    pub fn around(mut self, core: &TriMesh) -> ShapeMeasurer<'a> {
        let region = MeshInterior::new(core);
        let mut cells = self.control_cells.clone();
        let lattice = self.lattice;
        cells.rows_mut(|at, row| region.mark_row(lattice.centre(at), lattice.cell, row));
        cells.keep_common(&self.control_cells);
        self.core = Some(cells);
        self
    }

    /// d, metres: the median diameter of the bodies that the measurer was made for.
    pub fn diameter(&self) -> f64 {
        self.diameter
    }

    /// Closes the cells by d/2 and compares them with the control mesh's; `lost` m^3 of the pile are elsewhere.
    pub(super) fn iou(&self, mut cells: CellBlock, lost: f64) -> f64 {
        cells.close(self.closing());
        // Closing joins what scenery parts.
        self.taken.iter().for_each(|taken| cells.subtract(taken));
        let common = cells.common(&self.control_cells) as f64;
        let lost = lost / self.lattice.cell.powi(3);
        ratio(common, (cells.count() + self.control_cells.count()) as f64 - common + lost)
    }

    /// The radius of the closing, in cells.
    pub(super) fn closing(&self) -> f64 {
        self.diameter / 2.0 / self.lattice.cell
    }

    pub(super) fn volume(&self, body: &(usize, f64, Pose)) -> f64 {
        self.solid(body).volume * body.1.powi(3)
    }

    pub(super) fn solid(&self, body: &(usize, f64, Pose)) -> &SolidCells {
        self.solids[body.0].as_ref().expect("a prop that the measurer's pile did not use")
    }

    pub(super) fn control_bounds(&self) -> (DVec3, DVec3) {
        self.region.bounds()
    }
}

/// A point of a body's prop -> the world.
pub(super) fn placed(body: &(usize, f64, Pose), p: DVec3) -> DVec3 {
    body.2.transform_point(p * body.1)
}

/// The lattice, and the empty block around the control mesh with room to close it: as fine as wanted, or as the cap
/// allows.
fn control_grid(region: &MeshInterior, wanted_cell: f64, closing: f64) -> (Lattice, CellBlock) {
    let (lo, hi) = region.bounds();
    let padded = |cell: f64| ((hi - lo + 2.0 * closing) / cell).ceil() + 4.0;
    let (cell, _) = enlarged_cell(wanted_cell, 1.02, MOST_CELLS as f64, padded);
    let lattice = Lattice { origin: lo, cell };
    let room = (closing / cell).ceil() as i64 + 1;
    let last = ((hi - lo) / cell).ceil().to_array().map(|n| n as i64);
    (lattice, CellBlock::new([-room; 3], last.map(|n| n + room)))
}

/// The height, in cells above lattice height 0, below which a share of the full cells lies; within a layer linearly.
fn layer_height(block: &CellBlock, share: f64) -> f64 {
    let mut left = share * block.count() as f64;
    for (middle, count) in block.layers() {
        if left <= count as f64 && count > 0 {
            return middle - 0.5 + left / count as f64;
        }
        left -= count as f64;
    }
    0.0
}

/// 0 for nothing of nothing.
pub(super) fn ratio(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}
