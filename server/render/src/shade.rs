//! Light: a soft sun over the viewer's left shoulder, an overcast sky, and a seamless paper ground.
//!
//! Every picture element averages rays from a low-discrepancy sequence of its own. Nothing depends on the order in
//! which elements are worked out, so any number of threads gives the same picture.

use super::camera::Camera;
use super::glue::{self, Ball};
use super::library::Library;
use super::ray_scene::{RayScene, SurfaceHit};
use glam::{Vec2, Vec3, vec3};
use image::{Rgb, RgbImage};
use rayon::prelude::*;
use std::f32::consts::TAU;

/// Angular radius of the sun, radians. The true 0.005 gives hard shadows.
const SUN_RADIUS: f32 = 0.06;
const SUN: Vec3 = vec3(1.90, 1.78, 1.60);
/// Sky straight up, at the horizon, and light from the ground.
const SKY: [Vec3; 3] = [vec3(1.04, 1.07, 1.13), vec3(0.70, 0.72, 0.75), vec3(0.34, 0.33, 0.32)];
/// Light from a neighbour, as a share of its colour. Stands for a second bounce.
const BOUNCE: f32 = 0.35;
/// The paper: in the middle of the picture and in its corners.
const PAPER: [Vec3; 2] = [vec3(0.80, 0.80, 0.80), vec3(0.50, 0.51, 0.53)];
/// Beyond this distance from the middle of unit space, shadows on the ground begin to fade, and end at twice as much.
const SHADOW_REACH: f32 = 3.0;
/// Distance at which rays start from the surface that they leave, so that they do not hit it again.
const LIFT: f32 = 2e-4;
/// Samples after which a picture element that shows nothing but paper is finished.
const PROBES: u32 = 4;

/// Everything that a picture depends on.
pub struct RenderJob<'a> {
    pub scene: RayScene<'a>,
    pub library: &'a Library,
    /// The control mesh, drawn as frosted glass.
    pub ghost: Option<RayScene<'a>>,
    /// Glue marks, drawn through the surfaces in front of them.
    pub glue: Option<glue::GlueOverlay>,
    /// Height of the ground, unit space.
    pub ground: f32,
    pub camera: Camera,
    pub size: [u32; 2],
    /// Rays per picture element.
    pub samples: u32,
}

impl RenderJob<'_> {
    pub fn run(&self) -> RgbImage {
        let [width, height] = self.size;
        let sun = self.sun();
        let mut bytes = vec![0u8; width as usize * height as usize * 3];
        bytes.par_chunks_mut(width as usize * 3).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row.chunks_mut(3).enumerate() {
                pixel.copy_from_slice(&self.pixel(x as u32, y as u32, sun).0);
            }
        });
        RgbImage::from_raw(width, height, bytes).expect("three bytes for each picture element")
    }

    /// The direction to the sun: it stands still relative to the camera, so that every view is lit as well.
    fn sun(&self) -> Vec3 {
        let back = vec3(-self.camera.forward.x, 0.0, -self.camera.forward.z).normalize();
        (back * 0.55 - self.camera.right * 0.62 + Vec3::Y * 0.85).normalize()
    }

    fn pixel(&self, x: u32, y: u32, sun: Vec3) -> Rgb<u8> {
        let [width, height] = self.size.map(|s| s as f32);
        let mut sequence = Sequence::new(x, y);
        let mut sum = Vec3::ZERO;
        let mut taken = 0;
        let mut only_paper = true;
        let balls = self.balls(x as f32, y as f32, [width, height]);
        while taken < self.samples {
            let [dx, dy, s0, s1, a0, a1] = sequence.next();
            let (u, v) = (2.0 * (x as f32 + dx) / width - 1.0, 1.0 - 2.0 * (y as f32 + dy) / height);
            let random = [Vec2::new(s0, s1), Vec2::new(a0, a1)];
            let (color, is_paper) = self.radiance(self.camera.ray(u, v), Vec2::new(u, v), sun, random, &balls);
            sum += color;
            taken += 1;
            only_paper &= is_paper;
            if taken == PROBES && only_paper {
                break;
            }
        }
        let dither = sequence.dither();
        Rgb(display(sum / taken as f32).map(|c| (c * 255.0 + dither) as u8))
    }

    /// The balls of glue that a picture element may show.
    fn balls(&self, x: f32, y: f32, [width, height]: [f32; 2]) -> Vec<&Ball> {
        let Some(glue) = &self.glue else { return Vec::new() };
        let ray = |x: f32, y: f32| self.camera.ray(2.0 * x / width - 1.0, 1.0 - 2.0 * y / height);
        let middle = ray(x + 0.5, y + 0.5);
        glue.near(self.camera.eye, middle, 2.0 * middle.distance(ray(x, y)))
    }

    /// The light along a ray, and whether it shows bare paper.
    fn radiance(&self, direction: Vec3, at: Vec2, sun: Vec3, random: [Vec2; 2], balls: &[&Ball]) -> (Vec3, bool) {
        let eye = self.camera.eye;
        let to_ground = if direction.y < 0.0 { (self.ground - eye.y) / direction.y } else { f32::INFINITY };
        let to_ground = if to_ground > 0.0 { to_ground } else { f32::INFINITY };
        let hit = self.scene.first(eye, direction, to_ground);
        let (color, reach, is_paper) = match &hit {
            Some(hit) => {
                (self.surface(hit, eye + direction * hit.distance, direction, sun, random), hit.distance, false)
            }
            None => {
                let paper = PAPER[0].lerp(PAPER[1], smooth(0.2, 1.6, at.length()));
                let place = to_ground.is_finite().then(|| eye + direction * to_ground);
                let shade = place.map_or(1.0, |place| self.shade_on_ground(place, sun, random));
                (paper * shade, to_ground, shade == 1.0)
            }
        };
        let (color, is_paper) = match &self.ghost {
            None => (color, is_paper),
            Some(ghost) => {
                let mut clear = 1.0;
                ghost.all(eye, direction, reach, |hit| {
                    let facing = hit.normal.dot(direction).abs();
                    clear *= 1.0 - (0.09 + 0.5 * (1.0 - facing).powi(3));
                });
                (color * clear + Vec3::splat(1.1 * (1.0 - clear)), is_paper && clear == 1.0)
            }
        };
        match glue::over(balls, eye, direction, reach, color) {
            Some(color) => (color, false),
            None => (color, is_paper),
        }
    }

    fn surface(&self, hit: &SurfaceHit, place: Vec3, direction: Vec3, sun: Vec3, random: [Vec2; 2]) -> Vec3 {
        let material = &self.library.materials[hit.surface.material];
        let mut color = material.color;
        if let Some(texture) = &material.texture
            && let Some(picture) = self.library.pictures.get(&texture.picture)
        {
            let [a, b, c] = hit.surface.coordinates;
            color *= texture.sample(picture, a * hit.shares.x + b * hit.shares.y + c * hit.shares.z);
        }
        if let Some(glue) = &self.glue {
            color = glue.tinted(hit.number, color);
        }
        // Equal props side by side differ by a shade.
        color *= 1.0 + 0.16 * (hash(hit.number as u32) as f32 / u32::MAX as f32 - 0.5);
        let place = place + hit.facet * LIFT;
        let to_sun = around(sun, random[0], SUN_RADIUS);
        let lit = hit.normal.dot(to_sun).max(0.0) * f32::from(hit.facet.dot(to_sun) > 0.0);
        let lit = if lit > 0.0 && self.scene.is_clear(place, to_sun) { lit } else { 0.0 };
        let out = scattered(hit.normal, random[1]);
        let ambient =
            if out.dot(hit.facet) <= 0.0 || !self.scene.is_clear(place, out) { color * BOUNCE } else { sky(out) };
        let matte = color * (1.0 - 0.6 * material.metallic);
        let shine = shine(hit.normal, -direction, to_sun, material.roughness) * lit;
        let gloss = Vec3::splat(0.04).lerp(color, material.metallic);
        matte * (ambient + SUN * lit) + SUN * gloss * shine
    }

    /// The share of light that reaches a place on the ground, 0 to 1.
    fn shade_on_ground(&self, place: Vec3, sun: Vec3, random: [Vec2; 2]) -> f32 {
        let distance = Vec2::new(place.x, place.z).length();
        if distance >= 2.0 * SHADOW_REACH {
            return 1.0;
        }
        let place = place + Vec3::Y * LIFT;
        let to_sun = around(sun, random[0], SUN_RADIUS);
        let direct = SUN.y * to_sun.y;
        let out = scattered(Vec3::Y, random[1]);
        let ambient = 0.9;
        let mut light = 0.12;
        if self.scene.is_clear(place, to_sun) {
            light += direct;
        }
        if self.scene.is_clear(place, out) {
            light += ambient;
        }
        let shade = light / (direct + ambient + 0.12);
        1.0 + (shade - 1.0) * (1.0 - smooth(SHADOW_REACH, 2.0 * SHADOW_REACH, distance))
    }
}

/// The sky's light from a direction.
fn sky(direction: Vec3) -> Vec3 {
    if direction.y >= 0.0 {
        SKY[1].lerp(SKY[0], direction.y)
    } else {
        SKY[1].lerp(SKY[2], (-3.0 * direction.y).min(1.0))
    }
}

/// Highlight of a rough surface (GGX), without its colour.
fn shine(normal: Vec3, to_eye: Vec3, to_sun: Vec3, roughness: f32) -> f32 {
    let half = (to_eye + to_sun).normalize_or_zero();
    let alpha = (roughness * roughness).max(0.05);
    let cos = normal.dot(half).max(0.0);
    let spread = cos * cos * (alpha * alpha - 1.0) + 1.0;
    (alpha * alpha / (4.0 * spread * spread * half.dot(to_sun).max(0.1).powi(2) * (roughness + 0.5))).min(8.0)
}

/// A direction within a cone.
fn around(axis: Vec3, random: Vec2, radius: f32) -> Vec3 {
    let (sin, cos) = libm::sincosf(TAU * random.x);
    let distance = radius * random.y.sqrt();
    let (right, forward) = axis.any_orthonormal_pair();
    (axis + right * (cos * distance) + forward * (sin * distance)).normalize()
}

/// A direction from a matte surface: more of them near its normal.
fn scattered(normal: Vec3, random: Vec2) -> Vec3 {
    let (sin, cos) = libm::sincosf(TAU * random.x);
    let distance = random.y.sqrt();
    let up = (1.0 - random.y).sqrt();
    let (right, forward) = normal.any_orthonormal_pair();
    (normal * up + right * (cos * distance) + forward * (sin * distance)).normalize()
}

fn smooth(from: f32, to: f32, at: f32) -> f32 {
    let t = ((at - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// From light to the screen: Khronos' neutral tone mapper, which leaves colours below the highlights as they are, then
/// sRGB.
fn display(color: Vec3) -> [f32; 3] {
    const START: f32 = 0.8 - 0.04;
    const DESATURATION: f32 = 0.15;
    let low = color.min_element();
    let offset = if low < 0.08 { low - 6.25 * low * low } else { 0.04 };
    let mut color = color - offset;
    let peak = color.max_element();
    if peak >= START {
        let rest = 1.0 - START;
        let new = 1.0 - rest * rest / (peak + rest - START);
        color *= new / peak;
        let gray = 1.0 - 1.0 / (DESATURATION * (peak - new) + 1.0);
        color = color.lerp(Vec3::splat(new), gray);
    }
    let encode = |c: f32| {
        let c = c.clamp(0.0, 1.0);
        if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * libm::powf(c, 1.0 / 2.4) - 0.055 }
    };
    color.to_array().map(encode)
}

/// Points of the unit cube in six dimensions, evenly spread (Roberts' sequence), with a start of their own for every
/// picture element.
struct Sequence {
    state: [u32; 6],
}

impl Sequence {
    /// 2^32 times the powers of the inverse of 1.0872..., the positive root of x^7 = x + 1.
    const STEPS: [u32; 6] = steps();

    fn new(x: u32, y: u32) -> Sequence {
        let seed = hash(x ^ hash(y));
        Sequence { state: std::array::from_fn(|i| hash(seed ^ (i as u32 + 1).wrapping_mul(0x9E37_79B9))) }
    }

    fn next(&mut self) -> [f32; 6] {
        for (state, step) in self.state.iter_mut().zip(Self::STEPS) {
            *state = state.wrapping_add(step);
        }
        // 24 bits, the precision of a single-precision number below 1.
        self.state.map(|s| (s >> 8) as f32 / (1u32 << 24) as f32)
    }

    /// From 0 to 1, to round colours up or down.
    fn dither(&mut self) -> f32 {
        (hash(self.state[0]) >> 8) as f32 / (1u32 << 24) as f32
    }
}

const fn steps() -> [u32; 6] {
    let mut root: f64 = 1.0;
    let mut round = 0;
    while round < 100 {
        // Newton's method for x^7 - x - 1.
        let x6 = root * root * root * root * root * root;
        root -= (x6 * root - root - 1.0) / (7.0 * x6 - 1.0);
        round += 1;
    }
    let mut steps = [0; 6];
    let mut power = 1.0;
    let mut i = 0;
    while i < 6 {
        power /= root;
        steps[i] = (power * 4_294_967_296.0) as u32;
        i += 1;
    }
    steps
}

/// Scrambles 32 bits.
fn hash(value: u32) -> u32 {
    let mut h = value.wrapping_add(0x9E37_79B9);
    h = (h ^ (h >> 16)).wrapping_mul(0x21F0_AAAD);
    h = (h ^ (h >> 15)).wrapping_mul(0x735A_2D97);
    h ^ (h >> 15)
}
