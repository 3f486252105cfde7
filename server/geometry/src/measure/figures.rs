//! The figures of a pile's shape, each by itself and all together.

use super::extent::PointCluster;
use super::shape_measurer::{HEIGHT_SHARE, ShapeMeasurer, placed, ratio};
use super::solid::SolidCells;
use super::{Instances, PictureMeasures, PropSolid, ShapeMeasures, pictures};
use crate::RESOLUTION;
use crate::pose::Pose;
use glam::DVec3;
use rayon::prelude::*;

impl ShapeMeasurer<'_> {
    /// The figures of the shape of a pile of the same props.
    pub fn measure(&self, pile: &Instances) -> ShapeMeasures {
        self.measure_with(pile, self.protrusion_rel(pile), self.fill_fraction(pile))
    }

    /// The same at a later time. What is defined right after turning over is taken from `turned_over`.
    pub fn measure_later(&self, pile: &Instances, turned_over: &ShapeMeasures) -> ShapeMeasures {
        self.measure_with(pile, turned_over.protrusion_rel, turned_over.fill_fraction)
    }

    fn measure_with(&self, pile: &Instances, protrusion_rel: f64, fill_fraction: f64) -> ShapeMeasures {
        assert_eq!(pile.props.len(), self.props.len());
        let solid = |s: &SolidCells| PropSolid { source: s.source, volume: s.volume, capped: s.capped };
        ShapeMeasures {
            bodies: pile.bodies.len(),
            prop_diameter: self.diameter,
            inside_fraction: self.inside_fraction(pile),
            shape_iou: self.shape_iou(pile),
            height_p95_rel: self.height_p95_rel(pile),
            height_p95_rel_solid: self.height_p95_rel_solid(),
            protrusion_rel,
            fill_fraction,
            control_volume: self.region.volume(),
            solids: self.solids.iter().map(|s| s.as_ref().map(solid)).collect(),
        }
    }

    /// The figures of the shape as a camera sees it.
    pub fn look(&self, pile: &Instances) -> PictureMeasures {
        PictureMeasures {
            silhouette_iou: pictures::silhouette_iou(self, pile),
            height_rms_rel: pictures::height_rms_rel(self, pile),
        }
    }

    /// The bodies' centres of mass in the world (even density), shape `[body]`, metres.
    pub fn centres(&self, pile: &Instances) -> Vec<DVec3> {
        pile.bodies.iter().map(|b| placed(b, self.solid(b).centre)).collect()
    }

    /// Share of the bodies' volume whose centre of mass is inside the control mesh, tolerance d/10.
    pub fn inside_fraction(&self, pile: &Instances) -> f64 {
        let tolerance = RESOLUTION * self.diameter;
        let bodies = pile.bodies.par_iter().map(|b| {
            let inside = self.region.signed_distance(placed(b, self.solid(b).centre)) <= tolerance;
            (self.volume(b), if inside { self.volume(b) } else { 0.0 })
        });
        let bodies: Vec<(f64, f64)> = bodies.collect();
        ratio(bodies.iter().map(|b| b.1).sum(), bodies.iter().map(|b| b.0).sum())
    }

    /// Volume of the bodies' parts inside the control mesh / its volume, without what a core or scenery takes.
    /// Overlapping bodies count twice.
    pub fn fill_fraction(&self, pile: &Instances) -> f64 {
        let inside: Vec<f64> = pile.bodies.par_iter().map(|b| self.volume(b) * self.share_inside(b)).collect();
        let core = self.core.as_ref().map_or(0.0, |core| core.count() as f64 * self.lattice.cell.powi(3));
        ratio(inside.iter().sum(), self.region.volume() * self.room_share - core)
    }

    /// 95th percentile of the height of the bodies' volume above the control mesh's base / its height.
    pub fn height_p95_rel(&self, pile: &Instances) -> f64 {
        let (lo, hi) = self.region.bounds();
        let heights = pile.bodies.par_iter().flat_map_iter(|b| {
            let samples = &self.solid(b).samples;
            let weight = self.volume(b) / samples.len() as f64;
            samples.iter().map(move |&p| (placed(b, p).y - lo.y, weight))
        });
        let mut heights: Vec<(f64, f64)> = heights.collect();
        let cell = self.lattice.cell;
        let layers = self.core.iter().flat_map(|core| core.layers());
        heights.extend(layers.map(|(height, cells)| (height * cell, cells as f64 * cell.powi(3))));
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
    pub fn protrusion_rel(&self, pile: &Instances) -> f64 {
        let outside: Vec<f64> = pile.bodies.par_iter().map(|b| self.protrusion(b)).collect();
        outside.into_iter().fold(0.0, f64::max) / self.diameter
    }

    /// Metres. A signed distance changes by no more than the displacement: a cluster whose ball cannot reach farther
    /// out than the largest distance so far is skipped, and the most promising one goes first.
    fn protrusion(&self, body: &(usize, f64, Pose)) -> f64 {
        let solid = self.solid(body);
        if self.region.signed_distance(placed(body, solid.centre)) + solid.reach * body.1 <= 0.0 {
            return 0.0;
        }
        let clusters = self.clusters[body.0].iter().map(|c| {
            let reach = self.region.signed_distance(placed(body, c.centre)) + c.radius * body.1;
            (reach, c)
        });
        let mut clusters: Vec<(f64, &PointCluster)> = clusters.collect();
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

    /// Where the control mesh's eight cells around a point agree, so does the point; elsewhere its winding number
    /// decides.
    fn is_inside(&self, p: DVec3) -> bool {
        let [x, y, z] = self.lattice.cell_of(p - self.lattice.cell / 2.0);
        let full = (0..8).filter(|i| self.control_cells.get([x + (i & 1), y + (i >> 1 & 1), z + (i >> 2)])).count();
        match full {
            0 => false,
            8 => true,
            _ => self.region.contains(p),
        }
    }
}
