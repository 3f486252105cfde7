//! A random scene as files that `cairn bake` takes.

use super::super::rows::gltf::gltf;
use super::recipe::Recipe;
use cairn_wire::proto;
use cairn_wire::scene_file::SceneTree;
use cairn_wire::to_proto;
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
