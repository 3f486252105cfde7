//! A random scene as files that `cairn bake` takes.

use super::recipe::Recipe;
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use cairn::scene_file::SceneTree;
use cairn::wire::proto;
use cairn::wire::to_proto;
use cairn_core::geometry::mesh::TriMesh;
use std::path::{Path, PathBuf};

/// Writes `scene.toml` and its models. Returns the scene file's path.
pub fn write(recipe: &Recipe, folder: &Path) -> std::io::Result<PathBuf> {
    let (scene, params) = recipe.scene();
    std::fs::create_dir_all(folder)?;
    let mut file = to_proto::params(&params);
    for prop in &scene.props {
        let path = format!("{}.gltf", prop.model.name);
        std::fs::write(folder.join(&path), gltf(&prop.model.mesh))?;
        let (friction, density) = (Some(prop.friction), Some(prop.density));
        file.props.push(proto::Prop { path, friction, density, ..Default::default() });
    }
    if let Some(control) = &scene.control {
        std::fs::write(folder.join("control.gltf"), gltf(&control.mesh))?;
        file.control_mesh = Some(proto::ControlMesh { path: "control.gltf".into() });
    }
    for body in &scene.bodies {
        file.bodies.push(proto::Body {
            prop: scene.props[body.prop].model.name.clone(),
            position: body.pose.translation.to_array().to_vec(),
            rotation: body.pose.rotation.to_array().to_vec(),
            mass: body.mass,
            ..Default::default()
        });
    }
    let path = folder.join("scene.toml");
    std::fs::write(&path, SceneTree::from_message(&file).to_toml())?;
    Ok(path)
}

/// A glTF file with its buffer inside.
fn gltf(mesh: &TriMesh) -> String {
    let mut bytes: Vec<u8> = Vec::new();
    mesh.points.iter().flat_map(|p| p.to_array()).for_each(|v| bytes.extend((v as f32).to_le_bytes()));
    let indices = bytes.len();
    mesh.triangles.iter().flatten().for_each(|v| bytes.extend(v.to_le_bytes()));
    let (lo, hi) = mesh.bounds();
    let near = |v: glam::DVec3| v.as_vec3().to_array();
    serde_json::json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": mesh.points.len(), "type": "VEC3", "min": near(lo), "max": near(hi) },
            { "bufferView": 1, "componentType": 5125, "count": 3 * mesh.triangles.len(), "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": indices },
            { "buffer": 0, "byteOffset": indices, "byteLength": bytes.len() - indices },
        ],
        "buffers": [{
            "byteLength": bytes.len(),
            "uri": format!("data:application/octet-stream;base64,{}", BASE64_STANDARD.encode(&bytes)),
        }],
    })
    .to_string()
}
