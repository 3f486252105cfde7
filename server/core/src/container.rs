//! The control mesh as a container: walls that face inward, and a base on the ground.
//!
//! The mesh stays upright while it is filled under upward gravity: turning over is then a change of sign.

use crate::mesh::TriMesh;
use crate::region::{DistanceGrid, Region};
use glam::{DAffine3, DVec3};

/// Walls for the fill, in engine units.
pub struct Container {
    /// Triangles facing inward; closed.
    pub walls: TriMesh,
    /// Distance to the wall, negative inside.
    pub distance: DistanceGrid,
    /// Height of the base, which a half-space closes as well.
    pub base: f64,
    pub volume: f64,
    pub low: DVec3,
    pub high: DVec3,
}

/// Nodes of the distance grid along the container's longest side; a prop is checked against it, so that it must be
/// finer than the props.
const MAX_GRID_NODES: usize = 2_000_000;
/// Grid spacing, in diameters of the median prop.
const GRID_SPACING: f64 = 0.1;

impl Container {
    /// `control` in SI, `length` metres per engine unit.
    pub fn new(control: &TriMesh, length: f64, ground: f64) -> Container {
        let solid = control.transformed(&DAffine3::from_scale(DVec3::splat(1.0 / length)));
        let region = Region::new(&solid);
        let distance = DistanceGrid::new(&region, GRID_SPACING, MAX_GRID_NODES);
        let (low, high) = solid.bounds();
        let base = low.y.max(ground / length);
        let flip = |&[a, b, c]: &[u32; 3]| [a, c, b];
        let outward = !region.was_inside_out();
        let walls = TriMesh {
            triangles: if outward { solid.triangles.iter().map(flip).collect() } else { solid.triangles.clone() },
            points: solid.points,
        };
        Container { walls, distance, base, volume: region.volume(), low, high }
    }

    /// Whether all points lie inside, up to `slack`.
    pub fn holds(&self, mut points: impl Iterator<Item = DVec3>, slack: f64) -> bool {
        points.all(|p| p.y >= self.base - slack && self.distance.signed_distance(p) <= slack)
    }
}
