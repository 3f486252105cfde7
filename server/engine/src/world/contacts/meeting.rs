//! Where two convex pieces meet in a point or in a line, the normal is that of what meets there.
//!
//! The engine takes the best of all faces' normals, and of all directions across an edge of each. Where edges meet that
//! are parallel, or corners, every direction between those of the faces around parts the two, and the engine takes that
//! of some face: an edge of a card that leans against the edge of another is then pushed along the face of one of them,
//! which needs friction that no card needs. Here it is the middle of all directions that part them.

use crate::world::manifold::{Polyhedron, Small, polyhedron};
use glam::DVec3;
use rapier3d::math::Pose;
use rapier3d::parry::shape::Shape;

/// What is narrower than this, in the thickness of the thinner body, is a line: a strip that carries has a face.
const LINE: f64 = 0.005;
/// A point is on a face that is no farther than this, in the same: real edges are rounded by as much.
const ON_FACE: f64 = 0.02;
/// Edges are parallel where the sine of the angle between them is below this.
const PARALLEL: f64 = 0.02;
/// A direction of a corner counts if its sine to the edge is above this.
const BESIDE: f64 = 1e-3;
/// Steps of the search for the middle of the directions at two corners: it ends near enough long before.
const MOST_STEPS: usize = 200;
/// Two directions are one where their cosine is this near to 1, and no direction where a length is below it.
const ROUNDING: f64 = 1e-9;
/// A direction may press into a face by this sine.
const PRESSES: f64 = 1e-3;

/// A convex piece at its place.
pub(super) struct Piece<'a> {
    pub shape: &'a dyn Shape,
    pub at: Pose,
    /// Its points of the contact, in its own frame.
    pub points: Vec<DVec3>,
}

/// What of a polyhedron meets another.
enum Feature {
    Face,
    /// In this direction.
    Edge(DVec3),
    Corner,
}

/// The normal of the contact of two pieces, from the first to the second, where it is another than `normal`.
/// `thickness`: of the thinner body. World axes.
pub(super) fn normal(first: &Piece, second: &Piece, normal: DVec3, thickness: f64) -> Option<DVec3> {
    let line = line(&first.world_points(), LINE * thickness)?;
    let (mut room_a, mut room_b): (Option<Small>, Option<Small>) = (None, None);
    let (a, b) = (polyhedron(first.shape, &mut room_a)?, polyhedron(second.shape, &mut room_b)?);
    let near = ON_FACE * thickness;
    let features = (first.feature(&a, near, line), second.feature(&b, near, line));
    // A direction parts the two if all corners of the first are behind the point, and those of the second before it.
    let mut before: Vec<DVec3> = first.ways(&a, near).into_iter().map(|way| -way).collect();
    before.extend(second.ways(&b, near));
    let parts = |direction: &DVec3| before.iter().all(|way| direction.dot(*way) >= -PRESSES);
    let middle = match features {
        (Feature::Face, _) | (_, Feature::Face) => None,
        (Feature::Edge(u), Feature::Edge(v)) if u.cross(v).length() > PARALLEL => Some(u.cross(v).normalize()),
        (Feature::Edge(u), _) | (_, Feature::Edge(u)) => middle_across(u, &before, normal),
        (Feature::Corner, Feature::Corner) => middle(&before),
    };
    let toward = middle.map(|m| if m.dot(normal) < 0.0 { -m } else { m });
    toward.filter(|m| parts(m) && m.dot(normal) < 1.0 - ROUNDING)
}

/// The direction of the line on which all points are; zero for a single point, `None` where they are on no line.
fn line(points: &[DVec3], width: f64) -> Option<DVec3> {
    let from = *points.first()?;
    let far = points.iter().map(|&p| p - from).max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))?;
    if far.length() <= width {
        return Some(DVec3::ZERO);
    }
    let along = far.normalize();
    points.iter().all(|&p| (p - from).reject_from_normalized(along).length() <= width).then_some(along)
}

impl Piece<'_> {
    fn world_points(&self) -> Vec<DVec3> {
        self.points.iter().map(|p| self.at.transform_point(p.as_vec3()).as_dvec3()).collect()
    }

    fn turned(&self, direction: DVec3) -> DVec3 {
        self.at.rotation.as_dquat() * direction
    }

    /// What of the polyhedron has all points. `line`: on which they are, world axes.
    fn feature(&self, of: &Polyhedron, near: f64, line: DVec3) -> Feature {
        let has = |facet: &usize| {
            let (normal, offset) = (of.normal(*facet).as_dvec3(), f64::from(of.offset(*facet)));
            self.points.iter().all(|p| p.dot(normal) - offset >= -near)
        };
        let facets: Vec<DVec3> = (0..of.facets).filter(has).map(|f| of.normal(f).as_dvec3()).collect();
        match &facets[..] {
            [] | [_] => Feature::Face,
            _ if line != DVec3::ZERO => Feature::Edge(line),
            [a, b] => Feature::Edge(self.turned(a.cross(*b).normalize_or_zero())),
            _ => Feature::Corner,
        }
    }

    /// From the middle of the points to each corner that is not there, unit, world axes.
    fn ways(&self, of: &Polyhedron, near: f64) -> Vec<DVec3> {
        let middle = self.points.iter().sum::<DVec3>() / self.points.len() as f64;
        let way = |k: usize| {
            let way = of.corner(k).as_dvec3() - middle;
            (way.length() > near).then(|| self.turned(way.normalize()))
        };
        (0..of.corners.len()).filter_map(way).collect()
    }
}

/// The middle of the directions across an edge that have no way behind them. `from`: near which it is.
fn middle_across(edge: DVec3, before: &[DVec3], from: DVec3) -> Option<DVec3> {
    let right = from.reject_from_normalized(edge).try_normalize()?;
    let up = edge.cross(right);
    let across = before.iter().map(|way| way.reject_from_normalized(edge)).filter(|way| way.length() > BESIDE);
    let angle = |way: DVec3| libm::atan2(way.dot(up), way.dot(right));
    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
    for way in across {
        least = least.min(angle(way));
        most = most.max(angle(way));
    }
    // Each way allows directions up to a right angle from it.
    if !(most - least).is_finite() || most - least > std::f64::consts::PI {
        return None;
    }
    let (sin, cos) = libm::sincos((least + most) / 2.0);
    Some(right * cos + up * sin)
}

/// The direction that is farthest from being across any of these: that of the point of their hull nearest to the
/// origin (Gilbert 1966).
fn middle(before: &[DVec3]) -> Option<DVec3> {
    let mut point = *before.first()?;
    for _ in 0..MOST_STEPS {
        let next = before.iter().copied().min_by(|a, b| a.dot(point).total_cmp(&b.dot(point)))?;
        let way = next - point;
        if way.dot(point) >= -ROUNDING || way.length_squared() == 0.0 {
            break;
        }
        point += way * (-point.dot(way) / way.length_squared()).clamp(0.0, 1.0);
    }
    (point.length() > PRESSES).then(|| point.normalize())
}
