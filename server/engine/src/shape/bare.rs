//! Shapes as statics judges them: as near to the meshes as they can be.

use super::convex::MOST_CORNERS;
use super::{Shape, Solid, sphere};
use cairn_geometry::hull::convex_hull;
use cairn_geometry::mesh::TriMesh;
use glam::DVec3;
use rapier3d::math::Vector;
use std::sync::OnceLock;

/// A box that is nearer than this to its mesh is the mesh, in prop diameters: a few roundings of a file.
const SAME: f64 = 1e-6;

impl Shape {
    /// The same shape without its skin, and with all corners of its mesh where one convex piece stands for that. What
    /// lay on another's skin is that far from it now ([`Shape::skin`]).
    pub fn bared(&self, mesh: &TriMesh) -> Shape {
        let solid = match &self.solid {
            Solid::Ball { .. } => self.solid.clone(),
            Solid::Convex(parts) if parts.len() > 1 => self.bare.clone(),
            Solid::Box(_) | Solid::Convex(_) => self.exact_hull(mesh).unwrap_or_else(|| self.bare.clone()),
        };
        let skin = stands_out(&self.solid, &solid);
        let solid = match &self.solid {
            Solid::Box(_) if skin < SAME * self.size.diameter => self.solid.clone(),
            _ => solid,
        };
        let fit = super::ShapeFit { kind: solid.kind(), parts: solid.parts(), ..self.report.clone() };
        Shape { bare: solid.clone(), solid, skin, report: fit, hulls: OnceLock::new(), ..self.clone() }
    }

    /// The hull of a mesh, about the center of mass. `None`: it has too many corners, or no volume.
    fn exact_hull(&self, mesh: &TriMesh) -> Option<Solid> {
        let diameter = self.size.diameter;
        let points: Vec<Vector> = mesh.points.iter().map(|&p| ((p - self.center) / diameter).as_vec3()).collect();
        let (corners, _) = convex_hull(&points)?;
        let corners: Vec<DVec3> = corners.into_iter().map(|p| p.as_dvec3() * diameter).collect();
        let thinnest = sphere().map(|way| outermost(&corners, way) + outermost(&corners, -way));
        let has_volume = thinnest.fold(f64::INFINITY, f64::min) > SAME * diameter;
        (has_volume && corners.len() <= MOST_CORNERS).then(|| Solid::Convex(vec![corners]))
    }
}

fn outermost(points: &[DVec3], way: DVec3) -> f64 {
    points.iter().map(|p| p.dot(way)).fold(f64::NEG_INFINITY, f64::max)
}

/// How far a solid stands out of another one with as many pieces, m.
fn stands_out(solid: &Solid, of: &Solid) -> f64 {
    let pieces = |solid: &Solid| match solid {
        Solid::Convex(parts) => parts.clone(),
        _ => solid.meshes().into_iter().map(|mesh| mesh.points).collect(),
    };
    let by = |(piece, other): (&Vec<DVec3>, &Vec<DVec3>)| {
        sphere().map(|way| outermost(piece, way) - outermost(other, way)).fold(0.0, f64::max)
    };
    pieces(solid).iter().zip(&pieces(of)).map(by).fold(0.0, f64::max)
}
