//! Two boxes: whether a plane along a face of one of them parts them, which is so for most pairs.

use rapier3d::math::{Pose, Vector};
use rapier3d::parry::shape::Cuboid;
use rapier3d::prelude::Mat3;

/// How far apart two boxes are along the best of their faces' normals; negative where these do not part them. `pos12`:
/// of the second box, in the frame of the first.
pub(super) fn distance(pos12: &Pose, a: &Cuboid, b: &Cuboid) -> f32 {
    let turn = Mat3::from_quat(pos12.rotation);
    let cosines = Mat3::from_cols(turn.x_axis.abs(), turn.y_axis.abs(), turn.z_axis.abs());
    let shift = pos12.translation;
    let of_first: Vector = shift.abs() - (a.half_extents + cosines * b.half_extents);
    let of_second = (turn.transpose() * shift).abs() - (b.half_extents + cosines.transpose() * a.half_extents);
    of_first.max(of_second).max_element()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;

    #[test]
    fn the_best_face_decides() {
        let (a, b) = (Cuboid::new(Vector::new(1.0, 2.0, 3.0)), Cuboid::new(Vector::splat(0.5)));
        let at = |x: f32, y: f32, z: f32| Pose::from_parts(Vector::new(x, y, z), Quat::from_rotation_z(0.5));
        let across = 0.5 * (0.5f32.cos() + 0.5f32.sin());
        assert!((distance(&at(1.75, 0.0, 0.0), &a, &b) - (0.75 - across)).abs() < 1e-6);
        assert!((distance(&at(0.0, 0.0, 3.6), &a, &b) - 0.1).abs() < 1e-6);
        assert!(distance(&at(0.0, 0.0, 0.0), &a, &b) < 0.0);
        // A corner of the first in front of a face of the second.
        let turned = Pose::from_parts(Vector::new(1.7, 2.7, 0.0), Quat::from_rotation_z(std::f32::consts::FRAC_PI_4));
        let along = Vector::new(1.0, 1.0, 0.0).normalize();
        let expected = along.dot(turned.translation) - 0.5 - along.dot(Vector::new(1.0, 2.0, 0.0));
        assert!((distance(&turned, &a, &b) - expected).abs() < 1e-5 && expected > 0.2);
    }
}
