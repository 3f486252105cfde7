//! What a folder of layouts says once: props and places as simulators take them.

use crate::Library;
use crate::line::{inertia, significant};
use cairn_engine::shape::{OrientedBox, Shape, Solid};
use glam::DVec3;
use serde_json::{Value, json};

/// The file beside the lines.
pub fn assets(library: &Library) -> Value {
    let scene = library.scene();
    let props = library.shapes.iter().enumerate().map(|(i, shape)| {
        let (prop, entry) = (&scene.props[i], &library.catalogue.props[i]);
        let (file, node) = cairn_files::split_node(&entry.path);
        json!({
            "label": library.labels[i],
            "file": file,
            "node": node,
            "license": entry.license,
            "friction": prop.friction,
            "restitution": prop.restitution,
            "density": prop.density,
            "mass": significant(shape.mass),
            "center_of_mass": shape.center.to_array().map(significant),
            "inertia": inertia(shape.inertia, 1.0).map(significant),
            "diameter": significant(shape.size.diameter),
            "solids": solids(shape),
        })
    });
    let places = scene.statics.iter().enumerate().map(|(i, model)| {
        let entry = &library.catalogue.places[i];
        let (file, node) = cairn_files::split_node(&entry.path);
        let solids = library.places[i].cover.solids.iter().map(|points| hull(points.iter().copied()));
        json!({
            "label": library.places[i].label,
            "file": file,
            "node": node,
            "license": entry.license,
            "friction": model.friction,
            "solids": solids.collect::<Value>(),
        })
    });
    json!({
        "version": cairn_files::version::VERSION,
        "catalogue": library.hash,
        "up": "y",
        "quaternion": "xyzw",
        "gravity": library.params.gravity,
        "props": props.collect::<Value>(),
        "places": places.collect::<Value>(),
    })
}

fn hull(points: impl Iterator<Item = DVec3>) -> Value {
    json!({ "kind": "hull", "points": points.map(|p| p.to_array().map(significant)).collect::<Vec<_>>() })
}

/// The collision shape of a prop in its own frame: the very one that came to rest. Of another, a can would lie on other
/// facets, and roll.
fn solids(shape: &Shape) -> Vec<Value> {
    let own = |p: DVec3| (p + shape.center).to_array().map(significant);
    match &shape.solid {
        &Solid::Box(OrientedBox { center, rotation, half }) => vec![json!({
            "kind": "box",
            "center": own(center),
            "rotation": rotation.to_array().map(significant),
            "half": half.to_array().map(significant),
        })],
        Solid::Ball { center, radius } => {
            vec![json!({ "kind": "ball", "center": own(*center), "radius": significant(*radius) })]
        }
        Solid::Convex(parts) => parts.iter().map(|part| hull(part.iter().map(|&p| p + shape.center))).collect(),
    }
}
