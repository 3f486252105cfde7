//! A camera that sees all of a set of points, as large as possible.

use glam::{DVec3, Vec3};

/// Vertical field of view, radians: a mild telephoto, as for a product on a table.
const FIELD: f64 = 0.5;
/// Share of the picture left free on each side.
const MARGIN: f64 = 0.1;

/// A pinhole.
pub struct Camera {
    pub eye: Vec3,
    pub right: Vec3,
    pub up: Vec3,
    pub forward: Vec3,
    /// Half the picture's width and height at distance 1.
    half: [f32; 2],
}

impl Camera {
    /// Looks from `azimuth` (degrees around +Y, from +Z towards +X) and `elevation` (degrees above the ground) at
    /// `points`.
    pub fn fitted(points: &[DVec3], azimuth: f64, elevation: f64, [width, height]: [u32; 2]) -> Camera {
        let (sin_a, cos_a) = libm::sincos(azimuth.to_radians());
        let (sin_e, cos_e) = libm::sincos(elevation.clamp(-89.0, 89.0).to_radians());
        let back = DVec3::new(sin_a * cos_e, sin_e, cos_a * cos_e);
        let right = DVec3::new(cos_a, 0.0, -sin_a);
        let up = back.cross(right);
        let vertical = libm::tan(FIELD / 2.0);
        let half = [vertical * f64::from(width) / f64::from(height), vertical];
        // In each direction, the two planes of the picture's edges must enclose all points: that gives the place and
        // the distance in closed form.
        let fit = |axis: DVec3, half: f64| {
            let half = half * (1.0 - 2.0 * MARGIN);
            let most = |side: f64| points.iter().map(|p| side * p.dot(axis) + half * p.dot(back)).reduce(f64::max);
            let (high, low) = (most(1.0).unwrap_or(0.0), most(-1.0).unwrap_or(0.0));
            ((high - low) / 2.0, (high + low) / (2.0 * half))
        };
        let ((x, distance_x), (y, distance_y)) = (fit(right, half[0]), fit(up, half[1]));
        let eye = right * x + up * y + back * distance_x.max(distance_y);
        Camera {
            eye: eye.as_vec3(),
            right: right.as_vec3(),
            up: up.as_vec3(),
            forward: -back.as_vec3(),
            half: half.map(|h| h as f32),
        }
    }

    /// From a point of the camera's frame with Y down and Z ahead to column and row, times the depth; row by row.
    pub fn intrinsics(&self, [width, height]: [u32; 2]) -> [f64; 9] {
        let [x, y] = self.half.map(f64::from);
        let (middle_x, middle_y) = (f64::from(width) / 2.0, f64::from(height) / 2.0);
        [middle_x / x, 0.0, middle_x, 0.0, middle_y / y, middle_y, 0.0, 0.0, 1.0]
    }

    /// The direction through the middle of a picture element; rows from the top.
    pub fn element(&self, [column, row]: [u32; 2], [width, height]: [u32; 2]) -> Vec3 {
        let across = |at: u32, count: u32| (2.0 * at as f32 + 1.0) / count as f32 - 1.0;
        self.ray(across(column, width), -across(row, height))
    }

    /// The direction through a place in the picture: from -1 to 1, right and up.
    pub fn ray(&self, x: f32, y: f32) -> Vec3 {
        (self.forward + self.right * (x * self.half[0]) + self.up * (y * self.half[1])).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_points_are_inside_and_touch_the_margin() {
        let points: Vec<DVec3> = (0..60)
            .map(|i| {
                let t = f64::from(i);
                DVec3::new((t * 0.7).sin() * 3.0, t * 0.05, (t * 1.3).cos() * 2.0)
            })
            .collect();
        for (azimuth, elevation, size) in [(0.0, 0.0, [4, 3]), (35.0, 20.0, [1, 1]), (200.0, 70.0, [3, 4])] {
            let camera = Camera::fitted(&points, azimuth, elevation, size);
            let mut extent = [0.0f32; 2];
            for point in &points {
                let offset = point.as_vec3() - camera.eye;
                let depth = offset.dot(camera.forward);
                assert!(depth > 0.0);
                extent[0] = extent[0].max((offset.dot(camera.right) / depth / camera.half[0]).abs());
                extent[1] = extent[1].max((offset.dot(camera.up) / depth / camera.half[1]).abs());
            }
            let largest = extent[0].max(extent[1]);
            assert!((largest - 0.8).abs() < 1e-3, "{extent:?}");
        }
    }
}
