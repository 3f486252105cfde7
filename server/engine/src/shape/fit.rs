//! Recognizes meshes that are boxes or balls, and finds the box around any mesh.

use super::mass;
use cairn_geometry::mesh::{TriMesh, bounds};
use cairn_geometry::rectangle::{convex_hull, smallest_rectangle};
use glam::{DMat3, DQuat, DVec2, DVec3};

/// The sine of an angle below which two faces count as square or as parallel: 3 degrees.
const SMALL_ANGLE: f64 = 0.05;
/// An outline that fills this share of its smallest rectangle is one, up to its corners; others have no edge to go by.
const RECTANGLE: f64 = 0.9;

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

    /// Corners, without an order.
    pub fn corners(&self) -> impl Iterator<Item = DVec3> + '_ {
        let sign = |corner: usize, axis: usize| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
        let at = move |corner| DVec3::new(sign(corner, 0), sign(corner, 1), sign(corner, 2)) * self.half;
        (0..8).map(move |corner| self.center + self.rotation * at(corner))
    }

    /// The share of its largest faces that the outline of a mesh fills, as seen along the thin axis.
    pub fn share(&self, mesh: &TriMesh) -> f64 {
        let (u, v) = self.thin_axis().any_orthonormal_pair();
        let [_, width, length] = sorted(self.half * 2.0);
        area(&outline(mesh, u, v)) / (width * length)
    }

    /// The outline of a mesh as seen along the thin axis, on both of these faces of the box: corners of a plate.
    pub fn plate(&self, mesh: &TriMesh) -> Vec<DVec3> {
        let normal = self.thin_axis();
        let (u, v) = normal.any_orthonormal_pair();
        let middle = normal * self.center.dot(normal);
        let half = normal * self.half.min_element();
        let place = |p: DVec2| [-half, half].map(|height| middle + u * p.x + v * p.y + height);
        outline(mesh, u, v).into_iter().flat_map(place).collect()
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
    // Flat ones are compared by area.
    let floor = boxes.iter().map(|b| b.half.max_element()).fold(0.0, f64::max) * 1e-3;
    let tightness = |b: &OrientedBox| b.half.max(DVec3::splat(floor)).element_product();
    boxes.into_iter().reduce(|best, b| if tightness(&b) < tightness(&best) * 0.999 { b } else { best }).unwrap()
}

fn box_along(mesh: &TriMesh, frame: DMat3) -> OrientedBox {
    let back = frame.transpose();
    let (lo, hi) = bounds(mesh.points.iter().map(|&p| back * p));
    let rotation = DQuat::from_mat3(&frame).normalize();
    OrientedBox { center: frame * ((lo + hi) / 2.0), rotation, half: (hi - lo) / 2.0 }
}

/// Axes along the largest face and the largest face square to it. Where no face is square to it, along the first face
/// across it; where that is parallel, along the outline.
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
    let square = |n: DVec3| n.length() * if n.normalize_or_zero().dot(x).abs() < SMALL_ANGLE { 1.0 } else { 0.0 };
    // What is left of a parallel normal is rounding, in any direction: no axis.
    let across = largest(&square)
        .map(|n| (n, n - x * n.dot(x)))
        .filter(|(n, across)| across.length() > SMALL_ANGLE * n.length())
        .and_then(|(_, across)| across.try_normalize());
    let y = across.unwrap_or_else(|| outline_axis(mesh, x));
    DMat3::from_cols(x, y, x.cross(y))
}

/// An axis square to `normal`: along an edge of the mesh's outline where that is a rectangle.
fn outline_axis(mesh: &TriMesh, normal: DVec3) -> DVec3 {
    let (u, v) = normal.any_orthonormal_pair();
    let points = outline(mesh, u, v);
    let (turn, edges) = smallest_rectangle(&points);
    if area(&points) < RECTANGLE * edges.x * edges.y {
        return normal.any_orthonormal_vector();
    }
    (u * libm::cos(turn) + v * libm::sin(turn)).normalize()
}

fn sorted(lengths: DVec3) -> [f64; 3] {
    let mut lengths = lengths.to_array();
    lengths.sort_by(f64::total_cmp);
    lengths
}

/// The hull of a mesh's corners in the plane of two axes.
fn outline(mesh: &TriMesh, u: DVec3, v: DVec3) -> Vec<DVec2> {
    let points: Vec<DVec2> = mesh.points.iter().map(|p| DVec2::new(p.dot(u), p.dot(v))).collect();
    convex_hull(&points)
}

/// Of a polygon, counter-clockwise.
fn area(outline: &[DVec2]) -> f64 {
    let pairs = outline.iter().zip(outline.iter().cycle().skip(1));
    pairs.map(|(a, b)| a.perp_dot(*b)).sum::<f64>() / 2.0
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
