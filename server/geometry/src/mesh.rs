//! A triangle soup with shared points: the geometry of a model, as the core keeps it.
//!
//! SI metres, glTF axes (Y up, right-handed), counter-clockwise triangles seen from outside.

use glam::{DAffine3, DVec3};

/// Points and triangles. Every index is below `points.len()` and every coordinate is finite:
/// the reader refuses anything else, so nothing behind it checks again.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct TriMesh {
    /// Shape `[n]`, metres.
    pub points: Vec<DVec3>,
    /// Shape `[m][3]`, indices into `points`.
    pub triangles: Vec<[u32; 3]>,
}

impl TriMesh {
    /// The three corners of triangle `i`.
    pub fn corners(&self, i: usize) -> [DVec3; 3] {
        self.triangles[i].map(|v| self.points[v as usize])
    }

    /// The same mesh seen through `map`; a mirroring map also turns the triangles, so that they
    /// still face outward.
    pub fn transformed(&self, map: &DAffine3) -> TriMesh {
        let mirrored = map.matrix3.determinant() < 0.0;
        let points = self.points.iter().map(|&p| map.transform_point3(p)).collect();
        let turn = |[a, b, c]: [u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
        TriMesh { points, triangles: self.triangles.iter().map(|&t| turn(t)).collect() }
    }

    /// The same mesh, larger by `factor`.
    pub fn scaled(&self, factor: f64) -> TriMesh {
        self.transformed(&DAffine3::from_scale(DVec3::splat(factor)))
    }

    /// Adds another mesh's triangles to this one.
    pub fn append(&mut self, other: &TriMesh) {
        let base = self.points.len() as u32;
        self.points.extend_from_slice(&other.points);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + base)));
    }

    /// Smallest and largest corner of the axis-aligned box around all points.
    /// Both are NaN-free; an empty mesh gives `(+inf, -inf)`.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        bounds(self.points.iter().copied())
    }

    /// m^2.
    pub fn area(&self) -> f64 {
        let area = |triangle: usize| {
            let [a, b, c] = self.corners(triangle);
            (b - a).cross(c - a).length() / 2.0
        };
        (0..self.triangles.len()).map(area).sum()
    }

    /// Volume enclosed, in m^3: negative for a mesh that is inside out, meaningless for an open one.
    pub fn signed_volume(&self) -> f64 {
        self.volume_about(self.bounds().0, 0..self.triangles.len())
    }

    /// Volume between a point and some of the triangles, m^3: positive where the point is behind one.
    pub fn volume_about(&self, origin: DVec3, triangles: impl Iterator<Item = usize>) -> f64 {
        triangles.map(|i| tetrahedron_volume(self.corners(i).map(|p| p - origin))).sum()
    }

    /// The same mesh, with all triangles reversed if it is inside out as a whole.
    pub fn outward(&self) -> std::borrow::Cow<'_, TriMesh> {
        if self.signed_volume() >= 0.0 {
            return std::borrow::Cow::Borrowed(self);
        }
        let triangles = self.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
        std::borrow::Cow::Owned(TriMesh { points: self.points.clone(), triangles })
    }
}

/// Smallest and largest corner of the axis-aligned box around some points; `(+inf, -inf)` without any.
pub fn bounds(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)))
}

/// Width of some points along a direction; `-inf` without any.
pub fn width(points: &[DVec3], along: DVec3) -> f64 {
    let heights = points.iter().map(|p| p.dot(along));
    let (lo, hi) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), h| (lo.min(h), hi.max(h)));
    hi - lo
}

/// Whether two boxes come as near to each other as `reach`, along each axis.
pub fn boxes_meet(a: (DVec3, DVec3), b: (DVec3, DVec3), reach: DVec3) -> bool {
    a.0.cmple(b.1 + reach).all() && a.1.cmpge(b.0 - reach).all()
}

/// Whether a box holds another one.
pub fn box_holds(outer: (DVec3, DVec3), inner: (DVec3, DVec3)) -> bool {
    outer.0.cmple(inner.0).all() && outer.1.cmpge(inner.1).all()
}

/// Signed volume between the origin and a triangle: positive where the origin is behind it.
pub fn tetrahedron_volume([a, b, c]: [DVec3; 3]) -> f64 {
    a.dot(b.cross(c)) / 6.0
}

/// Signed solid angle of a triangle, seen from `p` (Van Oosterom & Strackee 1983, Eq. 8). Finite everywhere, also on
/// the triangle.
pub fn solid_angle(p: DVec3, triangle: &[DVec3; 3]) -> f64 {
    let [a, b, c] = triangle.map(|v| v - p);
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let volume = a.dot(b.cross(c));
    let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * libm::atan2(volume, denominator)
}
