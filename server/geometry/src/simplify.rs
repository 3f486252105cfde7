//! Meshes with fewer triangles: edges collapse where the surface hardly changes (Garland & Heckbert 1997).

use super::mesh::TriMesh;
use super::topology::weld;
use super::{HALVINGS, interior};
use glam::DVec3;
use meshoptimizer_rs::{Positions, SimplifyOptions, SimplifySettings, Workspace, simplify};

/// A dense mesh is simplified until it has so few triangles, or its tolerance is used up.
const ENOUGH: usize = 20_000;
/// More are never left of a dense mesh: where its tolerance does not allow for that, it is left behind.
const MOST: usize = 100_000;
/// Removed corners of a dense mesh at which its deviation is measured.
const SAMPLES: usize = 20_000;

/// A mesh with fewer triangles.
#[derive(Clone, Debug)]
pub struct Simplified {
    pub mesh: TriMesh,
    /// Triangles saved.
    pub saved: usize,
    /// The largest distance of a removed corner from the simplified mesh, in the mesh's unit; 0 where none was removed.
    pub deviation: f64,
}

/// Simplifies a mesh: no removed corner is farther from the simplified mesh than `tolerance`, in the mesh's unit. The
/// corners of the result are corners of the mesh, and rims stay rims.
pub fn run(mesh: TriMesh, tolerance: f64) -> Simplified {
    // The library bounds the mean error of a collapse, not the largest: its bound is halved until the largest is kept.
    let mut bounds = std::iter::successors(Some(tolerance), |bound| Some(bound / 2.0)).take(HALVINGS);
    let coarser = |bound| measured(&mesh, collapsed(&mesh, DVec3::ZERO, bound, 0)?, 1);
    let found = bounds.find_map(|bound| coarser(bound).filter(|found| found.deviation <= tolerance));
    found.unwrap_or(Simplified { mesh, saved: 0, deviation: 0.0 })
}

/// Simplifies a mesh of very many triangles to a few of them: as [`run`], but stops when these are [`ENOUGH`], goes
/// beyond the tolerance where more than [`MOST`] would be left, and measures the deviation at a sample of the removed
/// corners. The work grows with the triangles alone. `None` where nothing is saved.
pub fn dense(mesh: &TriMesh, tolerance: f64) -> Option<Simplified> {
    let (lo, hi) = mesh.bounds();
    let middle = (lo + hi) / 2.0;
    let within = collapsed(mesh, middle, tolerance, ENOUGH);
    let left = within.as_ref().map_or(mesh.triangles.len(), Vec::len);
    let triangles = match left > MOST {
        true => {
            let started =
                TriMesh { points: mesh.points.clone(), triangles: within.unwrap_or_else(|| mesh.triangles.clone()) };
            collapsed(&started, middle, lo.distance(hi), MOST)
        }
        false => within,
    };
    let corners = mesh.points.len();
    let found = measured(mesh, triangles?, corners.div_ceil(SAMPLES))?;
    Some(Simplified { mesh: weld(&found.mesh, 0.0), ..found })
}

/// The mesh with these triangles instead, and how far off it is at each removed corner of this stride. `None` where
/// there are no triangles.
fn measured(mesh: &TriMesh, triangles: Vec<[u32; 3]>, stride: usize) -> Option<Simplified> {
    if triangles.is_empty() {
        return None;
    }
    let mut removed = vec![false; mesh.points.len()];
    mesh.triangles.iter().flatten().for_each(|&v| removed[v as usize] = true);
    triangles.iter().flatten().for_each(|&v| removed[v as usize] = false);
    let removed = mesh.points.iter().zip(removed).filter_map(|(&p, removed)| removed.then_some(p));
    let removed: Vec<DVec3> = removed.step_by(stride).collect();
    let saved = mesh.triangles.len() - triangles.len();
    let coarse = TriMesh { points: mesh.points.clone(), triangles };
    let deviation = interior::farthest(&coarse, &removed);
    Some(Simplified { mesh: coarse, saved, deviation })
}

/// Collapses edges to about `target` triangles, by an error of `bound` at most; in single precision about `middle`.
/// `None` without a bound, and beyond the library's bounds of work and memory: a fine mesh only costs time.
fn collapsed(mesh: &TriMesh, middle: DVec3, bound: f64, target: usize) -> Option<Vec<[u32; 3]>> {
    if bound <= 0.0 {
        return None;
    }
    let positions: Vec<[f32; 3]> = mesh.points.iter().map(|p| (*p - middle).as_vec3().to_array()).collect();
    let corners = mesh.triangles.as_flattened();
    let settings = SimplifySettings {
        target_index_count: (3 * target).min(corners.len()),
        target_error: bound as f32,
        options: SimplifyOptions::ERROR_ABSOLUTE,
    };
    let found = simplify(corners, Positions::from_packed(&positions), settings, &mut Workspace::default()).ok()?;
    Some(found.indices.as_chunks().0.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A torus about this place, of `2 n^2` triangles, whose corners are off by `noise`.
    fn torus(n: u32, middle: DVec3, noise: f64) -> TriMesh {
        let turn = |i: u32| std::f64::consts::TAU * f64::from(i) / f64::from(n);
        let point = |i: u32, j: u32| {
            let off = f64::from((i * 7919 + j * 104_729) % 1009) / 1009.0 - 0.5;
            let (r, y) = ((0.15 + noise * off) * turn(j).cos(), (0.15 + noise * off) * turn(j).sin());
            middle + DVec3::new((0.35 + r) * turn(i).cos(), y, (0.35 + r) * turn(i).sin())
        };
        let points = (0..n).flat_map(|i| (0..n).map(move |j| point(i, j))).collect();
        let at = |i: u32, j: u32| i % n * n + j % n;
        let quad = |i: u32, j: u32| [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
        let two = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
        let triangles = (0..n).flat_map(|i| (0..n).flat_map(move |j| two(quad(i, j)))).collect();
        TriMesh { points, triangles }
    }

    #[test]
    fn a_dense_mesh_becomes_a_light_one_that_is_as_good() {
        let far = DVec3::new(1e4, 0.0, -3e3);
        let mesh = torus(200, far, 0.0);
        let found = dense(&mesh, 1e-3).expect("it has 80,000 triangles");
        assert!(found.mesh.triangles.len() <= ENOUGH && found.saved == 80_000 - found.mesh.triangles.len());
        assert!(found.deviation > 0.0 && found.deviation <= 1e-3, "{}", found.deviation);
        assert!(super::super::topology::inspect(&found.mesh).closed);
        let own = [&found.mesh, &mesh].map(|mesh| {
            TriMesh { points: mesh.points.iter().map(|p| *p - far).collect(), triangles: mesh.triangles.clone() }
                .signed_volume()
        });
        assert!((own[0] / own[1] - 1.0).abs() < 2e-3, "{own:?}");
    }

    #[test]
    fn what_is_rough_everywhere_is_still_made_light() {
        let mesh = torus(300, DVec3::ZERO, 0.01);
        let found = dense(&mesh, 1e-5).expect("it has 180,000 triangles");
        assert!(found.mesh.triangles.len() <= MOST && found.deviation > 1e-5, "the tolerance does not allow for that");
        assert!(found.deviation < 0.01, "{}", found.deviation);
    }
}
