//! A pile as other engines take it.

use crate::format::{PeerScene, PeerShape};
use crate::pile::Full;
use crate::shapes::{peer_body, peer_shape};
use anyhow::{anyhow, ensure};
use cairn_input::scene::Scene;
use cairn_prepare::check;

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
                let shape = &sim.pile.shapes[instance.prop];
                shapes.push(peer_shape(shape, &shape.solid, instance.prop, instance.scale)?);
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
        exact: false,
        launched: Vec::new(),
        scenery: Vec::new(),
    })
}

/// One for all pairs: engines differ in how they make one of two.
fn pair_friction(scene: &Scene, ground: f64, shapes: &[PeerShape]) -> anyhow::Result<f64> {
    ensure!(shapes.iter().all(|s| scene.props[s.prop].friction == ground), "props and ground need one friction");
    Ok(ground)
}
