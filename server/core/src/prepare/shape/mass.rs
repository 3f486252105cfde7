//! Volume, centre of mass and inertia of a solid bounded by triangles, in f64.

use crate::geometry::mesh::TriMesh;
use crate::geometry::{MOST_ITERATIONS, TOLERANCE};
use glam::{DMat3, DQuat, DVec3};

/// Mass properties at density 1, in the mesh's frame.
#[derive(Clone, Copy, Debug)]
pub struct Moments {
    /// m^3; negative for a mesh that is inside out.
    pub volume: f64,
    /// Centre of mass, m.
    pub center: DVec3,
    /// Inertia about the centre, m^5 (kg m^2 at density 1).
    pub inertia: DMat3,
}

impl Moments {
    /// Whether a body within these bounds can have them. A closed mesh whose parts cross each other, some inside out,
    /// may have a positive volume and yet a centre outside, and negative moments.
    pub fn are_of_a_body(&self, bounds: (DVec3, DVec3)) -> bool {
        let (moments, _) = principal(self.inertia);
        let sum = moments.element_sum();
        let is_inside = self.center.cmpge(bounds.0).all() && self.center.cmple(bounds.1).all();
        // No moment exceeds the sum of the two others, up to rounding: a needle's smallest is nearly zero.
        is_inside && sum > 0.0 && moments.max_element() <= sum * (0.5 + TOLERANCE)
    }
}

/// Integrates over the signed tetrahedra from one corner of the bounding box to each triangle (the divergence theorem;
/// exact for a closed mesh, whatever its shape).
pub fn moments(mesh: &TriMesh) -> Moments {
    let origin = mesh.bounds().0;
    let (mut volume, mut first, mut second) = (0.0, DVec3::ZERO, DMat3::ZERO);
    for i in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(i).map(|p| p - origin);
        let v = a.dot(b.cross(c)) / 6.0;
        let s = a + b + c;
        volume += v;
        first += v * s / 4.0;
        // Integral of x x^T over the tetrahedron (0, a, b, c).
        second += (outer(a) + outer(b) + outer(c) + outer(s)) * (v / 20.0);
    }
    if volume == 0.0 || !volume.is_finite() {
        return Moments { volume: 0.0, center: origin, inertia: DMat3::ZERO };
    }
    let center = first / volume;
    let covariance = second - outer(center) * volume;
    let trace = covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z;
    Moments { volume, center: center + origin, inertia: DMat3::from_diagonal(DVec3::splat(trace)) - covariance }
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// Principal moments and the rotation from the principal frame, of a symmetric matrix: cyclic Jacobi rotations, which
/// for three rows converge in a few sweeps and never fail.
pub fn principal(m: DMat3) -> (DVec3, DQuat) {
    let mut a = m.to_cols_array_2d();
    let mut v = DMat3::IDENTITY.to_cols_array_2d();
    for _ in 0..MOST_ITERATIONS {
        let before = a;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q].abs() <= f64::EPSILON * (a[p][p].abs() + a[q][q].abs()) {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            rotate_rows(&mut a, p, q, c, s);
            for row in &mut a {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            rotate_rows(&mut v, p, q, c, s);
        }
        if a == before {
            break;
        }
    }
    let mut frame = DMat3::from_cols_array_2d(&v);
    if frame.determinant() < 0.0 {
        frame.z_axis = -frame.z_axis;
    }
    (DVec3::new(a[0][0], a[1][1], a[2][2]), DQuat::from_mat3(&frame).normalize())
}

fn rotate_rows(m: &mut [[f64; 3]; 3], p: usize, q: usize, c: f64, s: f64) {
    let (x, y) = (DVec3::from_array(m[p]), DVec3::from_array(m[q]));
    m[p] = (c * x - s * y).to_array();
    m[q] = (s * x + c * y).to_array();
}
