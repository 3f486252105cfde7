//! Measures piles of the same props against one control mesh. What depends on the shapes alone (solids, the control
//! mesh's cells) is prepared once; a pile is then measured as often as wanted, always on the same lattice.
//!
//! Time and memory are bounded: grids are capped and say so. The same pile gives the same bits for any number of
//! threads: work is split by rows and bodies, and sums run in their order.

use super::extent::{Cluster, clusters, percentile};
use super::solid::{Outline, Solid};
use super::stamp::control_grid;
use super::voxels::{Block, Lattice};
use super::{Pile, PropSolid, ShapeMeasures, pictures};
use crate::geometry::mesh::TriMesh;
use crate::geometry::pose::Pose;
use crate::geometry::region::Region;
use glam::DVec3;
use rayon::prelude::*;

/// A cell is at most this share of the median smallest extent, and of d (the definition of `shape_iou`).
const CELL_OF_THICKNESS: f64 = 0.5;
const CELL_OF_DIAMETER: f64 = 0.1;
/// A prop's own cells are this much finer than the grid's, so that its faces are not moved by half a cell...
const SOLID_FINER: f64 = 3.0;
/// ...up to this many for one prop, and for all of them.
const SOLID_CELLS: usize = 1 << 21;
const ALL_SOLID_CELLS: usize = 1 << 22;
/// Sample points of all bodies together, and the bounds for each: a share of a body's volume is right to 1.6 % of it
/// at best, and to 12 % where there are so many bodies that single ones do not matter.
const ALL_SAMPLES: usize = 1 << 20;
const SAMPLES: (usize, usize) = (16, 1024);
/// A centre of mass this far outside still counts as inside, in d (the definition of `inside_fraction`).
const INSIDE_TOLERANCE: f64 = 0.1;
/// The share of the volume that `height_p95_rel` looks below.
const HEIGHT_SHARE: f64 = 0.95;

/// A control mesh and props, prepared for measuring.
pub struct Gauge<'a> {
    pub(super) control: &'a TriMesh,
    pub(super) region: &'a Region,
    props: &'a [TriMesh],
    solids: Vec<Option<Solid>>,
    /// Shape `[prop][cluster]`: the points that the prop's triangles use.
    clusters: Vec<Vec<Cluster>>,
    /// d, metres.
    pub(super) diameter: f64,
    pub(super) wanted_cell: f64,
    pub(super) lattice: Lattice,
    pub(super) control_cells: Block,
    pub(super) solid_iou: f64,
    solid_height: f64,
}

impl<'a> Gauge<'a> {
    /// `region` is that of `control`, which is closed (an open one is measured as capped, and `protrusion_rel` may then
    /// miss a vertex near a cap); `pile` decides d and the cell, and must have a body.
    pub fn new(control: &'a TriMesh, region: &'a Region, pile: &Pile<'a>) -> Gauge<'a> {
        assert!(!pile.bodies.is_empty(), "a pile without bodies has no diameter");
        let largest_scale = |prop: usize| {
            let scales = pile.bodies.iter().filter(|b| b.0 == prop).map(|b| b.1);
            scales.fold(0.0, f64::max)
        };
        let outlines: Vec<Option<Outline>> = (0..pile.props.len())
            .into_par_iter()
            .map(|i| (largest_scale(i) > 0.0).then(|| Outline::new(&pile.props[i])))
            .collect();
        let median = |size: fn(&Outline) -> f64| {
            let sizes = pile.bodies.iter().filter_map(|b| outlines[b.0].as_ref().map(|o| size(o) * b.1));
            percentile(&sizes.collect::<Vec<_>>(), 0.5)
        };
        let diameter = 2.0 * median(|o| o.radius);
        let wanted_cell = (CELL_OF_THICKNESS * median(|o| o.thickness)).min(CELL_OF_DIAMETER * diameter);
        let (lattice, mut control_cells) = control_grid(region, wanted_cell, diameter / 2.0);
        control_cells.rows_mut(|at, row| region.mark_row(lattice.centre(at), lattice.cell, row));
        let used = outlines.iter().flatten().count();
        let max_cells = SOLID_CELLS.min(ALL_SOLID_CELLS / used);
        let max_samples = (ALL_SAMPLES / pile.bodies.len()).clamp(SAMPLES.0, SAMPLES.1);
        let solid = |(i, outline): (usize, &Option<Outline>)| {
            let outline = outline.as_ref()?;
            let wanted = (lattice.cell / largest_scale(i)).min(outline.thickness) / SOLID_FINER;
            Some(Solid::new(outline, wanted, max_cells, max_samples))
        };
        let mut gauge = Gauge {
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
        };
        gauge.solid_iou = gauge.iou(gauge.control_cells.clone(), 0.0);
        gauge
    }

    /// d, metres: the median diameter of the bodies that the gauge was made for.
    pub fn diameter(&self) -> f64 {
        self.diameter
    }

    /// All figures of a pile of the same props.
    pub fn measure(&self, pile: &Pile) -> ShapeMeasures {
        assert_eq!(pile.props.len(), self.props.len());
        let solid = |s: &Solid| PropSolid { source: s.source, volume: s.volume, capped: s.capped };
        ShapeMeasures {
            bodies: pile.bodies.len(),
            prop_diameter: self.diameter,
            inside_fraction: self.inside_fraction(pile),
            shape_iou: self.shape_iou(pile),
            height_p95_rel: self.height_p95_rel(pile),
            height_p95_rel_solid: self.height_p95_rel_solid(),
            protrusion_rel: self.protrusion_rel(pile),
            silhouette_iou: pictures::silhouette_iou(self, pile),
            height_rms_rel: pictures::height_rms_rel(self, pile),
            fill_fraction: self.fill_fraction(pile),
            control_volume: self.region.volume(),
            solids: self.solids.iter().map(|s| s.as_ref().map(solid)).collect(),
        }
    }

    /// The bodies' centres of mass in the world (even density), shape `[body]`, metres.
    pub fn centres(&self, pile: &Pile) -> Vec<DVec3> {
        pile.bodies.iter().map(|b| placed(b, self.solid(b).centre)).collect()
    }

    /// Share of the bodies' volume whose centre of mass is inside the control mesh, tolerance d/10.
    pub fn inside_fraction(&self, pile: &Pile) -> f64 {
        let tolerance = INSIDE_TOLERANCE * self.diameter;
        let bodies = pile.bodies.par_iter().map(|b| {
            let inside = self.region.signed_distance(placed(b, self.solid(b).centre)) <= tolerance;
            (self.volume(b), if inside { self.volume(b) } else { 0.0 })
        });
        let bodies: Vec<(f64, f64)> = bodies.collect();
        ratio(bodies.iter().map(|b| b.1).sum(), bodies.iter().map(|b| b.0).sum())
    }

    /// Volume of the bodies' parts inside the control mesh / its volume. Overlapping bodies count twice.
    pub fn fill_fraction(&self, pile: &Pile) -> f64 {
        let inside: Vec<f64> = pile.bodies.par_iter().map(|b| self.volume(b) * self.share_inside(b)).collect();
        ratio(inside.iter().sum(), self.region.volume())
    }

    /// 95th percentile of the height of the bodies' volume above the control mesh's base / its height.
    pub fn height_p95_rel(&self, pile: &Pile) -> f64 {
        let (lo, hi) = self.region.bounds();
        let heights = pile.bodies.par_iter().flat_map_iter(|b| {
            let samples = &self.solid(b).samples;
            let weight = self.volume(b) / samples.len() as f64;
            samples.iter().map(move |&p| (placed(b, p).y - lo.y, weight))
        });
        let mut heights: Vec<(f64, f64)> = heights.collect();
        heights.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut left = HEIGHT_SHARE * heights.iter().map(|h| h.1).sum::<f64>();
        let reached = heights.iter().find(|h| {
            left -= h.1;
            left <= 0.0
        });
        ratio(reached.or(heights.last()).map_or(0.0, |h| h.0), hi.y - lo.y)
    }

    /// The same for the solid control mesh.
    pub fn height_p95_rel_solid(&self) -> f64 {
        let (lo, hi) = self.region.bounds();
        ratio(self.solid_height, hi.y - lo.y)
    }

    /// Largest distance of a body's vertex outside the control mesh / d.
    pub fn protrusion_rel(&self, pile: &Pile) -> f64 {
        let outside: Vec<f64> = pile.bodies.par_iter().map(|b| self.protrusion(b)).collect();
        outside.into_iter().fold(0.0, f64::max) / self.diameter
    }

    /// Metres. A signed distance changes by no more than the way: a cluster whose ball cannot reach farther out than
    /// what is known already is skipped, and the most promising one goes first.
    fn protrusion(&self, body: &(usize, f64, Pose)) -> f64 {
        let solid = self.solid(body);
        if self.region.signed_distance(placed(body, solid.centre)) + solid.reach * body.1 <= 0.0 {
            return 0.0;
        }
        let clusters = self.clusters[body.0].iter().map(|c| {
            let reach = self.region.signed_distance(placed(body, c.centre)) + c.radius * body.1;
            (reach, c)
        });
        let mut clusters: Vec<(f64, &Cluster)> = clusters.collect();
        clusters.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut largest = 0.0f64;
        for (reach, cluster) in clusters {
            if reach <= largest {
                break;
            }
            let mut known = (placed(body, cluster.centre), f64::INFINITY);
            for &v in &cluster.points {
                let p = placed(body, v);
                if known.1 + p.distance(known.0) > largest {
                    known = (p, self.region.signed_distance(p));
                    largest = largest.max(known.1);
                }
            }
        }
        largest
    }

    fn share_inside(&self, body: &(usize, f64, Pose)) -> f64 {
        let solid = self.solid(body);
        let distance = self.region.signed_distance(placed(body, solid.centre));
        if distance.abs() >= solid.reach * body.1 {
            return if distance < 0.0 { 1.0 } else { 0.0 };
        }
        let inside = solid.samples.iter().filter(|&&p| self.is_inside(placed(body, p))).count();
        inside as f64 / solid.samples.len() as f64
    }

    /// Where the control mesh's eight cells around a point agree, so does the point; elsewhere its winding number tells.
    fn is_inside(&self, p: DVec3) -> bool {
        let [x, y, z] = self.lattice.cell_of(p - self.lattice.cell / 2.0);
        let full = (0..8).filter(|i| self.control_cells.get([x + (i & 1), y + (i >> 1 & 1), z + (i >> 2)])).count();
        match full {
            0 => false,
            8 => true,
            _ => self.region.contains(p),
        }
    }

    pub(super) fn volume(&self, body: &(usize, f64, Pose)) -> f64 {
        self.solid(body).volume * body.1.powi(3)
    }

    pub(super) fn solid(&self, body: &(usize, f64, Pose)) -> &Solid {
        self.solids[body.0].as_ref().expect("a prop that the gauge's pile did not use")
    }

    /// The box around what pictures show, metres: the control mesh and the bodies, as far as the control mesh's
    /// largest extent around it.
    pub(super) fn picture_box(&self, pile: &Pile) -> (DVec3, DVec3) {
        let (lo, hi) = self.region.bounds();
        let around = (hi - lo).max_element();
        let reach = |b: &(usize, f64, Pose)| (placed(b, self.solid(b).centre), self.solid(b).reach * b.1);
        let all = pile.bodies.iter().map(reach).fold((lo, hi), |all, (c, r)| (all.0.min(c - r), all.1.max(c + r)));
        (all.0.max(lo - around), all.1.min(hi + around))
    }

    pub(super) fn control_bounds(&self) -> (DVec3, DVec3) {
        self.region.bounds()
    }
}

/// Where a point of a body's prop lies in the world.
pub(super) fn placed(body: &(usize, f64, Pose), p: DVec3) -> DVec3 {
    body.2.transform_point(p * body.1)
}

/// The height, in cells above lattice height 0, below which a share of the full cells lies; within a layer linearly.
fn layer_height(block: &Block, share: f64) -> f64 {
    let [nx, ny, _] = block.size;
    let mut layers = vec![0usize; ny];
    for (i, row) in block.cells.chunks(nx).enumerate() {
        layers[i % ny] += row.iter().filter(|&&c| c != 0).count();
    }
    let mut left = share * layers.iter().sum::<usize>() as f64;
    for (y, &count) in layers.iter().enumerate() {
        if left <= count as f64 && count > 0 {
            return (block.lo[1] + y as i64) as f64 + left / count as f64;
        }
        left -= count as f64;
    }
    0.0
}

/// 0 for nothing of nothing.
pub(super) fn ratio(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}
