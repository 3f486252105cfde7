//! A rigid placement.

use glam::{DQuat, DVec3};

/// Half of the turn of an arc, radians. Beyond, an arc would be seen beside its chord (by an eighth of the turn times
/// the chord: 3 %); below, it is the rounding of a file.
const MOST_ARC: f64 = 0.125;
const LEAST_ARC: f64 = 1e-5;

/// Rotation, then translation, from a body's own frame (the prop's origin) to the world.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Pose {
    /// Metres.
    pub translation: DVec3,
    /// Unit quaternion.
    pub rotation: DQuat,
}

impl Pose {
    pub const IDENTITY: Pose = Pose { translation: DVec3::ZERO, rotation: DQuat::IDENTITY };

    /// A point of the body's frame -> the world.
    pub fn transform_point(&self, p: DVec3) -> DVec3 {
        self.translation + self.rotation * p
    }

    /// Upper bound on the distance between the two places of any point within `radius` of the frame's origin.
    pub fn moved(&self, other: &Pose, radius: f64) -> f64 {
        let turned = (self.rotation.inverse() * other.rotation).normalize();
        // A turn by the angle a moves a point at the radius r by 2 r sin(a / 2).
        self.translation.distance(other.translation) + 2.0 * radius * turned.xyz().length()
    }

    /// The pose between `self` (at 0) and `other` (at 1), rotating along the shorter arc.
    pub fn interpolate(&self, other: &Pose, s: f64) -> Pose {
        Pose {
            translation: self.translation.lerp(other.translation, s),
            rotation: self.rotation.slerp(other.rotation, s).normalize(),
        }
    }

    /// The same, where what turns a little goes about the axis of that turn, along an arc instead of its chord: what is
    /// carried by many short chords is jerked from one to the next.
    pub fn interpolate_arc(&self, other: &Pose, s: f64) -> Pose {
        let even = self.interpolate(other, s);
        let turn = other.rotation * self.rotation.inverse();
        let (sine, cosine) = (turn.xyz().length(), turn.w.abs());
        let half = libm::atan2(sine, cosine);
        if !(LEAST_ARC..MOST_ARC).contains(&half) {
            return even;
        }
        let axis = turn.xyz() * (turn.w.signum() / sine);
        let way = (other.translation - self.translation).reject_from_normalized(axis);
        // From the axis, which is at the same distance from both.
        let arm = -(way / 2.0 + axis.cross(way) * (cosine / sine / 2.0));
        let (sin, cos) = libm::sincos(2.0 * half * s);
        let turned = arm * cos + axis.cross(arm) * sin;
        Pose { translation: even.translation + (turned - arm - way * s), ..even }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_turn_goes_about_its_axis() {
        let (pivot, up) = (DVec3::new(3.0, 0.5, -2.0), DVec3::new(0.1, 1.0, 0.2).normalize());
        let turned = |angle: f64, rise: f64| {
            let rotation = DQuat::from_axis_angle(up, angle);
            Pose { translation: pivot - rotation * pivot + up * rise, rotation }
        };
        for angle in [-0.2, 0.01, 0.2] {
            let (a, b) = (turned(1.0, 0.0), turned(1.0 + angle, 0.1));
            for s in [0.0, 0.25, 0.5, 1.0] {
                let (found, exact) = (a.interpolate_arc(&b, s), turned(1.0 + s * angle, s * 0.1));
                assert!(found.translation.distance(exact.translation) < 1e-12, "{angle} {s}");
                assert!(found.rotation.angle_between(exact.rotation) < 1e-7, "{angle} {s}");
                let negated = Pose { rotation: -b.rotation, ..b };
                assert!(a.interpolate_arc(&negated, s).translation.distance(exact.translation) < 1e-12);
            }
        }
        // Far apart, and without a turn: along the chord.
        for b in [turned(2.0, 0.0), Pose { translation: DVec3::X, ..turned(1.0, 0.0) }] {
            assert_eq!(turned(1.0, 0.0).interpolate_arc(&b, 0.3), turned(1.0, 0.0).interpolate(&b, 0.3));
        }
    }
}
