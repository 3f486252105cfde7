//! Meshes that would take too long, known before anything looks into them.

use cairn_geometry::interior::crowding::crowding;
use cairn_input::error::SceneProblem;
use cairn_input::scene::{EmitterVolume, Model, Scene};

/// A problem for each mesh with too many triangles in nearly the same place.
pub fn check(scene: &Scene) -> Result<(), Vec<SceneProblem>> {
    let mut models: Vec<(String, &Model)> = Vec::new();
    models.extend(scene.control.iter().map(|model| ("control_mesh".into(), model)));
    models.extend(scene.region.iter().map(|model| ("region".into(), model)));
    models.extend(scene.props.iter().enumerate().map(|(i, prop)| (format!("props.{i}"), &prop.model)));
    models.extend(scene.statics.iter().enumerate().map(|(i, fixed)| (format!("statics.{i}"), &fixed.model)));
    models.extend(scene.emitters.iter().enumerate().filter_map(|(i, emitter)| match &emitter.place {
        EmitterVolume::Mesh(model) => Some((format!("emitters.{i}"), model)),
        EmitterVolume::Box { .. } => None,
    }));
    let problem = |(field, model): (String, &Model)| {
        let met = crowding(&model.mesh)?;
        let text = format!(
            "{}: too many of its {} triangles are in nearly the same place, {met} on average; remove copies of its \
             parts (in Blender: Mesh, Clean Up, Merge by Distance)",
            model.name,
            model.mesh.triangles.len()
        );
        Some(SceneProblem::new(field, text))
    };
    let problems: Vec<SceneProblem> = models.into_iter().filter_map(problem).collect();
    if problems.is_empty() { Ok(()) } else { Err(problems) }
}
