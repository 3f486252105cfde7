//! Recognizes meshes that are boxes or balls, and finds the box around any mesh.

use super::mass;
use cairn_geometry::mesh::{TriMesh, bounds};
use glam::{DMat3, DQuat, DVec3};

/// A box with its own axes.
#[derive(Clone, Copy, Debug, serde::Serialize, serde::Deserialize)]
pub struct OrientedBox {
    pub center: DVec3,
    /// From the box's axes to the mesh's.
    pub rotation: DQuat,
    pub half: DVec3,
}

impl OrientedBox {
    pub fn volume(&self) -> f64 {
        8.0 * self.half.x * self.half.y * self.half.z
    }

    /// The axis along the shortest edge.
    pub fn thin_axis(&self) -> DVec3 {
        self.rotation * DVec3::AXES[self.half.min_position()]
    }

    /// Largest distance of a mesh corner to the box's surface, m.
    pub fn deviation(&self, mesh: &TriMesh) -> f64 {
        let back = self.rotation.inverse();
        let to_surface = |p: DVec3| {
            let q = (back * (p - self.center)).abs() - self.half;
            q.max(DVec3::ZERO).length() - q.max_element().min(0.0)
        };
        mesh.points.iter().map(|&p| to_surface(p)).fold(0.0, f64::max)
    }
}

/// The tightest of a few boxes around the points: along the mesh's axes, its largest faces and its principal axes.
pub fn oriented_box(mesh: &TriMesh) -> OrientedBox {
    let frames = [DMat3::IDENTITY, face_axes(mesh), DMat3::from_quat(mass::principal(point_inertia(mesh)).1)];
    let boxes = frames.map(|frame| box_along(mesh, frame));
    boxes.into_iter().reduce(|best, b| if tightness(&b) < tightness(&best) * 0.999 { b } else { best }).unwrap()
}

/// Compares boxes by volume, or by area when they are flat.
fn tightness(b: &OrientedBox) -> f64 {
    let floor = b.half.max_element() * 1e-3;
    let h = b.half.max(DVec3::splat(floor));
    h.x * h.y * h.z
}

fn box_along(mesh: &TriMesh, frame: DMat3) -> OrientedBox {
    let back = frame.transpose();
    let (lo, hi) = bounds(mesh.points.iter().map(|&p| back * p));
    let rotation = DQuat::from_mat3(&frame).normalize();
    OrientedBox { center: frame * ((lo + hi) / 2.0), rotation, half: (hi - lo) / 2.0 }
}

/// Axes along the largest face and the largest face square to it.
fn face_axes(mesh: &TriMesh) -> DMat3 {
    let normals: Vec<DVec3> = (0..mesh.triangles.len())
        .map(|i| {
            let [a, b, c] = mesh.corners(i);
            (b - a).cross(c - a)
        })
        .collect();
    let largest = |weight: &dyn Fn(DVec3) -> f64| {
        normals.iter().copied().reduce(|best, n| if weight(n) > weight(best) * 1.000001 { n } else { best })
    };
    let Some(x) = largest(&|n| n.length()).and_then(DVec3::try_normalize) else { return DMat3::IDENTITY };
    let square = |n: DVec3| n.length() * if n.normalize_or_zero().dot(x).abs() < 0.05 { 1.0 } else { 0.0 };
    let across = largest(&square).map(|n| n - x * n.dot(x)).and_then(DVec3::try_normalize);
    let y = across.unwrap_or_else(|| x.any_orthonormal_vector());
    DMat3::from_cols(x, y, x.cross(y))
}

fn point_inertia(mesh: &TriMesh) -> DMat3 {
    let n = mesh.points.len().max(1) as f64;
    let mean = mesh.points.iter().sum::<DVec3>() / n;
    mesh.points.iter().fold(DMat3::ZERO, |sum, &p| {
        let v = p - mean;
        sum + DMat3::from_cols(v * v.x, v * v.y, v * v.z)
    })
}

/// A sphere around all points, close to the smallest one (Badoiu & Clarkson 2003: steps toward the farthest point that
/// shrink as 1/i; 200 of them end within about 1 %, and the radius is then exact for the centre found).
pub fn bounding_sphere(mesh: &TriMesh) -> (DVec3, f64) {
    let (lo, hi) = mesh.bounds();
    let mut center = (lo + hi) / 2.0;
    let farthest = |c: DVec3| {
        mesh.points.iter().copied().fold((c, 0.0), |best, p| {
            let r = p.distance(c);
            if r > best.1 { (p, r) } else { best }
        })
    };
    let mut best = (center, farthest(center).1);
    for i in 1..=200 {
        let (p, r) = farthest(center);
        if r < best.1 {
            best = (center, r);
        }
        center += (p - center) / (i as f64 + 1.0);
    }
    best
}

/// Distance of the nearest plane of a triangle, m: no point of the mesh is nearer to `center`.
pub fn inner_radius(mesh: &TriMesh, center: DVec3) -> f64 {
    let height = |i: usize| {
        let [a, b, c] = mesh.corners(i);
        Some((a - center).dot((b - a).cross(c - a).try_normalize()?).abs())
    };
    (0..mesh.triangles.len()).filter_map(height).fold(f64::INFINITY, f64::min)
}
