//! Scenes of problems that are no hard cases.

use super::super::rows::edges::{moved, scenery};
use super::super::rows::piles::RADIUS;
use super::super::rows::scenes::{at, block, globe, placed, prop};
use super::GRAVITY;
use cairn_engine::shape::{Shape, Size};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::params::{Accuracy, Params};
use cairn_input::scene::Scene;
use glam::{DQuat, DVec3};
use std::f64::consts::{PI, SQRT_2, TAU};

/// Edge of the cube that falls, and how far it falls, m.
pub const DROPPED: f64 = 0.1;
pub const DROP: f64 = 0.5;

pub fn dropped() -> Scene {
    placed(prop("cube", block(DVec3::splat(DROPPED)), 0.7), [at(0.0, DROP + DROPPED / 2.0, 0.0)])
}

/// Of the arch; the middle one is its crown.
pub const STONES: usize = 15;

/// A half ring of mean radius 1 m, so many times as thick as it must be.
pub fn arch(factor: f64) -> Scene {
    const DEPTH: f64 = 0.3;
    let step = PI / STONES as f64;
    let thickness = factor * least_thickness(STONES);
    let mut stone = block(DVec3::new(step, thickness, DEPTH));
    // From angle, height and depth.
    for p in &mut stone.points {
        let (sin, cos) = p.x.sin_cos();
        let radius = 1.0 + p.y;
        *p = DVec3::new(radius * sin, radius * cos - 1.0, p.z);
    }
    let poses = (0..STONES).map(|k| {
        let rotation = DQuat::from_rotation_z(PI / 2.0 - (k as f64 + 0.5) * step);
        Pose { translation: rotation * DVec3::Y, rotation }
    });
    placed(prop("stone", stone, 0.7), poses)
}

/// The least thickness of a half ring of mean radius 1 that stands, of an odd number of stones with flat faces: a line
/// of thrust passes through each joint. No stone slides.
fn least_thickness(stones: usize) -> f64 {
    let (mut falls, mut stands) = (0.02, 0.5);
    for _ in 0..60 {
        let middle = (falls + stands) / 2.0;
        if has_thrust_line(stones, middle) { stands = middle } else { falls = middle }
    }
    stands
}

/// For a thrust H at height y at the crown, the moment about any point of a joint is linear in H and H y. It must be of
/// opposite signs at the two ends of each joint.
fn has_thrust_line(stones: usize, thickness: f64) -> bool {
    let step = PI / stones as f64;
    let corner = |angle: f64, side: f64| {
        let (sin, cos) = angle.sin_cos();
        (1.0 + side * thickness / 2.0) * glam::DVec2::new(sin, cos)
    };
    // Each joint of the right half, from the crown down: its ends, and the weight above it with its moment.
    let (mut weight, mut moment) = (0.0, 0.0);
    let mut joints = Vec::new();
    let mut above = 0.0;
    for k in 0..=stones / 2 {
        let below = step * (k as f64 + 0.5);
        let corners = [corner(above, -1.0), corner(above, 1.0), corner(below, 1.0), corner(below, -1.0)];
        for i in 0..4 {
            let (a, b) = (corners[i], corners[(i + 1) % 4]);
            let area = -a.perp_dot(b) / 2.0;
            weight += area;
            moment += area * (a.x + b.x) / 3.0;
        }
        joints.push((corners[3], corners[2], weight, moment));
        above = below;
    }
    // By how much the lowest and the highest H y that the joints allow miss each other: convex in H.
    let miss = |thrust: f64| {
        let level = |p: glam::DVec2, w: f64, m: f64| thrust * p.y + w * p.x - m;
        let low = joints.iter().map(|&(inner, _, w, m)| level(inner, w, m)).fold(f64::NEG_INFINITY, f64::max);
        let high = joints.iter().map(|&(_, outer, w, m)| level(outer, w, m)).fold(f64::INFINITY, f64::min);
        low - high
    };
    let (mut a, mut b) = (0.0, 10.0 * weight);
    for _ in 0..200 {
        let (c, d) = (a + (b - a) / 3.0, b - (b - a) / 3.0);
        if miss(c) < miss(d) { b = d } else { a = c }
    }
    miss(a) <= 0.0
}

/// The top: radius and height of its rim, its height, m; its spin, rad/s; how far it leans.
const RIM: f64 = 0.3;
const HIGH: f64 = 0.4;
const SPIN: f64 = 40.0;
const LEAN: f64 = 20.0 * PI / 180.0;

/// Two cones, tip down in the origin.
fn cones() -> TriMesh {
    const SIDES: u32 = 32;
    let rim = |k: u32| {
        let (sin, cos) = (TAU * f64::from(k) / f64::from(SIDES)).sin_cos();
        DVec3::new(RIM * cos, RIM, RIM * sin)
    };
    let points = [DVec3::ZERO, DVec3::Y * HIGH].into_iter().chain((0..SIDES).map(rim)).collect();
    let triangles = (0..SIDES).flat_map(|k| {
        let (a, b) = (2 + k, 2 + (k + 1) % SIDES);
        [[0, a, b], [1, b, a]]
    });
    TriMesh { points, triangles: triangles.collect() }
}

/// The steady precession of a top about its tip.
pub struct Precession {
    /// rad/s, about the vertical.
    rate: f64,
    /// From the tip to the centre of mass, m.
    reach: f64,
}

impl Precession {
    /// The top's axis after a time, s.
    pub fn axis(&self, time: f64) -> DVec3 {
        DQuat::from_rotation_y(self.rate * time) * lean() * DVec3::Y
    }
}

fn lean() -> DQuat {
    DQuat::from_rotation_z(-LEAN)
}

/// I w^2 cos a - I' s w + m g l = 0, with I across at the tip and I' about the axis; the slower one of its answers.
pub fn precession() -> Precession {
    let prop = prop("top", cones(), 1.0);
    let size = Size::of(&prop.model.mesh);
    let shape = Shape::new(&prop, size, &Params::new(Accuracy::Standard).physics).expect("a top has volume");
    let (moments, axes) = shape.inertia;
    // One of the principal axes is the top's.
    let along = axes.inverse() * DVec3::Y;
    let about = moments.dot(along * along);
    let across = (moments.element_sum() - about) / 2.0;
    let reach = shape.center.y;
    let (a, b, c) = ((across + shape.mass * reach * reach) * LEAN.cos(), about * SPIN, shape.mass * GRAVITY * reach);
    Precession { rate: (b - (b * b - 4.0 * a * c).sqrt()) / (2.0 * a), reach }
}

pub fn top() -> Scene {
    let Precession { rate, reach } = precession();
    let axis = lean() * DVec3::Y;
    let mut scene = placed(prop("top", cones(), 1.0), [Pose { translation: DVec3::ZERO, rotation: lean() }]);
    let body = &mut scene.bodies[0];
    // The spin is that about the axis in all, with the share of the precession in it.
    body.angular_velocity = DVec3::Y * rate + axis * (SPIN - rate * LEAN.cos());
    body.velocity = (DVec3::Y * rate).cross(axis * reach);
    scene
}

/// A ball whose mesh is that of a ball for every preset: its moments are within a thousandth of a ball's.
pub fn round() -> TriMesh {
    globe(RADIUS, 128)
}

/// Balls stacked as cannon balls, four by four below, in a frame.
pub fn pyramid() -> Scene {
    const ACROSS: usize = 4;
    let layer = |level: usize| {
        let side = ACROSS - level;
        let place = move |k: usize| RADIUS * (2.0 * k as f64 - (side as f64 - 1.0));
        let height = RADIUS * (1.0 + SQRT_2 * level as f64);
        (0..side * side).map(move |k| at(place(k % side), height, place(k / side)))
    };
    let mut scene = placed(prop("ball", round(), 0.7), (0..ACROSS).flat_map(layer));
    let (half, thick) = (RADIUS * ACROSS as f64, 0.1);
    for side in [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z] {
        let across = DVec3::Y.cross(side).abs();
        let size = side.abs() * thick + DVec3::Y * RADIUS * 2.0 + across * 2.0 * (half + thick);
        let middle = side * (half + thick / 2.0) + DVec3::Y * RADIUS;
        scene.statics.push(scenery("frame", moved(block(size), middle), 0.7));
    }
    scene
}

#[cfg(test)]
mod tests {
    use super::{least_thickness, precession};

    #[test]
    fn the_truths_are_those_of_the_books() {
        // Milankovitch, for stones without end; his joints are radial, and the ring is round.
        assert!((least_thickness(401) - 0.10748).abs() < 3e-5, "{}", least_thickness(401));
        // Near m g l / I' s, the speed of a fast top.
        let rate = precession().rate;
        assert!((2.2..3.2).contains(&rate), "{rate}");
    }
}
