//! Meshes of which so many triangles are in nearly the same place that their inside would take too long: every look
//! from a point meets them all, and there is a look from each.

use super::ray::SLOPES;
use super::{Bvh, VOLUME_BLOCKS, VOLUME_SAMPLES, face_points};
use crate::mesh::TriMesh;
use glam::DVec3;

/// Tests of a ray and a triangle that an inside may take: about a minute of one core. Four million triangles of a fine
/// surface take a third of it.
const MOST_TESTS: f64 = 5e8;
/// Triangles that are looked from.
const LOOKS: usize = 128;
/// Fewer triangles are never too many.
const FEW: usize = 512;

/// How many triangles a look from one of them comes near, on average, if that is too many.
pub fn crowding(mesh: &TriMesh) -> Option<usize> {
    let count = mesh.triangles.len();
    if count < FEW {
        return None;
    }
    let (low, high) = mesh.bounds();
    let diagonal = low.distance(high);
    let tree = Bvh::new((0..count).map(|i| (i as u32, mesh.corners(i))).collect());
    let stride = count.div_ceil(LOOKS);
    let looks = || (0..count).step_by(stride).map(|i| mesh.corners(i));
    // From both sides of a triangle, at each of its points; and from the samples of the volume.
    let of_triangles = looks().map(|corners| 2 * face_points(corners, diagonal).count()).sum::<usize>() * stride;
    let all = of_triangles + (VOLUME_BLOCKS * VOLUME_SAMPLES).pow(3);
    let (mut met, mut done) = (0, 0);
    for [a, b, c] in looks() {
        met += near((a + b + c) / 3.0, &tree);
        done += 1;
        // The few that are looked from now are enough to know.
        if met as f64 / LOOKS as f64 * all as f64 > MOST_TESTS {
            return Some(met / done);
        }
    }
    None
}

/// Triangles in boxes that the ray from a point meets.
fn near(p: DVec3, tree: &Bvh) -> usize {
    let (x, y) = SLOPES[0];
    let slopes = DVec3::new(x, y, 1.0);
    let mut met = 0;
    let enter = |lo: DVec3, hi: DVec3| {
        let (a, b) = ((lo - p) / slopes, (hi - p) / slopes);
        a.min(b).max_element().max(0.0) <= a.max(b).min_element()
    };
    tree.visit(enter, |_| {
        met += 1;
        true
    });
    met
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sheets, each `apart` above the one before.
    fn sheets(count: usize, apart: f64) -> TriMesh {
        let corners = |i: usize| {
            let y = apart * i as f64;
            [DVec3::new(0.0, y, 0.0), DVec3::new(0.0, y, 1.0), DVec3::new(1.0, y, 0.0)]
        };
        let triangle = |i: usize| [0, 1, 2].map(|k| 3 * i as u32 + k);
        TriMesh { points: (0..count).flat_map(corners).collect(), triangles: (0..count).map(triangle).collect() }
    }

    #[test]
    fn triangles_in_nearly_one_place_are_too_many() {
        assert!(crowding(&sheets(20_000, 1e-7)).is_some_and(|met| met > 5000));
        assert_eq!(crowding(&sheets(500, 1e-7)), None, "few");
        // Side by side, a hundred times as many are none.
        let mut side = sheets(0, 0.0);
        for i in 0..200_000u32 {
            let at = DVec3::new(f64::from(i % 500), 0.0, f64::from(i / 500));
            side.points.extend([at, at + DVec3::Z, at + DVec3::X]);
            side.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        assert_eq!(crowding(&side), None);
    }
}
