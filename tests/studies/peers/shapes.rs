//! Shapes and poses on their way to other engines and back.

use crate::format::{PeerBody, PeerShape, PeerSolid};
use anyhow::ensure;
use cairn_engine::shape::{Shape, Solid};
use cairn_geometry::pose::Pose;
use glam::{DMat3, DQuat, DVec3};

/// A box may lie this far from the centre of mass, in diameters: engines take it as lying there.
const OFF_CENTRE: f64 = 1e-3;

/// A prop's shape with this solid of it.
pub fn peer_shape(shape: &Shape, solid: &Solid, prop: usize, scale: f64) -> anyhow::Result<PeerShape> {
    let (principal, axes) = shape.inertia;
    let is_central = |center: DVec3| center.length() < OFF_CENTRE * shape.size.diameter;
    let (frame, solid) = match solid {
        Solid::Box(b) => {
            ensure!(is_central(b.center), "prop {prop}: a box off its centre of mass");
            (b.rotation, PeerSolid::Box((b.half * scale).to_array()))
        }
        Solid::Convex(parts) => {
            let point = |p: &DVec3| (axes.inverse() * *p * scale).to_array();
            (axes, PeerSolid::Hulls(parts.iter().map(|part| part.iter().map(point).collect()).collect()))
        }
        Solid::Ball { center, radius } => {
            ensure!(is_central(*center), "prop {prop}: a ball off its centre of mass");
            (axes, PeerSolid::Ball(radius * scale))
        }
    };
    let turn = DMat3::from_quat(frame.inverse() * axes);
    let inertia = (turn * DMat3::from_diagonal(principal) * turn.transpose()) * scale.powi(5);
    let inertia = [inertia.x_axis.x, inertia.y_axis.y, inertia.z_axis.z];
    Ok(PeerShape { prop, scale, frame: frame.to_array(), mass: shape.mass * scale.powi(3), inertia, solid })
}

/// A body of the pile, from its centre of mass and the prop's axes.
pub fn peer_body(shapes: &[PeerShape], shape: usize, pose: &Pose) -> PeerBody {
    let rotation = pose.rotation * DQuat::from_array(shapes[shape].frame);
    PeerBody { shape, position: pose.translation.to_array(), rotation: rotation.to_array() }
}

/// The inverse of [`peer_body`].
pub fn pose(shapes: &[PeerShape], body: &PeerBody) -> Pose {
    let rotation = DQuat::from_array(body.rotation).normalize() * DQuat::from_array(shapes[body.shape].frame).inverse();
    Pose { translation: DVec3::from_array(body.position), rotation }
}
