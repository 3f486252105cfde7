//! The effective scene: all defaults are filled in.

use super::{parameters, proto};
use cairn_core::input::params::Params;

/// The scene with every parameter and every prop's value set. It bakes to the same result.
pub fn effective(scene: &proto::Scene, params: &Params) -> proto::Scene {
    let mut effective = proto::Scene {
        control_mesh: scene.control_mesh.clone(),
        props: scene.props.clone(),
        statics: scene.statics.clone(),
        bodies: scene.bodies.clone(),
        emitters: scene.emitters.clone(),
        region: scene.region.clone(),
        piles: scene.piles.clone(),
        around: scene.around.clone(),
        usd: scene.usd.clone(),
        ..parameters::to_scene(params)
    };
    if let Some(fill) = &mut effective.fill {
        fill.into = scene.fill.as_ref().and_then(|fill| fill.into.clone());
    }
    effective.set_defaults();
    effective
}
