//! Stable poses of a prop: on the flat sides of its hull on which it stays by itself.

use cairn_engine::shape::{Shape, corners, hull_mesh};
use cairn_geometry::pose::Pose;
use cairn_geometry::rectangle::smallest_rectangle;
use glam::{DQuat, DVec2, DVec3};

/// Facets of the hull whose normals differ by less than this (1 - cos, 2.5 degrees) are one side.
const SAME_SIDE: f64 = 1e-3;
/// The side on which a prop was modelled is chosen if it has this share of the area of its largest side.
const AS_MODELLED: f64 = 0.1;

/// A pose in which a prop lies by itself: its up axis, and the turn about it that puts its longer edge along X.
#[derive(Clone, Copy, Debug)]
pub struct StablePose {
    /// From the body's frame to one with its up axis along Y and its longer edge along X.
    pub rotation: DQuat,
    /// The direction of the body's frame that is up.
    pub up: DVec3,
    /// Edges of the smallest rectangle around its outline seen from above, the longer one first, m at scale 1.
    pub edges: DVec2,
    /// m at scale 1.
    pub height: f64,
}

/// The flattest stable pose: on the side on which the prop was modelled where that is not a narrow one, else on its
/// largest. `None` for a prop without a flat side, such as a ball.
pub fn flattest(shape: &Shape) -> Option<StablePose> {
    let unit = shape.size.diameter;
    let points: Vec<DVec3> = corners(shape, 1.0 / unit, &Pose::IDENTITY).collect();
    let hull = hull_mesh(&points);
    let mut sides: Vec<(DVec3, f64, bool)> = Vec::new();
    for i in 0..hull.triangles.len() {
        let [a, b, c] = hull.corners(i);
        let twice = (b - a).cross(c - a);
        let Some(normal) = twice.try_normalize() else { continue };
        // Seen along the normal, the centre of mass (the origin) is inside this facet.
        let inside = [(a, b), (b, c), (c, a)].iter().all(|(p, q)| (*q - *p).cross(-*p).dot(normal) >= -1e-9);
        match sides.iter_mut().find(|(n, ..)| n.dot(normal) > 1.0 - SAME_SIDE) {
            Some(side) => {
                side.1 += twice.length() / 2.0;
                side.2 |= inside;
            }
            None => sides.push((normal, twice.length() / 2.0, inside)),
        }
    }
    let stable = || sides.iter().filter(|(.., stable)| *stable);
    let largest = stable().map(|(_, area, _)| *area).reduce(f64::max)?;
    let wide = stable().filter(|(_, area, _)| *area >= AS_MODELLED * largest);
    let modelled = wide.clone().find(|(normal, ..)| normal.y < -1.0 + SAME_SIDE);
    let (down, ..) = modelled.or_else(|| stable().find(|(_, area, _)| *area == largest))?;
    Some(lying(&points, -*down, unit))
}

/// The pose with this direction of the body's frame up.
pub fn upright(shape: &Shape, up: DVec3) -> StablePose {
    let unit = shape.size.diameter;
    let points: Vec<DVec3> = corners(shape, 1.0 / unit, &Pose::IDENTITY).collect();
    lying(&points, up.normalize_or(DVec3::Y), unit)
}

fn lying(points: &[DVec3], up: DVec3, unit: f64) -> StablePose {
    let tilt = DQuat::from_rotation_arc(up, DVec3::Y);
    let upright: Vec<DVec3> = points.iter().map(|&p| tilt * p).collect();
    let flat: Vec<DVec2> = upright.iter().map(|p| DVec2::new(p.x, p.z)).collect();
    let (turn, edges) = smallest_rectangle(&flat);
    let height = |f: fn(f64, f64) -> f64, start: f64| upright.iter().map(|p| p.y).fold(start, f);
    let height = height(f64::max, f64::NEG_INFINITY) - height(f64::min, f64::INFINITY);
    StablePose {
        rotation: (DQuat::from_rotation_y(turn) * tilt).normalize(),
        up,
        edges: edges * unit,
        height: height * unit,
    }
}
