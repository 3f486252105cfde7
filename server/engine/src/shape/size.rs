//! The size of a prop, known without its collision shape.

use super::{FLAT_THICKNESS, fit, hull_mesh, mass, round};
use cairn_geometry::HOLLOW;
use cairn_geometry::measure::outermost_points;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::topology;
use glam::DVec3;

/// The size of a prop at scale 1, known without its collision shape.
#[derive(Clone, Copy, Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct Size {
    /// Of the bounding sphere, m.
    pub diameter: f64,
    /// Edges of the tightest box around the prop, ascending, m.
    pub extents: DVec3,
    /// m^3; of an open mesh, half its box: an estimate.
    pub volume: f64,
    /// m^3; of an open mesh with its holes capped, where that is more than next to nothing.
    pub enclosed: f64,
    /// Of its convex hull, m^3.
    pub hull_volume: f64,
    /// The mesh bounds a solid.
    pub closed: bool,
    /// The mesh has several parts, which may overlap.
    pub has_parts: bool,
    /// The radius on which it rolls, m; `None` where it is not round.
    pub round: Option<f64>,
    /// Thickness of its material, m: the smallest extent, or `6 V / A` where that is less, because it is hollow. Of a
    /// ball or a cube, both are the same; of a tube, the second is three of its walls.
    pub wall: f64,
}

impl Size {
    pub fn of(mesh: &TriMesh) -> Size {
        if mesh.triangles.is_empty() {
            return Size::default();
        }
        let (center, radius) = fit::bounding_sphere(mesh);
        let diameter = 2.0 * radius;
        let around = fit::oriented_box(mesh);
        let mut extents = (2.0 * around.half).max(DVec3::splat(FLAT_THICKNESS * diameter)).to_array();
        extents.sort_by(f64::total_cmp);
        let bulk = extents.iter().product::<f64>();
        let topology = topology::inspect(mesh);
        let has_parts = topology.components > 1 || topology.nonmanifold_edges > 0;
        let own = match topology.bounds_a_solid() {
            true => mass::of_solid(&mesh.outward(), has_parts).volume,
            false => 0.0,
        };
        let closed = own > HOLLOW * bulk;
        let volume = if closed { own } else { bulk / 2.0 };
        let capped = capped_volume(mesh, center);
        let enclosed = if closed {
            own
        } else if capped > HOLLOW * bulk {
            capped
        } else {
            volume
        };
        let hull_volume = hull_volume(mesh, center, radius).clamp(volume.min(bulk), bulk);
        let round = round::rolling_radius(mesh, &around);
        // Parts that overlap have surfaces inside, which are no walls.
        let is_whole = closed && !has_parts;
        let wall = if is_whole { extents[0].min(6.0 * own / mesh.area()) } else { extents[0] };
        Size {
            diameter,
            extents: DVec3::from_array(extents),
            volume,
            enclosed,
            hull_volume,
            closed,
            has_parts,
            round,
            wall,
        }
    }
}

/// What an open mesh encloses, such as a root with leaves, with its holes capped by cones to the middle.
fn capped_volume(mesh: &TriMesh, center: DVec3) -> f64 {
    let points = mesh.points.iter().map(|p| *p - center).collect();
    TriMesh { points, triangles: mesh.triangles.clone() }.signed_volume().abs()
}

/// The geometry library works in single precision: it sees the unit ball.
fn hull_volume(mesh: &TriMesh, center: DVec3, radius: f64) -> f64 {
    let unit: Vec<DVec3> = outermost_points(mesh).into_iter().map(|p| (p - center) / radius).collect();
    hull_mesh(&unit).signed_volume().abs() * radius.powi(3)
}
