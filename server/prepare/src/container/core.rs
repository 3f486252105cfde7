//! The core of a pile that is a shell of props: the inside of the control mesh below them, unseen and at rest.

use super::{MAX_GRID_NODES, surface, without_base};
use cairn_engine::shape::hull_mesh;
use cairn_geometry::interior::{DistanceGrid, MeshInterior};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::simplify;
use cairn_geometry::{ClosedMesh, RESOLUTION};

/// Props lie on it instead of on others. SI.
#[derive(Clone, Debug)]
pub struct Core {
    /// Closed, facing outward. Where the control mesh has its base, it reaches into the ground.
    pub mesh: TriMesh,
    /// Its share of the control mesh's volume, m^3, and the surface that props meet, m^2.
    pub volume: f64,
    pub area: f64,
    /// It is its own convex hull.
    pub is_convex: bool,
}

/// The surface of the core may be made coarser by this much, d.
const TOLERANCE: f64 = 0.05;
/// Its convex hull replaces it where that takes less than this times its volume: on a mesh, some props never rest.
const CONVEX: f64 = 1.03;
/// It reaches so deep into the ground, d.
const DEPTH: f64 = 0.5;

impl Core {
    /// All points deeper inside `control` than `shell`; its base is up to `cut` above the ground at `ground`.
    /// `diameter`: d. All in m. `None`: no point is so deep.
    pub fn new(control: &ClosedMesh, ground: f64, cut: f64, shell: f64, diameter: f64) -> Option<Core> {
        let base = control.mesh.bounds().0.y.max(ground);
        let lengthened = lengthened(&control.mesh, base, cut, shell + DEPTH * diameter);
        // Nodes twice as far apart as the container's: nobody sees the core.
        let spacing = 2.0 * RESOLUTION * diameter;
        let exact = [shell + 2.0 * spacing, spacing];
        let distance = DistanceGrid::new(&MeshInterior::new(&lengthened), spacing, MAX_GRID_NODES / 8, exact);
        let fine = surface(&distance, shell);
        if fine.triangles.is_empty() {
            return None;
        }
        let area = (0..fine.triangles.len()).map(|i| fine.corners(i)).filter(|[a, b, c]| a.y + b.y + c.y > 3.0 * base);
        let area = area.map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum();
        let mut mesh = simplify::run(fine, TOLERANCE * diameter).mesh;
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        let hull = hull_mesh(&mesh.points);
        let is_convex = (1.0..CONVEX).contains(&(hull.signed_volume() / mesh.signed_volume()));
        if is_convex {
            mesh = hull;
        }
        Some(Core { volume: volume(&distance, shell, base), area, mesh, is_convex })
    }
}

/// The mesh with its base drawn down by `depth`, so that no place is near the base.
fn lengthened(mesh: &TriMesh, base: f64, cut: f64, depth: f64) -> TriMesh {
    let (mut whole, bottom) = without_base(mesh, base, cut, depth);
    let first = whole.points.len() as u32;
    whole.points.extend(mesh.points.iter().map(|p| p.with_y(base - depth)));
    whole.triangles.extend(bottom.iter().map(|t| t.map(|v| first + v)));
    whole
}

/// Volume above `base` of the points deeper than `shell`.
fn volume(distance: &DistanceGrid, shell: f64, base: f64) -> f64 {
    let (origin, [nx, ny, _], values) = distance.nodes();
    let spacing = distance.spacing();
    let height = |i: usize| origin.y + (i / nx % ny) as f64 * spacing;
    let deep = values.iter().enumerate().filter(|&(i, &value)| value <= -shell && height(i) > base);
    deep.count() as f64 * spacing.powi(3)
}
