//! Volume, centre of mass and inertia of a solid bounded by triangles, in f64.

use cairn_geometry::interior::Surplus;
use cairn_geometry::mesh::{TriMesh, tetrahedron_volume};
use cairn_geometry::{MOST_ITERATIONS, SINGLE_PRECISION, TOLERANCE};
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
        // That of a sheet is in its plane, up to rounding.
        let rounding = DVec3::splat(SINGLE_PRECISION * bounds.0.distance(bounds.1));
        let is_inside = self.center.cmpge(bounds.0 - rounding).all() && self.center.cmple(bounds.1 + rounding).all();
        // No moment exceeds the sum of the two others, up to rounding: a needle's smallest is nearly zero.
        is_inside && sum > 0.0 && moments.max_element() <= sum * (0.5 + TOLERANCE)
    }
}

/// Those of the solid that a mesh bounds: where parts of it overlap, they count once. Exact for a mesh of one part, and
/// for parts that are apart or only touch; what overlaps is sampled on a grid of 40 points along each axis of the box.
pub fn of_solid(mesh: &TriMesh, has_parts: bool) -> Moments {
    let all = integrate(mesh);
    if !has_parts {
        return all.moments();
    }
    let Surplus { volume, first, second } = Surplus::of(mesh, all.origin);
    if volume == 0.0 && first == DVec3::ZERO {
        return all.moments();
    }
    Integrals { volume: all.volume - volume, first: all.first - first, second: all.second - second, ..all }.moments()
}

/// Integrals of 1, x and x x^T about an origin.
struct Integrals {
    origin: DVec3,
    volume: f64,
    first: DVec3,
    second: DMat3,
}

/// Integrates over the signed tetrahedra from one corner of the bounding box to each triangle (the divergence theorem;
/// exact for a closed mesh, whatever its shape).
pub fn moments(mesh: &TriMesh) -> Moments {
    integrate(mesh).moments()
}

fn integrate(mesh: &TriMesh) -> Integrals {
    let origin = mesh.bounds().0;
    let (mut volume, mut first, mut second) = (0.0, DVec3::ZERO, DMat3::ZERO);
    for i in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(i).map(|p| p - origin);
        let v = tetrahedron_volume([a, b, c]);
        let s = a + b + c;
        volume += v;
        first += v * s / 4.0;
        // Integral of x x^T over the tetrahedron (0, a, b, c).
        second += (outer(a) + outer(b) + outer(c) + outer(s)) * (v / 20.0);
    }
    Integrals { origin, volume, first, second }
}

impl Integrals {
    fn moments(self) -> Moments {
        let Integrals { origin, volume, first, second } = self;
        if volume == 0.0 || !volume.is_finite() {
            return Moments { volume: 0.0, center: origin, inertia: DMat3::ZERO };
        }
        let center = first / volume;
        let covariance = second - outer(center) * volume;
        let trace = covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z;
        Moments { volume, center: center + origin, inertia: DMat3::from_diagonal(DVec3::splat(trace)) - covariance }
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::Size;
    use cairn_geometry::topology::inspect;

    /// Boxes between these corners, as one mesh.
    fn boxes(corners: &[[DVec3; 2]]) -> TriMesh {
        let mut mesh = TriMesh::default();
        for &[lo, hi] in corners {
            let corner = |i: usize| DVec3::new([lo.x, hi.x][i & 1], [lo.y, hi.y][i >> 1 & 1], [lo.z, hi.z][i >> 2]);
            let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
            let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
            mesh.append(&TriMesh { points: (0..8).map(corner).collect(), triangles });
        }
        mesh
    }

    /// As an asset is read: equal points are one.
    fn size(mesh: &TriMesh) -> (TriMesh, Size) {
        let welded = cairn_geometry::topology::weld(mesh, 0.0);
        let size = Size::of(&welded);
        (welded, size)
    }

    fn corners(x: f64, y: f64) -> [DVec3; 2] {
        [DVec3::new(x, y, 0.0), DVec3::new(x + 1.0, y + 1.0, 1.0)]
    }

    #[test]
    fn parts_that_touch_exactly_bound_a_solid() {
        // Along a face, along an edge, at a corner.
        for other in [corners(1.0, 0.0), corners(1.0, 1.0), [DVec3::ONE, DVec3::splat(2.0)]] {
            let (mesh, size) = size(&boxes(&[corners(0.0, 0.0), other]));
            assert!(size.closed, "{:?}", inspect(&mesh));
            assert!((size.volume - 2.0).abs() < 1e-12, "{}", size.volume);
        }
        // A face that hangs on an edge bounds nothing.
        let (mut flap, _) = size(&boxes(&[corners(0.0, 0.0)]));
        flap.points.push(DVec3::splat(2.0));
        flap.triangles.push([0, 1, 8]);
        // What its root encloses is known, although the mesh is open.
        let leaf = Size::of(&flap);
        assert!(!leaf.closed && (leaf.enclosed - 1.0).abs() < 0.05, "{}", leaf.enclosed);
        // A missing face is a hole.
        let (mut open, _) = size(&boxes(&[corners(0.0, 0.0)]));
        open.triangles.pop();
        assert!(!Size::of(&open).closed);
    }

    #[test]
    fn overlapping_parts_count_once() {
        // Two boxes that make one of 1.5 x 1 x 1 m.
        let (mesh, size) = size(&boxes(&[corners(0.0, 0.0), corners(0.5, 0.0)]));
        let long = moments(&boxes(&[[DVec3::ZERO, DVec3::new(1.5, 1.0, 1.0)]]));
        let found = of_solid(&mesh, size.has_parts);
        // The grid's cells are 1/40 of the box.
        assert!((found.volume - 1.5).abs() < 0.04 && (size.volume - found.volume).abs() < 1e-12, "{}", found.volume);
        assert!(found.center.distance(long.center) < 0.01, "{}", found.center);
        let (own, expected) = (principal(found.inertia).0, principal(long.inertia).0);
        assert!((own - expected).abs().max_element() < 0.03 * expected.max_element(), "{own} {expected}");
        // One within another: the inner one adds nothing.
        let inner = [DVec3::splat(0.3), DVec3::splat(0.7)];
        let (mesh, _) = self::size(&boxes(&[corners(0.0, 0.0), inner]));
        assert!((of_solid(&mesh, true).volume - 1.0).abs() < 0.02);
    }

    #[test]
    fn what_does_not_overlap_is_exact() {
        for parts in
            [&[corners(0.0, 0.0)][..], &[corners(0.0, 0.0), corners(1.0, 0.0)], &[corners(0.0, 0.0), corners(3.0, 0.0)]]
        {
            let (mesh, size) = size(&boxes(parts));
            let (plain, found) = (moments(&mesh), of_solid(&mesh, size.has_parts));
            assert_eq!((found.volume, found.center, found.inertia), (plain.volume, plain.center, plain.inertia));
        }
    }
}
