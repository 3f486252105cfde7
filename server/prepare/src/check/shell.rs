//! Piles of which only the surface is made of props.

use super::{added, median_diameter};
use crate::container::core::Core;
use cairn_engine::shape::Size;
use cairn_geometry::ClosedMesh;
use cairn_input::error::SceneProblem;
use cairn_input::params::Params;
use cairn_input::scene::{Prop, Scene};

/// Props that are thicker than the shell find no room in it.
pub fn too_thin(scene: &Scene, params: &Params, sizes: &[Size]) -> Option<SceneProblem> {
    let shell = params.fill.shell.filter(|_| scene.is_filled(params))?;
    let diameter = median_diameter(&scene.props, sizes, &added::shares(scene, params));
    let thickness = |(prop, size): &(&Prop, &Size)| size.extents.x * prop.scale[1];
    let drawn = scene.props.iter().zip(sizes).filter(|(prop, _)| prop.weight > 0.0);
    let thickest = drawn.max_by(|a, b| thickness(a).total_cmp(&thickness(b)))?;
    let least = thickness(&thickest);
    (shell * diameter < least).then(|| {
        let text = format!(
            "fill.shell: {shell} is a shell of {:.3} m, and {} is {least:.3} m thick, so that it finds no room there; \
             give at least {:.2}",
            shell * diameter,
            thickest.0.model.name,
            (least / diameter * 100.0).ceil() / 100.0
        );
        SceneProblem::new("fill.shell", text)
    })
}

/// The core of a pile that is to be a shell; `None`, with a warning, where no place is deep enough.
pub fn core(
    scene: &Scene,
    params: &Params,
    control: &ClosedMesh,
    ground: f64,
    diameter: f64,
    warnings: &mut Vec<String>,
) -> Option<Core> {
    let shell = params.fill.shell?;
    let (low, high) = control.mesh.bounds();
    let cut = params.base.height * (high.y - low.y.max(ground));
    let core = Core::new(control, ground, cut, shell * diameter, diameter);
    if core.is_none() {
        warnings.push(format!(
            "{}: no place is deeper than fill.shell = {shell} ({:.3} m), so that all of it is filled; give less",
            scene.control.as_ref().map_or("", |model| &model.name),
            shell * diameter
        ));
    }
    core
}
