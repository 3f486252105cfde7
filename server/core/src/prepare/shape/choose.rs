//! The choice of the solid that stands for a prop: the cheapest one that is close enough.

use super::fit::{self, OrientedBox};
use super::{FLAT_THICKNESS, INVISIBLE, ShapeKind, Solid, convex, mass};
use crate::geometry::mesh::TriMesh;
use crate::input::params::{Physics, Switch};
use glam::DVec3;

/// A ball's faceted mesh keeps at least this share of its circumscribed radius (by volume). No convex mesh of 80 faces
/// or fewer does (Fejes Toth's bound): dice and gems should not roll like balls.
const BALL_ROUNDNESS: f64 = 0.97;

/// The cheapest solid that is close enough, and its distance from the mesh, m.
pub fn solid(mesh: &TriMesh, around: &OrientedBox, diameter: f64, closed: bool, physics: &Physics) -> (Solid, f64) {
    let fitted = primitive(mesh, around, diameter, closed, physics.switches.primitives);
    fitted.unwrap_or_else(|| convex::decompose(mesh, diameter, 2.0 * around.half.min_element(), closed, physics))
}

/// The box or the ball that the mesh is, or the box of a sheet, and its distance from the mesh, m.
fn primitive(
    mesh: &TriMesh,
    around: &OrientedBox,
    diameter: f64,
    closed: bool,
    switch: Switch,
) -> Option<(Solid, f64)> {
    // Several times cheaper than a hull.
    let tolerance = f64::from(INVISIBLE) * diameter;
    let flat = FLAT_THICKNESS * diameter;
    if around.half.min_element() * 2.0 < flat {
        // A sheet: its box, given some thickness.
        let b = OrientedBox { half: around.half.max(DVec3::splat(flat / 2.0)), ..*around };
        return Some((Solid::Box(b), flat / 2.0));
    }
    if !closed || !switch.is_on(true) {
        return None;
    }
    let volume = mass::moments(mesh).volume;
    let box_deviation = around.deviation(mesh);
    if box_deviation < tolerance && (volume / around.volume() - 1.0).abs() < 0.05 {
        return Some((Solid::Box(*around), box_deviation));
    }
    let (center, radius) = fit::bounding_sphere(mesh);
    // A faceted ball lies inside its sphere: the collision ball has the mesh's own volume.
    let ball_radius = (volume.abs() * 0.75 / std::f64::consts::PI).cbrt();
    let round = radius > 0.0 && ball_radius / radius > BALL_ROUNDNESS;
    round.then(|| {
        let deviation = fit::ball_deviation(mesh, center, ball_radius);
        (Solid::Ball { center, radius: ball_radius }, deviation)
    })
}

/// The kind that the solid of a closed mesh will have, without splitting it.
pub fn kind(mesh: &TriMesh, diameter: f64, physics: &Physics) -> ShapeKind {
    match primitive(mesh, &fit::oriented_box(mesh), diameter, true, physics.switches.primitives) {
        Some((solid, _)) => solid.kind(),
        None if convex::is_one_hull(mesh, diameter, true, physics) => ShapeKind::Hull,
        None => ShapeKind::Parts,
    }
}
