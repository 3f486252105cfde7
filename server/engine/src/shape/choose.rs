//! The choice of the solid that stands for a prop: the cheapest one that is close enough.

use super::convex::{Extent, Fitted};
use super::fit::{self, OrientedBox};
use super::{FLAT_THICKNESS, INVISIBLE, ShapeKind, Size, Solid, convex, mass};
use cairn_geometry::mesh::TriMesh;
use cairn_input::params::Physics;
use glam::DVec3;

/// A ball's faceted mesh keeps at least this share of its circumscribed radius (by volume). No convex mesh of 80 faces
/// or fewer does (Fejes Toth's bound): dice and gems should not roll like balls.
const BALL_ROUNDNESS: f64 = 0.97;

/// The corners of a box that stands for a mesh stand out by no more, in prop diameters. Bevels and rounded edges that
/// leave the volume alone are within it; a cut corner is not.
const CORNER_OFF: f64 = 0.05;
/// The outline of a sheet fills at least this share of its box: a disc fills 0.79, a leaf 0.67, a triangle half.
const SHEET_SHARE: f64 = 0.6;

/// The cheapest solid that is close enough, and holds what is no farther from the mesh than `off`, m.
pub fn solid(mesh: &TriMesh, around: &OrientedBox, size: &Size, off: f64, physics: &Physics) -> Fitted {
    let Size { diameter, closed, .. } = *size;
    let extent = Extent { diameter, thickness: 2.0 * around.half.min_element(), off };
    let simple = primitive(mesh, around, extent, closed, physics);
    simple.unwrap_or_else(|| convex::decompose(mesh, extent, closed, physics))
}

/// The box or the ball that the mesh is, or the plate that a sheet is.
fn primitive(mesh: &TriMesh, around: &OrientedBox, extent: Extent, closed: bool, physics: &Physics) -> Option<Fitted> {
    let Extent { diameter, thickness, off } = extent;
    // Several times cheaper than a hull.
    let fitted = |solid: Solid, deviation: f64| {
        let solid = solid.larger(off);
        Fitted { bare: solid.clone(), solid, deviation: deviation + off }
    };
    let gap = physics.shape_gap * thickness;
    let tolerance = (f64::from(INVISIBLE) * diameter).min(gap);
    let flat = FLAT_THICKNESS * diameter;
    if thickness < flat {
        // A sheet: its box, given some thickness, or its outline.
        let b = OrientedBox { half: around.half.max(DVec3::splat(flat / 2.0)), ..*around };
        let own = |corners: &[DVec3]| convex::distance(mesh, diameter, closed, corners).max(flat / 2.0);
        // Of a line there is no share.
        let is_sparse = around.share(mesh) < SHEET_SHARE;
        if !is_sparse {
            return Some(fitted(Solid::Box(b), own(&b.corners().collect::<Vec<_>>())));
        }
        let corners = b.plate(mesh);
        let plate = convex::hull_mesh(&corners);
        let fitted = convex::decompose(&plate, Extent { thickness: flat, ..extent }, true, physics);
        return Some(Fitted { deviation: fitted.deviation + own(&corners), ..fitted });
    }
    if !closed || !physics.switches.primitives.is_on(true) {
        return None;
    }
    let volume = mass::moments(mesh).volume;
    let box_deviation = around.deviation(mesh);
    if box_deviation < tolerance && (volume / around.volume() - 1.0).abs() < 0.05 {
        let corners: Vec<DVec3> = around.corners().collect();
        let deviation = box_deviation.max(convex::distance(mesh, diameter, closed, &corners));
        if deviation <= CORNER_OFF * diameter {
            return Some(fitted(Solid::Box(*around), deviation));
        }
    }
    let (center, radius) = fit::bounding_sphere(mesh);
    let own_radius = libm::cbrt(volume.abs() * 0.75 / std::f64::consts::PI);
    let round = radius > 0.0 && own_radius / radius > BALL_ROUNDNESS;
    // A faceted ball lies inside its sphere, farthest from it in the middle of its facets: few touch just there.
    let deviation = radius - fit::inner_radius(mesh, center);
    (round && deviation <= 2.0 * gap).then(|| fitted(Solid::Ball { center, radius }, deviation))
}

/// The kind that the solid of a closed mesh will have, without splitting it.
pub fn kind(mesh: &TriMesh, diameter: f64, physics: &Physics) -> ShapeKind {
    let around = fit::oriented_box(mesh);
    let extent = Extent { diameter, thickness: 2.0 * around.half.min_element(), off: 0.0 };
    match primitive(mesh, &around, extent, true, physics) {
        Some(Fitted { solid, .. }) => solid.kind(),
        None if convex::is_one_hull(mesh, diameter, true, physics) => ShapeKind::Hull,
        None => ShapeKind::Parts,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_input::params::{Accuracy, Params};
    use std::f64::consts::{PI, TAU};

    /// A globe of so many meridians, and half as many parallels.
    fn globe(meridians: u32) -> TriMesh {
        let rows = meridians / 2;
        let at = |row: u32, k: u32| {
            let (down, turn) = (PI * f64::from(row) / f64::from(rows), TAU * f64::from(k) / f64::from(meridians));
            DVec3::new(down.sin() * turn.cos(), down.cos(), down.sin() * turn.sin())
        };
        let points = (0..=rows).flat_map(|row| (0..meridians).map(move |k| at(row, k))).collect();
        let number = |row: u32, k: u32| row * meridians + k % meridians;
        let quad = |row: u32, k: u32| {
            let [a, b, c, d] = [number(row, k), number(row, k + 1), number(row + 1, k + 1), number(row + 1, k)];
            [[a, b, c], [a, c, d]]
        };
        let triangles = (0..rows).flat_map(|row| (0..meridians).flat_map(move |k| quad(row, k))).collect();
        TriMesh { points, triangles }
    }

    #[test]
    fn a_ball_holds_its_mesh_or_is_a_hull() {
        let physics = Params::new(Accuracy::Standard).physics;
        let size = Size { diameter: 2.0, closed: true, ..Size::default() };
        let fine = globe(48);
        let Fitted { solid, deviation, .. } = solid(&fine, &fit::oriented_box(&fine), &size, 0.0, &physics);
        let Solid::Ball { center, radius } = solid else { panic!("it is a ball") };
        assert!(fine.points.iter().all(|p| p.distance(center) <= radius + 1e-9) && deviation < 0.04);
        let coarse = globe(10);
        let Fitted { solid, .. } = super::solid(&coarse, &fit::oriented_box(&coarse), &size, 0.0, &physics);
        assert_eq!(solid.kind(), ShapeKind::Hull, "its facets are too far from any ball");
    }
}
