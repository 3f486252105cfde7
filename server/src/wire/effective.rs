//! A scene with nothing left to defaults.

use super::from_proto::added;
use super::{proto, to_proto};
use cairn_core::input::params::Params;
use cairn_core::input::scene::{FRICTION, Model, Prop};

/// A scene with every parameter and every prop's value set: baked again, it gives the same.
pub fn effective(scene: &proto::Scene, params: &Params) -> proto::Scene {
    let default = Prop::new(Model::default());
    let prop = |prop: &proto::Prop| proto::Prop {
        path: prop.path.clone(),
        weight: prop.weight.or(Some(default.weight)),
        friction: prop.friction.or(Some(default.friction)),
        density: prop.density.or(Some(default.density)),
        restitution: prop.restitution.or(Some(default.restitution)),
        scale_min: prop.scale_min.or(Some(default.scale[0])),
        scale_max: prop.scale_max.or(Some(default.scale[1])),
        tilt_max: prop.tilt_max.or(Some(default.tilt_max)),
        scale_skew: prop.scale_skew.or(Some(default.scale_skew)),
        up: if prop.up.is_empty() { vec![0.0; 3] } else { prop.up.clone() },
        turns: match prop.turns() {
            proto::Turns::Unspecified => proto::Turns::Any,
            given => given,
        }
        .into(),
    };
    let scenery = |model: &proto::StaticModel| proto::StaticModel {
        path: model.path.clone(),
        friction: model.friction.or(Some(FRICTION)),
        keyframes: model.keyframes.iter().map(added::effective_key).collect(),
    };
    proto::Scene {
        control_mesh: scene.control_mesh.clone(),
        props: scene.props.iter().map(prop).collect(),
        statics: scene.statics.iter().map(scenery).collect(),
        bodies: scene.bodies.iter().map(added::effective_body).collect(),
        emitters: scene.emitters.iter().map(added::effective_emitter).collect(),
        region: scene.region.clone(),
        ..to_proto::params(params)
    }
}
