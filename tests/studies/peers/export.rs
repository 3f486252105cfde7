//! A pile as other engines take it, and poses on their way there and back.

use crate::format::{PeerBody, PeerScene, PeerShape, PeerSolid};
use crate::pile::Full;
use anyhow::{anyhow, bail, ensure};
use cairn_core::geometry::pose::Pose;
use cairn_core::input::scene::Scene;
use cairn_core::prepare::check;
use cairn_core::prepare::shape::{Shape, Solid};
use glam::{DMat3, DQuat, DVec3};

/// A box may lie this far from the centre of mass, in diameters: engines take it as lying there.
const OFF_CENTRE: f64 = 1e-3;

/// The pile right after turning over.
pub fn scene(full: &Full, frames: u32) -> anyhow::Result<PeerScene> {
    let (scene, params) = (&full.job.scene, &full.job.params);
    ensure!(scene.statics.is_empty() && params.ground, "a pile on the ground and without scenery is needed");
    let sim = full.turn_over()?;
    let (world, mut shapes, mut bodies) = (&sim.pile.world, Vec::<PeerShape>::new(), Vec::new());
    for (id, instance) in sim.pile.instances.iter().enumerate() {
        let known = shapes.iter().position(|s| s.prop == instance.prop && s.scale == instance.scale);
        let shape = match known {
            Some(shape) => shape,
            None => {
                shapes.push(peer_shape(&sim.pile.shapes[instance.prop], instance.prop, instance.scale)?);
                shapes.len() - 1
            }
        };
        bodies.push(peer_body(&shapes, shape, &world.units.pose_to_si(&world.pose(id))));
    }
    Ok(PeerScene {
        file: full.file.clone(),
        set: full.set.clone(),
        gravity: params.gravity,
        friction: pair_friction(scene, params.ground_friction, &shapes)?,
        ground: check::run(scene, params).map_err(|problems| anyhow!("{problems:?}"))?.ground,
        frames,
        fps: params.output.fps,
        shapes,
        bodies,
    })
}

/// One for all pairs: engines differ in how they make one of two.
fn pair_friction(scene: &Scene, ground: f64, shapes: &[PeerShape]) -> anyhow::Result<f64> {
    ensure!(shapes.iter().all(|s| scene.props[s.prop].friction == ground), "props and ground need one friction");
    Ok(ground)
}

fn peer_shape(shape: &Shape, prop: usize, scale: f64) -> anyhow::Result<PeerShape> {
    let (principal, axes) = shape.inertia;
    let (frame, solid) = match &shape.solid {
        Solid::Box(b) => {
            ensure!(b.center.length() < OFF_CENTRE * shape.size.diameter, "prop {prop}: a box off its centre of mass");
            (b.rotation, PeerSolid::Box((b.half * scale).to_array()))
        }
        Solid::Convex(parts) => {
            let point = |p: &DVec3| (axes.inverse() * *p * scale).to_array();
            (axes, PeerSolid::Hulls(parts.iter().map(|part| part.iter().map(point).collect()).collect()))
        }
        Solid::Ball { .. } => bail!("prop {prop}: balls are not handed over"),
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
