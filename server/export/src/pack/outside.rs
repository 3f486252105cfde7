//! Which triangles of a heap anybody sees from outside.
//!
//! From points spread over each triangle, rays go out in many directions, upward and downward, to the front of the
//! triangle and to its back. A triangle is seen if one of them meets nothing. So what is seen through a gap is kept,
//! however small the triangle is; what is seen only between all of the points, or between all of the directions, is
//! not.

use cairn_geometry::rays::{Ray, RaySoup, Triangle};
use glam::{Vec3, Vec3A};
use rayon::prelude::*;

/// Directions in which one may look at a point.
const DIRECTIONS: u32 = 96;
/// Points of a triangle, at least and at most.
const POINTS: (f32, f32) = (3.0, 64.0);
/// How far a ray begins off its triangle, for a heap of size 1.
const OFF: f32 = 1e-5;

/// For each triangle, whether it is seen. `spacing`: between its points, in the unit of the points.
pub fn seen(points: &[[f32; 3]], triangles: &[[u32; 3]], spacing: f64) -> Vec<bool> {
    let at = |corner: u32| Vec3::from(points[corner as usize]);
    let corners = || triangles.iter().flatten().map(|&corner| at(corner));
    let (low, high) = (corners().fold(Vec3::INFINITY, Vec3::min), corners().fold(Vec3::NEG_INFINITY, Vec3::max));
    let (middle, size) = ((low + high) / 2.0, (high - low).max_element().max(f32::MIN_POSITIVE));
    let unit = |corner: u32| Vec3A::from((at(corner) - middle) / size);
    let own: Vec<Triangle> = triangles.iter().map(|&corners| Triangle(corners.map(unit))).collect();
    let soup = RaySoup::new(&own);
    let directions: Vec<Vec3A> = (0..DIRECTIONS).map(direction).collect();
    let spacing = spacing as f32 / size;
    let is_clear = |from: Vec3A, direction: Vec3A| soup.is_clear(&Ray::new(from + OFF * direction, direction));
    let is_seen = |triangle: &Triangle| {
        let [corner, b, c] = triangle.0;
        let (one, other) = (b - corner, c - corner);
        let normal = one.cross(other);
        let count = (normal.length() / 2.0 / (spacing * spacing)).clamp(POINTS.0, POINTS.1) as u32;
        let points = (0..count).map(|k| {
            let (u, v) = spread(k);
            corner + one * u + other * v
        });
        // Most of what is seen is seen from its front.
        let (front, back): (Vec<Vec3A>, Vec<Vec3A>) = directions.iter().partition(|way| way.dot(normal) > 0.0);
        points.clone().any(|from| front.iter().any(|&way| is_clear(from, way)))
            || points.clone().any(|from| back.iter().any(|&way| is_clear(from, way)))
    };
    own.par_iter().map(is_seen).collect()
}

/// Evenly spread directions, none of them along an axis.
fn direction(number: u32) -> Vec3A {
    let golden = std::f32::consts::PI * (3.0 - 5.0f32.sqrt());
    let up = 1.0 - (2 * number + 1) as f32 / DIRECTIONS as f32;
    let (sin, cos) = libm::sincosf(0.3 + golden * number as f32);
    let out = (1.0 - up * up).sqrt();
    Vec3A::new(out * cos, up, out * sin)
}

/// Points of a triangle, evenly spread however many there are, none on its edges: shares of two of its edges.
fn spread(number: u32) -> (f32, f32) {
    // The sequence of Roberts, by the plastic number.
    let at = |step: f64| ((0.5 + step * f64::from(number + 1)).fract()) as f32;
    let (u, v) = (at(0.754_877_666_246_693), at(0.569_840_290_998_053));
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    // A little inward.
    (0.02 + 0.94 * u, 0.02 + 0.94 * v)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles for each face of a cube of edge 1 at this place.
    fn cube(place: [f32; 3]) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let corner = |i: u32| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|bit| bit as f32);
        let points = (0..8).map(corner).map(|p| [0, 1, 2].map(|axis| p[axis] + place[axis])).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        (points, quads.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
    }

    #[test]
    fn faces_between_cubes_are_hidden_and_a_gap_shows_them() {
        for (gap, hidden) in [(0.0, 4), (0.3, 0)] {
            let (mut points, mut triangles) = cube([0.0; 3]);
            let (more, others) = cube([1.0 + gap, 0.0, 0.0]);
            triangles.extend(others.iter().map(|corners| corners.map(|corner| corner + 8)));
            points.extend(more);
            let seen = seen(&points, &triangles, 0.05);
            assert_eq!(seen.iter().filter(|seen| !**seen).count(), hidden, "{gap}");
        }
    }

    #[test]
    fn a_sheet_is_seen_from_both_sides_and_a_core_is_not() {
        let (mut points, mut triangles) = cube([0.0; 3]);
        triangles.push([8, 9, 10]);
        points.extend([[0.2, 0.2, 0.5], [0.8, 0.2, 0.5], [0.5, 0.8, 0.5]]);
        let inside = seen(&points, &triangles, 0.05);
        assert!(!inside[12] && inside[..12].iter().all(|seen| *seen));
        points[8..].iter_mut().for_each(|point| point[2] = 3.0);
        assert!(seen(&points, &triangles, 0.05)[12]);
    }
}
