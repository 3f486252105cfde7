//! World transforms of a file's nodes at a moment of its animation.

use super::animation;
use cairn_gltf::Document;
use cairn_gltf::document::{self, DocumentError, LocalTransform, Object, reference, references};
use glam::{DAffine3, DMat4};
use serde_json::Value;
use std::collections::BTreeSet;

/// The name of the node that holds the bodies.
pub const PILE: &str = "pile";

/// A mesh somewhere in the world.
#[derive(Clone, Copy)]
pub struct PlacedMesh {
    pub mesh: usize,
    pub world: DAffine3,
    /// Below the node `pile`.
    pub in_pile: bool,
    /// Its index among the children of that node.
    pub body: Option<usize>,
}

/// Every mesh of the default scene, `seconds` into the first animation.
pub fn placed(document: &Document, seconds: f64) -> Result<Vec<PlacedMesh>, DocumentError> {
    let locals = locals(document, seconds)?;
    let roots = document.roots().into_iter().rev().map(|r| (r, DAffine3::IDENTITY, false, None)).collect();
    let mut placed = walk(document, |node| locals[node], roots)?;
    // A scale of 0 hides a node.
    placed.retain(|one| one.world.matrix3.determinant() != 0.0);
    Ok(placed)
}

/// Every mesh of a node and of those below it, in the node's own frame.
pub fn below(document: &Document, node: usize, locals: &[DAffine3]) -> Result<Vec<PlacedMesh>, DocumentError> {
    // Its own transform may have no inverse, so it is not taken in at all.
    let local = |at: usize| if at == node { DAffine3::IDENTITY } else { locals[at] };
    walk(document, local, vec![(node, DAffine3::IDENTITY, true, None)])
}

/// From these nodes, the last one first: with the transform above each, whether it is in the pile, and its body.
fn walk(
    document: &Document,
    local: impl Fn(usize) -> DAffine3,
    mut open: Vec<(usize, DAffine3, bool, Option<usize>)>,
) -> Result<Vec<PlacedMesh>, DocumentError> {
    let mut seen = BTreeSet::new();
    let mut placed = Vec::new();
    let pile = pile(document).map(|(index, _)| index);
    while let Some((index, above, in_pile, body)) = open.pop() {
        let node = document.get("nodes", index)?;
        if !seen.insert(index) || document::is_hidden(node) {
            continue;
        }
        let world = above * local(index);
        let in_pile = in_pile || node.get("name").and_then(Value::as_str) == Some(PILE);
        if let Some(mesh) = reference(node, "mesh") {
            let copies = match document.instances(node)? {
                Some(copies) => copies.into_iter().map(|copy| world * copy.affine()).collect(),
                None => vec![world],
            };
            placed.extend(copies.into_iter().map(|world| PlacedMesh { mesh, world, in_pile, body }));
        }
        let children = references(node, "children").into_iter().enumerate().rev();
        let body_of = |k: usize| body.or((pile == Some(index)).then_some(k));
        open.extend(children.map(|(k, c)| (c, world, in_pile, body_of(k))));
    }
    Ok(placed)
}

/// Frames per second and number of frames, if the file's node `pile` states them.
pub fn frame_clock(document: &Document) -> Option<(f64, u64)> {
    let extras = pile(document)?.1.get("extras")?;
    let fps = extras.get("fps")?.as_f64().filter(|fps| *fps > 0.0)?;
    Some((fps, extras.get("frames")?.as_u64()?))
}

/// The node that holds the bodies, and its index.
pub fn pile<'a>(document: &'a Document) -> Option<(usize, &'a Object)> {
    let nodes = document.array("nodes").iter().filter_map(Value::as_object).enumerate();
    nodes.into_iter().find(|(_, node)| node.get("name").and_then(Value::as_str) == Some(PILE))
}

/// World transforms of the bodies' nodes, `seconds` into the first animation.
pub fn bodies(document: &Document, seconds: f64) -> Result<Vec<DAffine3>, DocumentError> {
    let Some((index, pile)) = pile(document) else { return Ok(Vec::new()) };
    let locals = locals(document, seconds)?;
    let world = |body: usize| locals.get(body).map(|local| locals[index] * *local);
    Ok(references(pile, "children").into_iter().filter_map(world).collect())
}

/// Each node's transform in its parent's frame, `seconds` into the first animation.
pub fn locals(document: &Document, seconds: f64) -> Result<Vec<DAffine3>, DocumentError> {
    let count = document.array("nodes").len();
    let mut parts = Vec::with_capacity(count);
    let mut matrices = Vec::with_capacity(count);
    for index in 0..count {
        let node = document.get("nodes", index)?;
        matrices.push(document::matrix(node));
        parts.push(LocalTransform::of(node));
    }
    animation::apply(document, seconds, &mut parts)?;
    let pose = |(matrix, local): (Option<[f64; 16]>, LocalTransform)| match matrix {
        Some(matrix) => DAffine3::from_mat4(DMat4::from_cols_array(&matrix)),
        None => local.affine(),
    };
    Ok(matrices.into_iter().zip(parts).map(pose).collect())
}
