//! Instances of props, and how new ones are drawn.

use cairn_geometry::pose::Pose;
use cairn_input::scene::{Prop, Turns};
use glam::{DQuat, DVec3};
use rand::{Rng, RngExt};
use std::f64::consts::FRAC_PI_2;

/// A prop, scaled and posed.
#[derive(Clone, Copy, Debug, serde::Serialize, serde::Deserialize)]
pub struct Instance {
    /// Index into the scene's props.
    pub prop: usize,
    pub scale: f64,
    /// Of the center of mass, engine units.
    pub pose: Pose,
}

/// One of these props by its own weight, a scale from its range and an orientation from its own.
pub fn draw(props: &[Prop], among: impl Iterator<Item = usize> + Clone, rng: &mut impl Rng) -> (usize, f64, DQuat) {
    draw_by(props, among.map(|i| (i, props[i].weight)), rng)
}

/// The same by other weights.
pub fn draw_by(
    props: &[Prop],
    among: impl Iterator<Item = (usize, f64)> + Clone,
    rng: &mut impl Rng,
) -> (usize, f64, DQuat) {
    let total: f64 = among.clone().map(|(_, weight)| weight).sum();
    let mut at = rng.random_range(0.0..total);
    let chosen = among.clone().find(|&(_, weight)| {
        at -= weight;
        at < 0.0
    });
    // Rounding may leave a remainder: it belongs to the last prop that can be drawn.
    let (prop, _) = chosen.or_else(|| among.filter(|&(_, weight)| weight > 0.0).last()).unwrap_or((0, 0.0));
    let [lo, hi] = props[prop].scale;
    let scale = lo + (hi - lo) * libm::pow(rng.random::<f64>(), props[prop].scale_power());
    (prop, scale, random_rotation(&props[prop], rng))
}

/// Uniform over the rotations that tilt the up axis by at most this angle, degrees; over all of them for 180 (Shoemake
/// 1992).
fn random_rotation(prop: &Prop, rng: &mut impl Rng) -> DQuat {
    let tilt_max = prop.tilt_max;
    let (u, v, w): (f64, f64, f64) = (rng.random(), rng.random(), rng.random());
    let (v, w) = (v * std::f64::consts::TAU, w * std::f64::consts::TAU);
    if tilt_max < 180.0 {
        // Even on the cap of directions: its area grows with the height.
        let height = 1.0 - u * (1.0 - libm::cos(tilt_max.to_radians()));
        let axis = DVec3::new(libm::cos(v), 0.0, libm::sin(v));
        let turn = match prop.stance.turns {
            Turns::Any => w,
            Turns::Quarter => (w / FRAC_PI_2).floor() * FRAC_PI_2,
            Turns::None => 0.0,
        };
        let (half_tilt, half_turn) = (libm::acos(height.clamp(-1.0, 1.0)) / 2.0, turn / 2.0);
        let tilt = axis * libm::sin(half_tilt);
        let tilt = DQuat::from_xyzw(tilt.x, tilt.y, tilt.z, libm::cos(half_tilt));
        let turn = DQuat::from_xyzw(0.0, libm::sin(half_turn), 0.0, libm::cos(half_turn));
        let upright = prop.stance.up.map_or(DQuat::IDENTITY, |up| DQuat::from_rotation_arc(up, DVec3::Y));
        return (tilt * turn * upright).normalize();
    }
    let (a, b) = ((1.0 - u).sqrt(), u.sqrt());
    DQuat::from_xyzw(a * libm::sin(v), a * libm::cos(v), b * libm::sin(w), b * libm::cos(w)).normalize()
}
