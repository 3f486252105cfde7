//! How far visible meshes reach into scenery, by points on their surfaces: trusts nothing that the bake was made with.

use cairn_core::report::bake::Bake;
use cairn_geometry::interior::MeshInterior;
use cairn_geometry::measure::smallest_extent;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::topology;
use cairn_input::scene::Scene;
use glam::DVec3;

pub struct Judged {
    /// Bodies that cut scenery by more than a tenth of their thickness.
    pub cut: usize,
    /// Deepest cut, thicknesses.
    pub deepest: f64,
    /// Bodies that are below everything.
    pub lost: usize,
}

/// A tenth of a thickness.
const CUT: f64 = 0.1;

pub fn judge(scene: &Scene, bake: &Bake) -> Judged {
    let pieces: Vec<(MeshInterior, &TriMesh, bool)> = scene
        .statics
        .iter()
        .map(|model| {
            let mesh = &model.model.mesh;
            (MeshInterior::new(mesh), mesh, topology::inspect(mesh).closed)
        })
        .collect();
    let lowest = scene.statics.iter().map(|model| model.model.mesh.bounds().0.y).fold(f64::INFINITY, f64::min);
    let lowest = scene.control.iter().map(|model| model.mesh.bounds().0.y).fold(lowest, f64::min);
    let samples: Vec<(Vec<DVec3>, f64)> =
        scene.props.iter().map(|prop| (samples(&prop.model.mesh), smallest_extent(&prop.model.mesh))).collect();
    let mut judged = Judged { cut: 0, deepest: 0.0, lost: 0 };
    let Some(frame) = bake.pile.frames.last() else { return judged };
    for (body, pose) in bake.pile.bodies.iter().zip(frame) {
        let (points, thickness) = &samples[body.prop];
        let points: Vec<DVec3> = points.iter().map(|&p| pose.transform_point(p * body.scale)).collect();
        let depth = pieces.iter().map(|piece| depth(piece, &points)).fold(0.0, f64::max) / (thickness * body.scale);
        judged.cut += usize::from(depth > CUT);
        judged.deepest = judged.deepest.max(depth);
        judged.lost += usize::from(pose.translation.y < lowest - 0.5);
    }
    judged
}

/// How far a body reaches into a piece: the deepest of its points or, through a sheet, on its smaller side.
fn depth((region, mesh, closed): &(MeshInterior, &TriMesh, bool), points: &[DVec3]) -> f64 {
    let (low, high) = mesh.bounds();
    if points.iter().all(|p| p.cmplt(low).any()) || points.iter().all(|p| p.cmpgt(high).any()) {
        return 0.0;
    }
    if *closed {
        return points.iter().map(|&p| -region.signed_distance(p)).fold(0.0, f64::max);
    }
    let (mut above, mut below) = (0.0f64, 0.0f64);
    for &p in points {
        let (nearest, distance, triangle) = region.nearest(p);
        let [a, b, c] = mesh.corners(triangle);
        let side = (p - nearest).dot((b - a).cross(c - a).normalize_or_zero());
        // Beyond the rim there are no sides.
        if side.abs() > 0.999 * distance {
            (above, below) = (above.max(side), below.max(-side));
        }
    }
    above.min(below)
}

/// Points on all triangles, about an eighth of the size apart.
fn samples(mesh: &TriMesh) -> Vec<DVec3> {
    let spacing = mesh.bounds().0.distance(mesh.bounds().1) / 16.0;
    let mut points = mesh.points.clone();
    for [a, b, c] in (0..mesh.triangles.len()).map(|i| mesh.corners(i)) {
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        let n = (longest / spacing).ceil().clamp(1.0, 16.0) as usize;
        let place = |i: usize, k: usize| a + (b - a) * (i as f64 / n as f64) + (c - a) * (k as f64 / n as f64);
        points.extend((0..=n).flat_map(|i| (0..=n - i).map(move |k| (i, k))).map(|(i, k)| place(i, k)));
    }
    points
}
