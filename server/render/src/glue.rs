//! The glue of a pile: dots as small balls that shine through the bodies, and bodies coloured by how glue holds them.

use super::RenderFault;
use super::nodes;
use cairn_gltf::Document;
use glam::{DAffine3, DVec3, Vec3, vec3};
use serde_json::Value;
use std::collections::BTreeMap;

/// A dot that carries next to nothing, one that carries most, and a broken one.
const LEAST: Vec3 = vec3(1.0, 0.9, 0.25);
const MOST: Vec3 = vec3(0.9, 0.02, 0.08);
const BROKEN: Vec3 = vec3(0.02, 0.02, 0.02);
/// Bodies without glue are pale, glued ones grey, and those joined to the ground blue.
const PALE: Vec3 = vec3(0.78, 0.78, 0.78);
const GREY: Vec3 = vec3(0.22, 0.25, 0.28);
const BLUE: Vec3 = vec3(0.10, 0.27, 0.62);
/// A ball's radius, in unit space; and its largest share of a body's radius.
const RADIUS: f64 = 0.016;
const LARGEST: f64 = 0.3;
/// Opacity of a ball behind a surface.
const THROUGH: f32 = 0.8;

/// The glue of a file's pile at a moment.
pub struct DrawnGlue {
    dots: Vec<GlueMark>,
    bonds: BTreeMap<usize, Bond>,
}

struct GlueMark {
    /// In the world.
    place: DVec3,
    /// N, and N m.
    force: f64,
    moment: f64,
    is_broken: bool,
}

#[derive(Clone, Copy, PartialEq)]
enum Bond {
    Cluster,
    Anchored,
}

impl DrawnGlue {
    /// The file states the dots of its end; at `seconds` they are where their bodies were.
    pub fn read(document: &Document, seconds: f64, end: f64) -> Result<DrawnGlue, RenderFault> {
        let stated = nodes::pile(document).and_then(|(_, pile)| pile.get("extras")?.get("cairn")?.get("glue"));
        let stated = stated.ok_or(RenderFault::NoGlue)?;
        let list = |key: &str| stated.get(key).and_then(Value::as_array).ok_or(RenderFault::BrokenGlue);
        let index = |value: &Value| value.as_u64().map(|id| id as usize).ok_or(RenderFault::BrokenGlue);
        let (now, then) = (nodes::bodies(document, seconds)?, nodes::bodies(document, end)?);
        let mut glue = DrawnGlue { dots: Vec::new(), bonds: BTreeMap::new() };
        for dot in list("dots")? {
            let vector = |key: &str| {
                let numbers = dot.get(key)?.as_array()?.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>()?;
                <[f64; 3]>::try_from(numbers).ok().map(DVec3::from)
            };
            let vector = |key: &str| vector(key).ok_or(RenderFault::BrokenGlue);
            let body = index(dot.get("bodies").and_then(|bodies| bodies.get(0)).unwrap_or(&Value::Null))?;
            let (now, then) = (now.get(body), then.get(body));
            let (now, then) = now.zip(then).ok_or(RenderFault::BrokenGlue)?;
            let place = (*now * then.inverse()).transform_point3(vector("point")?);
            glue.dots.push(GlueMark {
                // A hidden body's transform has no inverse; its dots stay where the file states them.
                place: if place.is_finite() { place } else { vector("point")? },
                force: vector("force")?.length(),
                moment: vector("moment")?.length(),
                is_broken: dot.get("broken").and_then(Value::as_bool).unwrap_or(false),
            });
        }
        for cluster in list("clusters")? {
            for id in cluster.as_array().ok_or(RenderFault::BrokenGlue)? {
                glue.bonds.insert(index(id)?, Bond::Cluster);
            }
        }
        for id in list("anchored")? {
            glue.bonds.insert(index(id)?, Bond::Anchored);
        }
        Ok(glue)
    }

    /// The glue in unit space. `radius`: that of a usual body, in the world; `bodies`: the body that each instance is.
    pub fn shown(&self, to_unit: DAffine3, radius: f64, bodies: impl Iterator<Item = Option<usize>>) -> GlueOverlay {
        // A moment counts as the force that makes it at a body's radius.
        let load = |dot: &GlueMark| libm::hypot(dot.force, dot.moment / radius.max(f64::MIN_POSITIVE));
        let whole = self.dots.iter().filter(|dot| !dot.is_broken);
        let largest = whole.map(load).fold(f64::MIN_POSITIVE, f64::max);
        let size = to_unit.transform_vector3(DVec3::X).length() * radius;
        let ball = |dot: &GlueMark| Ball {
            centre: to_unit.transform_point3(dot.place).as_vec3(),
            radius: RADIUS.min(LARGEST * size) as f32,
            color: match dot.is_broken {
                true => BROKEN,
                false => LEAST.lerp(MOST, (load(dot) / largest).sqrt() as f32),
            },
        };
        GlueOverlay {
            balls: self.dots.iter().map(ball).collect(),
            bonds: bodies.map(|body| self.bonds.get(&body?).copied()).collect(),
        }
    }
}

/// Glue in unit space.
pub struct GlueOverlay {
    balls: Vec<Ball>,
    /// Beside each instance.
    bonds: Vec<Option<Bond>>,
}

/// A dot.
pub struct Ball {
    centre: Vec3,
    radius: f32,
    color: Vec3,
}

impl GlueOverlay {
    /// The balls that rays within `slack` of a direction, both unit, may meet.
    pub fn near(&self, eye: Vec3, direction: Vec3, slack: f32) -> Vec<&Ball> {
        let is_near = |ball: &&Ball| {
            let offset = ball.centre - eye;
            let along = offset.dot(direction);
            (offset - direction * along).length() < ball.radius + along.abs() * slack
        };
        self.balls.iter().filter(is_near).collect()
    }

    /// The colour of an instance whose own colour is this one.
    pub fn tinted(&self, number: usize, color: Vec3) -> Vec3 {
        match self.bonds.get(number).copied().flatten() {
            Some(Bond::Cluster) => color.lerp(GREY, 0.7),
            Some(Bond::Anchored) => color.lerp(BLUE, 0.75),
            None => color.lerp(PALE, 0.85),
        }
    }
}

/// The colour along a ray that meets balls, `None` if it meets none; `reach`: the distance of the colour `behind`.
pub fn over(balls: &[&Ball], eye: Vec3, direction: Vec3, reach: f32, behind: Vec3) -> Option<Vec3> {
    let met = balls.iter().filter_map(|ball| Some((ball.distance(eye, direction)?, ball)));
    let (distance, ball) = met.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let facing = (ball.centre - eye - direction * distance).normalize_or_zero().dot(direction);
    // Bright, with a dark rim for contrast with the background.
    let color = ball.color * if facing < 0.6 { 0.1 } else { 0.5 + 0.7 * facing };
    Some(if distance <= reach { color } else { behind.lerp(color, THROUGH) })
}

impl Ball {
    fn distance(&self, eye: Vec3, direction: Vec3) -> Option<f32> {
        let offset = self.centre - eye;
        let along = offset.dot(direction);
        let inside = self.radius * self.radius - (offset - direction * along).length_squared();
        (inside > 0.0).then(|| along - inside.sqrt()).filter(|distance| *distance > 0.0)
    }
}
