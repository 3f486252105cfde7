//! Props that roll: they are round about an axis.

use super::fit::OrientedBox;
use cairn_geometry::mesh::TriMesh;
use glam::DVec3;

/// Directions across an axis in which the radius is measured.
const DIRECTIONS: u32 = 32;
/// The least radius over the largest one: a regular prism of 12 sides is round, a pencil of six is not.
const ROUNDNESS: f64 = 0.96;

/// The radius on which a prop rolls, m: that of a ball, a cylinder, a capsule, a coin or nearly one of these, about one
/// of the axes of its box. `None` where it does not roll. The largest, where there are several.
pub fn rolling_radius(mesh: &TriMesh, around: &OrientedBox) -> Option<f64> {
    let back = around.rotation.inverse();
    let points: Vec<DVec3> = mesh.points.iter().map(|&p| back * (p - around.center)).collect();
    let about = |axis: usize| {
        let (u, v) = (DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]);
        let radius = |k: u32| {
            let (sin, cos) = libm::sincos(f64::from(k) / f64::from(DIRECTIONS) * std::f64::consts::TAU);
            let direction = u * cos + v * sin;
            points.iter().map(|p| p.dot(direction)).fold(0.0, f64::max)
        };
        let radii: Vec<f64> = (0..DIRECTIONS).map(radius).collect();
        let (least, most) = radii.iter().fold((f64::INFINITY, 0.0), |(lo, hi): (f64, f64), &r| (lo.min(r), hi.max(r)));
        (most > 0.0 && least >= ROUNDNESS * most).then_some((least + most) / 2.0)
    };
    (0..3).filter_map(about).reduce(f64::max)
}
