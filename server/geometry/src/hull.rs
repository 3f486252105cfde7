//! The convex hull by the geometry library, checked: where several points are nearly on a line or in a plane, it may
//! leave out a corner, and what it returns is not convex.

use glam::{DQuat, EulerRot};
use parry3d::math::Vector;
use parry3d::transformation::try_convex_hull;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// A point may be so far outside of a hull, in the size of the points: rounding.
const OUTSIDE: f32 = 1e-4;
/// A triangle that is narrower, in the size of the points, has no normal to check by.
const SLIVER: f32 = 1e-3;
/// Rotations in which it is tried again.
const ROTATIONS: u32 = 8;
/// Bound on the pairs of a point and a triangle that a check looks at: of more points, it looks at some, evenly.
const MOST_PAIRS: usize = 1 << 24;

type Triangles = Vec<[u32; 3]>;

/// Corners and triangles of the hull; of several that are not convex, the one that is least so. `None` where the points
/// have none: flat, fewer than four, not finite, or a panic of the library.
pub fn convex_hull(points: &[Vector]) -> Option<(Vec<Vector>, Triangles)> {
    let mut best = library_hull(points)?;
    let size = points.iter().map(|p| p.distance(points[0])).fold(0.0, f32::max);
    let mut least = outside(points, &best, size);
    for k in 1..=ROTATIONS {
        if least <= OUTSIDE * size {
            break;
        }
        let turns = [0.7, 1.1, 1.9].map(|turn| turn * f64::from(k));
        let turn = DQuat::from_euler(EulerRot::XYZ, turns[0], turns[1], turns[2]);
        let turned: Vec<Vector> = points.iter().map(|p| (turn * p.as_dvec3()).as_vec3()).collect();
        let Some((corners, triangles)) = library_hull(&turned) else { continue };
        // Its corners are some of the points it was given.
        let bits = |p: &Vector| p.to_array().map(f32::to_bits);
        let numbers: BTreeMap<[u32; 3], usize> = turned.iter().enumerate().map(|(i, p)| (bits(p), i)).collect();
        let own = |corner: &Vector| numbers.get(&bits(corner)).map(|&i| points[i]);
        let Some(corners) = corners.iter().map(own).collect::<Option<Vec<Vector>>>() else { continue };
        let hull = (corners, triangles);
        let found = outside(points, &hull, size);
        if found < least {
            (least, best) = (found, hull);
        }
    }
    Some(best)
}

fn library_hull(points: &[Vector]) -> Option<(Vec<Vector>, Triangles)> {
    catch_unwind(AssertUnwindSafe(|| try_convex_hull(points))).ok()?.ok()
}

/// How far a point is outside of a triangle's plane at most.
fn outside(points: &[Vector], (corners, triangles): &(Vec<Vector>, Triangles), size: f32) -> f32 {
    let step = (points.len() * triangles.len()).div_ceil(MOST_PAIRS).max(1);
    let mut farthest = 0.0f32;
    for t in triangles {
        let [a, b, c] = t.map(|i| corners[i as usize]);
        let area = (b - a).cross(c - a);
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        let Some(normal) = area.try_normalize().filter(|_| area.length() > SLIVER * size * longest) else { continue };
        let height = a.dot(normal);
        farthest = points.iter().step_by(step).map(|p| p.dot(normal) - height).fold(farthest, f32::max);
    }
    farthest
}

#[cfg(test)]
#[path = "../../testing/box_part.rs"]
mod box_part;

#[cfg(test)]
mod tests {
    use super::box_part::BOX_PART;
    use super::*;

    #[test]
    fn corners_that_are_nearly_on_a_line_are_not_left_out() {
        // In the order of a hull's corners, of which some are in the middle of edges.
        let kept = [0, 1, 8, 13, 4, 9, 7, 14, 5, 10, 3, 11, 2];
        let points = kept.map(|i| Vector::from_array(BOX_PART[i]));
        let size = points.iter().map(|p| p.distance(points[0])).fold(0.0, f32::max);
        let far = |hull: Option<(Vec<Vector>, Triangles)>| outside(&points, &hull.unwrap(), size);
        assert!(far(library_hull(&points)) > 0.01, "the library is right now: this file can go");
        assert!(far(convex_hull(&points)) < 1e-5);
    }
}
