//! Hulls around a whole pile, for what looks at it from outside.

use super::convex::{hull_mesh, reduced, split};
use cairn_geometry::mesh::TriMesh;
use glam::DVec3;
use rapier3d::math::Vector;
use rapier3d::parry::transformation::vhacd::VHACDParameters;
use rapier3d::parry::transformation::voxelization::FillMode;

/// How far a corner may stand out of an outer hull of a mesh of size 1.
const OUTER_TOLERANCE: f32 = 0.01;

/// At most `most` convex solids that together hold a mesh and the room that it surrounds, with few corners each: one
/// around all where no split succeeds. Nothing is simulated with them here.
pub fn outer_hulls(mesh: &TriMesh, most: u32) -> Vec<TriMesh> {
    let (low, high) = mesh.bounds();
    let (middle, size) = ((low + high) / 2.0, (high - low).max_element());
    let points: Vec<Vector> = mesh.points.iter().map(|p| ((*p - middle) / size).as_vec3()).collect();
    let fill_mode = FillMode::FloodFill { detect_cavities: false };
    let params = VHACDParameters { max_convex_hulls: most, fill_mode, ..VHACDParameters::default() };
    let mut parts = split(&params, &points, &mesh.triangles).unwrap_or_default();
    parts.retain(|part| part.len() >= 4);
    if parts.is_empty() || parts.len() > most as usize {
        parts = vec![points];
    }
    let solid = |part: Vec<Vector>| {
        let corners: Vec<DVec3> =
            reduced(&part, OUTER_TOLERANCE).iter().map(|p| middle + p.as_dvec3() * size).collect();
        hull_mesh(&corners)
    };
    parts.into_iter().map(solid).filter(|hull| !hull.triangles.is_empty()).collect()
}
