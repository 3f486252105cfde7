//! A layout as a model to look at: the place and the bodies, as a `.glb`.

use crate::{Library, Line};
use cairn_core::report::bake::{BakedBody, BakedPile, BakedSolid, BakedWorld};
use cairn_export::{ExportError, Format};
use cairn_geometry::pose::Pose;
use glam::{DQuat, DVec3};

/// The layout of a line as a `.glb`.
pub fn model(library: &Library, line: &Line) -> Result<Vec<u8>, ExportError> {
    let scene = library.scene();
    let place = line.place_number;
    let bodies = line.bodies.iter().enumerate().map(|(number, body)| BakedBody {
        prop: body.prop,
        number,
        scale: body.scale,
        first_frame: 0,
        mass_factor: 1.0,
        is_pinned: false,
    });
    let pose = |body: &crate::line::LineBody| Pose {
        translation: DVec3::from(body.position),
        rotation: DQuat::from_array(body.rotation).normalize(),
    };
    let solids = library.shapes.iter().zip(&scene.props);
    let pile = BakedPile {
        fps: 1.0,
        bodies: bodies.collect(),
        filled: 0,
        frames: vec![line.bodies.iter().map(pose).collect()],
        scenery: vec![Vec::new()],
        glue: None,
        solids: solids.map(|(shape, prop)| BakedSolid::new(shape, prop.friction, prop.restitution)).collect(),
        world: BakedWorld {
            gravity: library.params.gravity,
            ground: None,
            ground_friction: library.params.ground_friction,
            diameter: library.units.length,
        },
    };
    let origin = serde_json::json!({ "layout": line.layout });
    let mut shown = library.job.export_scene(&origin, None);
    shown.scenery = vec![shown.scenery[place]];
    shown.colliders = &scene.statics[place..=place];
    Ok(cairn_export::encode(Format::Glb, &pile, &shown)?.bytes)
}
