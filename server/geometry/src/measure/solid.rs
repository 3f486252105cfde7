//! A prop's solid in its own frame: full and empty cells, sample points, volume and centre.
//!
//! The solid is where the generalised winding number exceeds one half. An open prop is thereby capped. One that
//! encloses next to nothing (a sheet, a bundle of planes) counts as its convex hull, and as a thin plate when that is
//! flat too; [`SolidSource`] says which.

use super::extent::{bounding_sphere, smallest_extent};
use crate::hull::convex_hull;
use crate::interior::MeshInterior;
use crate::mesh::TriMesh;
use crate::{HOLLOW, SINGLE_PRECISION, enlarged_cell};
use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use serde::Serialize;

/// Thickness given to a flat prop, relative to its diameter.
const PLATE: f64 = 0.02;
/// Seeds the choice of sample points: any fixed value.
const SAMPLE_SEED: u64 = 1;

/// Source of a prop's solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SolidSource {
    /// A closed mesh.
    Closed,
    /// An open mesh, capped where its winding number exceeds one half.
    Capped,
    /// Its convex hull, since it encloses next to nothing.
    Hull,
    /// A plate around it, since its hull is flat too.
    Plate,
}

/// A prop's sizes at scale 1, before its cells are chosen.
pub(super) struct PropSize {
    region: MeshInterior,
    source: SolidSource,
    /// Centre and radius of the mesh's bounding sphere, metres.
    middle: DVec3,
    pub radius: f64,
    /// Smallest width of the solid, metres.
    pub thickness: f64,
}

impl PropSize {
    /// The mesh must have a triangle, and more than a single point.
    pub fn new(mesh: &TriMesh) -> PropSize {
        let (middle, radius) = bounding_sphere(mesh);
        assert!(radius > 0.0, "a prop without size");
        let outline = |mesh: &TriMesh, region, source| PropSize {
            region,
            source,
            middle,
            radius,
            thickness: smallest_extent(mesh),
        };
        let region = MeshInterior::new(mesh);
        // Less is no volume: single precision alone may make as much of a flat hull.
        let some = SINGLE_PRECISION * radius.powi(3);
        if !region.is_open() && region.volume() > some {
            return outline(mesh, region, SolidSource::Closed);
        }
        let hull = hull(&mesh.points, middle, radius);
        let hull_volume = hull.signed_volume().abs();
        if region.volume() > some.max(HOLLOW * hull_volume) {
            return outline(mesh, region, SolidSource::Capped);
        }
        if hull_volume > some {
            return outline(&hull, MeshInterior::new(&hull), SolidSource::Hull);
        }
        let half = PLATE * radius;
        let thick: Vec<DVec3> =
            mesh.points.iter().flat_map(|&p| DVec3::AXES.map(|a| [p + a * half, p - a * half])).flatten().collect();
        let plate = self::hull(&thick, middle, radius);
        outline(&plate, MeshInterior::new(&plate), SolidSource::Plate)
    }
}

/// A prop for measuring, at scale 1, in its own frame, metres.
pub(super) struct SolidCells {
    pub source: SolidSource,
    /// m^3.
    pub volume: f64,
    /// Centre of mass at even density.
    pub centre: DVec3,
    /// All of the solid is within `reach` of `centre`.
    pub reach: f64,
    /// Points spread evenly over the solid, shape `[n]`: each stands for the same part of its volume.
    pub samples: Vec<DVec3>,
    /// The corner of the first cell.
    pub lo: DVec3,
    /// Edges of a cell.
    pub cell: DVec3,
    /// Cells along X, Y, Z; they tile the solid's box exactly.
    pub size: [usize; 3],
    /// Shape `[z][y][x]`, 1 where the cell's centre is in the solid.
    pub cells: Vec<u8>,
    /// Whether the cells are coarser than wanted.
    pub capped: bool,
}

impl SolidCells {
    /// Cells of at most `wanted` metres, unless that would need more than `max_cells`; at most `max_samples` samples.
    pub fn new(outline: &PropSize, wanted: f64, max_cells: usize, max_samples: usize) -> SolidCells {
        let region = &outline.region;
        let (lo, hi) = region.bounds();
        let counts = |edge: f64| ((hi - lo) / edge).ceil().max(DVec3::ONE);
        let (edge, counts) = enlarged_cell(wanted, 1.05, max_cells.max(1) as f64, counts);
        let size = counts.to_array().map(|n| n as usize);
        let cell = (hi - lo) / counts;
        let mut cells = vec![0u8; size.iter().product()];
        let centre_of = |x: usize, row: usize| {
            lo + cell * (DVec3::new(x as f64, (row % size[1]) as f64, (row / size[1]) as f64) + 0.5)
        };
        cells.par_chunks_mut(size[0]).enumerate().for_each(|(row, cells)| {
            region.mark_row(centre_of(0, row), cell.x, cells);
        });
        let full: Vec<DVec3> =
            (0..cells.len()).filter(|&i| cells[i] != 0).map(|i| centre_of(i % size[0], i / size[0])).collect();
        let (samples, centre) = if full.is_empty() {
            // Thinner than the cells everywhere: one point has to do.
            (vec![outline.middle], outline.middle)
        } else {
            (spread(&full, max_samples.max(1)), full.iter().sum::<DVec3>() / full.len() as f64)
        };
        let box_corner = (centre - lo).abs().max((hi - centre).abs()).length();
        let reach = box_corner.min(if outline.source == SolidSource::Plate {
            f64::INFINITY
        } else {
            outline.radius + centre.distance(outline.middle)
        });
        let (source, volume) = (outline.source, region.volume());
        SolidCells { source, volume, centre, reach, samples, lo, cell, size, cells, capped: edge > wanted }
    }

    /// Whether a point of the prop's frame lies in a full cell.
    pub fn contains(&self, p: DVec3) -> bool {
        let at = ((p - self.lo) / self.cell).to_array();
        let inside = at.iter().zip(self.size).all(|(&x, n)| x >= 0.0 && x < n as f64);
        let [x, y, z] = at.map(|x| x as usize);
        inside && self.cells[(z * self.size[1] + y) * self.size[0] + x] != 0
    }
}

/// At most `n` of the points: one drawn from each of `n` equal stretches of the list, so that they are even without
/// keeping step with the grid.
fn spread(points: &[DVec3], n: usize) -> Vec<DVec3> {
    if points.len() <= n {
        return points.to_vec();
    }
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(SAMPLE_SEED);
    let stretch = points.len() as f64 / n as f64;
    (0..n).map(|i| points[(((i as f64) + rng.random::<f64>()) * stretch) as usize]).collect()
}

/// Convex hull; empty if there is none. The engine's hull works in single precision: it sees the unit ball.
fn hull(points: &[DVec3], middle: DVec3, radius: f64) -> TriMesh {
    let unit: Vec<_> = points.iter().map(|&p| ((p - middle) / radius).as_vec3()).collect();
    let Some((points, triangles)) = convex_hull(&unit) else { return TriMesh::default() };
    TriMesh { points: points.iter().map(|p| middle + p.as_dvec3() * radius).collect(), triangles }
}
