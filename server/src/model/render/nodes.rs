//! Where every node of a file stands at a moment of its animation.

use super::animation;
use super::local::{Local, unit};
use crate::model::accessor;
use crate::model::document::{Document, DocumentError, reference, references};
use glam::{DAffine3, DMat4, DQuat, DVec3};
use serde_json::{Map, Value};

const INSTANCING: &str = "EXT_mesh_gpu_instancing";
const PILE: &str = "pile";

/// A mesh somewhere in the world.
pub struct Placed {
    pub mesh: usize,
    pub world: DAffine3,
    /// Below the node `pile`.
    pub in_pile: bool,
    /// Which child of that node.
    pub body: Option<usize>,
}

/// Every mesh of the default scene, `seconds` into the first animation.
pub fn placed(document: &Document, seconds: f64) -> Result<Vec<Placed>, DocumentError> {
    let locals = locals(document, seconds)?;
    let mut seen = vec![false; locals.len()];
    let mut placed = Vec::new();
    let pile = pile(document).map(|(index, _)| index);
    let mut open: Vec<(usize, DAffine3, bool, Option<usize>)> =
        document.roots().into_iter().rev().map(|r| (r, DAffine3::IDENTITY, false, None)).collect();
    while let Some((index, above, in_pile, body)) = open.pop() {
        let node = document.get("nodes", index)?;
        if std::mem::replace(&mut seen[index], true) {
            continue;
        }
        let world = above * locals[index];
        let in_pile = in_pile || node.get("name").and_then(Value::as_str) == Some(PILE);
        if let Some(mesh) = reference(node, "mesh") {
            let copies = instances(document, node)?.into_iter().map(|copy| world * copy);
            // A scale of 0 hides a node.
            let seen = copies.filter(|world| world.matrix3.determinant() != 0.0);
            placed.extend(seen.map(|world| Placed { mesh, world, in_pile, body }));
        }
        let children = references(node, "children").into_iter().enumerate().rev();
        let body_of = |k: usize| body.or((pile == Some(index)).then_some(k));
        open.extend(children.map(|(k, c)| (c, world, in_pile, body_of(k))));
    }
    Ok(placed)
}

/// Where a node shows its mesh, relative to itself.
fn instances(document: &Document, node: &Map<String, Value>) -> Result<Vec<DAffine3>, DocumentError> {
    let attributes = node.get("extensions").and_then(|e| e.get(INSTANCING)).and_then(|i| i.get("attributes"));
    let Some(attributes) = attributes.and_then(Value::as_object) else { return Ok(vec![DAffine3::IDENTITY]) };
    let read = |key: &str| reference(attributes, key);
    let translations = read("TRANSLATION").map(|i| accessor::vectors::<3>(document, i)).transpose()?;
    let rotations = read("ROTATION").map(|i| accessor::vectors::<4>(document, i)).transpose()?;
    let scales = read("SCALE").map(|i| accessor::vectors::<3>(document, i)).transpose()?;
    let lengths =
        [translations.as_ref().map(Vec::len), rotations.as_ref().map(Vec::len), scales.as_ref().map(Vec::len)];
    let count = lengths.into_iter().flatten().min().unwrap_or(0);
    let copy = |i: usize| Local {
        translation: translations.as_ref().map_or(DVec3::ZERO, |t| t[i].into()),
        rotation: rotations.as_ref().map_or(DQuat::IDENTITY, |r| unit(DQuat::from_array(r[i]))),
        scale: scales.as_ref().map_or(DVec3::ONE, |s| s[i].into()),
    };
    Ok((0..count).map(|i| copy(i).affine()).collect())
}

/// Frames per second and number of frames, where the file's node `pile` tells them.
pub fn frame_clock(document: &Document) -> Option<(f64, u64)> {
    let extras = pile(document)?.1.get("extras")?;
    let fps = extras.get("fps")?.as_f64().filter(|fps| *fps > 0.0)?;
    Some((fps, extras.get("frames")?.as_u64()?))
}

/// The node that holds the bodies, and its index.
pub fn pile(document: &Document) -> Option<(usize, &Map<String, Value>)> {
    let nodes = document.array("nodes").iter().filter_map(Value::as_object).enumerate();
    nodes.into_iter().find(|(_, node)| node.get("name").and_then(Value::as_str) == Some(PILE))
}

/// Where the bodies' nodes stand, `seconds` into the first animation.
pub fn bodies(document: &Document, seconds: f64) -> Result<Vec<DAffine3>, DocumentError> {
    let Some((index, pile)) = pile(document) else { return Ok(Vec::new()) };
    let locals = locals(document, seconds)?;
    let world = |body: usize| locals.get(body).map(|local| locals[index] * *local);
    Ok(references(pile, "children").into_iter().filter_map(world).collect())
}

fn locals(document: &Document, seconds: f64) -> Result<Vec<DAffine3>, DocumentError> {
    let count = document.array("nodes").len();
    let mut parts = Vec::with_capacity(count);
    let mut matrices = Vec::with_capacity(count);
    for index in 0..count {
        let node = document.get("nodes", index)?;
        let array = |key: &str| -> Option<Vec<f64>> {
            let items = node.get(key)?.as_array()?;
            items.iter().map(|v| v.as_f64().filter(|v| v.is_finite())).collect()
        };
        let vector = |key: &str| array(key).and_then(|v| <[f64; 3]>::try_from(v).ok()).map(DVec3::from);
        let rotation = array("rotation").and_then(|v| <[f64; 4]>::try_from(v).ok()).map(DQuat::from_array);
        matrices.push(array("matrix").and_then(|v| <[f64; 16]>::try_from(v).ok()));
        parts.push(Local {
            translation: vector("translation").unwrap_or(DVec3::ZERO),
            rotation: rotation.map_or(DQuat::IDENTITY, unit),
            scale: vector("scale").unwrap_or(DVec3::ONE),
        });
    }
    animation::apply(document, seconds, &mut parts)?;
    let pose = |(matrix, local): (Option<[f64; 16]>, Local)| match matrix {
        Some(matrix) => DAffine3::from_mat4(DMat4::from_cols_array(&matrix)),
        None => local.affine(),
    };
    Ok(matrices.into_iter().zip(parts).map(pose).collect())
}
