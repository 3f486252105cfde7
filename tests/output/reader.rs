//! Reads a result back with the `gltf` crate, which validates it, and evaluates its animation.

use cairn_core::report::bake::BakedPile;
use glam::{DMat4, DQuat, DVec3};
use gltf::animation::util::ReadOutputs;
use serde_json::Value;

/// Parses a GLB with full validation.
pub fn read_valid(bytes: &[u8]) -> gltf::Gltf {
    let file = gltf::Gltf::from_slice(bytes).unwrap();
    for view in file.document.views() {
        assert_eq!(view.offset() % 4, 0);
        assert!(view.offset() + view.length() <= file.blob.as_ref().unwrap().len());
    }
    file
}

/// The JSON chunk of a GLB.
pub fn json_of(bytes: &[u8]) -> Value {
    serde_json::from_slice(&gltf::binary::Glb::from_slice(bytes).unwrap().json).unwrap()
}

/// The world matrix of the only node of that name, `seconds` into the animation.
pub fn world_matrix(file: &gltf::Gltf, name: &str, seconds: f64) -> DMat4 {
    let mut named = file.document.nodes().filter(|n| n.name() == Some(name));
    let node = named.next().unwrap_or_else(|| panic!("no node {name}"));
    assert!(named.next().is_none(), "two nodes {name}");
    world(file, &node, seconds)
}

/// The world matrix of the node found from `top` downward by names.
pub fn world_matrix_of_path(file: &gltf::Gltf, top: &str, path: &[&str], seconds: f64) -> DMat4 {
    let mut node = file.document.nodes().find(|n| n.name() == Some(top)).unwrap();
    for name in path {
        node = node.children().find(|n| n.name() == Some(name)).unwrap_or_else(|| panic!("no {name} below {top}"));
    }
    assert!(node.mesh().is_some());
    world(file, &node, seconds)
}

/// The world matrix with which the one mesh at or below `top`, once the node `name`, is drawn.
pub fn drawn_matrix(file: &gltf::Gltf, top: &str, name: &str, seconds: f64) -> DMat4 {
    let mut node = file.document.nodes().find(|n| n.name() == Some(top)).unwrap();
    while node.mesh().is_none() {
        assert_eq!(node.children().len(), 1);
        node = node.children().next().unwrap();
    }
    assert!([Some(name), Some(top)].contains(&node.name()));
    world(file, &node, seconds)
}

fn world(file: &gltf::Gltf, node: &gltf::Node, seconds: f64) -> DMat4 {
    let parent = file.document.nodes().find(|p| p.children().any(|c| c.index() == node.index()));
    let above = parent.map_or(DMat4::IDENTITY, |p| world(file, &p, seconds));
    above * local(file, node, seconds)
}

fn local(file: &gltf::Gltf, node: &gltf::Node, seconds: f64) -> DMat4 {
    if let gltf::scene::Transform::Matrix { matrix } = node.transform() {
        return glam::Mat4::from_cols_array_2d(&matrix).as_dmat4();
    }
    let (t, r, s) = node.transform().decomposed();
    let (mut translation, mut rotation) = (DVec3::from(t.map(f64::from)), DQuat::from_array(r.map(f64::from)));
    let channels = file.document.animations().flat_map(|a| a.channels().collect::<Vec<_>>());
    for channel in channels.filter(|c| c.target().node().index() == node.index()) {
        let reader = channel.reader(|_| file.blob.as_deref());
        let times: Vec<f64> = reader.read_inputs().unwrap().map(f64::from).collect();
        let next = times.partition_point(|&t| t < seconds).clamp(1, times.len() - 1);
        let share = ((seconds - times[next - 1]) / (times[next] - times[next - 1])).clamp(0.0, 1.0);
        match reader.read_outputs().unwrap() {
            ReadOutputs::Translations(keys) => {
                let keys: Vec<DVec3> = keys.map(|k| DVec3::from(k.map(f64::from))).collect();
                translation = keys[next - 1].lerp(keys[next], share);
            }
            ReadOutputs::Rotations(keys) => {
                let keys: Vec<DQuat> = keys.into_f32().map(|k| DQuat::from_array(k.map(f64::from))).collect();
                assert!(keys[next - 1].dot(keys[next]) > 0.0, "the sign jumps");
                rotation = keys[next - 1].slerp(keys[next], share);
            }
            _ => panic!("only translations and rotations are animated"),
        }
    }
    DMat4::from_scale_rotation_translation(DVec3::from(s.map(f64::from)), rotation.normalize(), translation)
}

/// Largest difference between the matrix of a body's node and its pose.
pub fn pose_error(found: &DMat4, pile: &BakedPile, frame: usize, body: usize) -> f64 {
    let pose = pile.frames[frame][body];
    let scale = DVec3::splat(pile.bodies[body].scale);
    let expected = DMat4::from_scale_rotation_translation(scale, pose.rotation.normalize(), pose.translation);
    let difference = (*found - expected).to_cols_array();
    difference.iter().fold(0.0, |worst, d| d.abs().max(worst))
}
