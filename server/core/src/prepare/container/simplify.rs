//! Meshes with fewer triangles: edges collapse where the surface hardly changes (Garland & Heckbert 1997).

use super::CollisionMesh;
use crate::geometry::HALVINGS;
use crate::geometry::interior;
use crate::geometry::mesh::TriMesh;
use meshoptimizer_rs::{Positions, SimplifyOptions, SimplifySettings, Workspace, simplify};

/// Simplifies a mesh: no removed corner is farther from the simplified mesh than `tolerance`, in the mesh's unit. The
/// corners of the result are corners of the mesh, and rims stay rims.
pub fn run(mesh: TriMesh, tolerance: f64) -> CollisionMesh {
    // The library bounds the mean error of a collapse, not the largest: its bound is halved until the largest is kept.
    let mut bounds = std::iter::successors(Some(tolerance), |bound| Some(bound / 2.0)).take(HALVINGS);
    let found = bounds.find_map(|bound| Some(coarser(&mesh, bound)?).filter(|found| found.deviation <= tolerance));
    found.unwrap_or(CollisionMesh { mesh, saved: 0, deviation: 0.0 })
}

fn coarser(mesh: &TriMesh, bound: f64) -> Option<CollisionMesh> {
    let triangles = collapsed(mesh, bound)?;
    let mut removed = vec![false; mesh.points.len()];
    mesh.triangles.iter().flatten().for_each(|&v| removed[v as usize] = true);
    triangles.iter().flatten().for_each(|&v| removed[v as usize] = false);
    let removed: Vec<_> = mesh.points.iter().zip(removed).filter_map(|(&p, removed)| removed.then_some(p)).collect();
    let saved = mesh.triangles.len() - triangles.len();
    let coarse = TriMesh { points: mesh.points.clone(), triangles };
    let deviation = interior::farthest(&coarse, &removed);
    Some(CollisionMesh { mesh: coarse, saved, deviation })
}

/// `None` without a bound, and beyond the library's bounds of work and memory: a fine mesh only costs time.
fn collapsed(mesh: &TriMesh, bound: f64) -> Option<Vec<[u32; 3]>> {
    if bound <= 0.0 {
        return None;
    }
    let positions: Vec<[f32; 3]> = mesh.points.iter().map(|p| p.as_vec3().to_array()).collect();
    let settings = SimplifySettings {
        target_index_count: 0,
        target_error: bound as f32,
        options: SimplifyOptions::ERROR_ABSOLUTE,
    };
    let corners = mesh.triangles.as_flattened();
    let found = simplify(corners, Positions::from_packed(&positions), settings, &mut Workspace::default()).ok()?;
    Some(found.indices.as_chunks().0.to_vec())
}
