//! The bodies of an earlier result where they lie in the end, as a file in which nothing moves.

use cairn_gltf::Document;
use cairn_gltf::document::{DocumentError, LocalTransform, references};
use cairn_render::{animation, nodes};
use serde_json::{Value, json};
use std::collections::BTreeSet;

/// The node of the bodies.
pub const PILE: &str = nodes::PILE;

/// The reason for which a file cannot be used as an earlier result.
#[derive(Debug, thiserror::Error)]
pub enum NoResult {
    #[error("it is no result of a bake: it has no node \"{PILE}\"")]
    NoPile,
    #[error("it is not a .glb")]
    NoGlb,
    #[error(transparent)]
    Document(#[from] DocumentError),
}

/// Length of the header of a `.glb`, and of that of a chunk.
const HEADER: usize = 12;
const CHUNK: usize = 8;

/// A `.glb` of the same meshes, with every body's pose in the last frame as its own, and without animations. Bodies
/// that never appear are left out.
pub fn run(bytes: &[u8]) -> Result<Vec<u8>, NoResult> {
    let document = Document::parse(bytes, &|_: &str| Err("a result holds its data itself".into()))?;
    let rest = bytes.strip_prefix(b"glTF").and(bytes.get(HEADER..HEADER + CHUNK)).ok_or(NoResult::NoGlb)?;
    let json_length = u32::from_le_bytes([rest[0], rest[1], rest[2], rest[3]]) as usize;
    let (index, pile) = nodes::pile(&document).ok_or(NoResult::NoPile)?;
    let bodies = references(pile, "children");
    let count = document.array("nodes").len();
    let mut locals = Vec::with_capacity(count);
    for index in 0..count {
        locals.push(LocalTransform::of(document.get("nodes", index)?));
    }
    animation::apply(&document, animation::duration(&document)?, &mut locals)?;

    let mut json = document.json().clone();
    json.remove("animations");
    let mut gone = BTreeSet::new();
    for &body in &bodies {
        let Some(local) = locals.get(body) else { continue };
        if local.scale == glam::DVec3::ZERO {
            gone.insert(body);
        }
        if let Some(node) = json.get_mut("nodes").and_then(|nodes| nodes.get_mut(body)).and_then(Value::as_object_mut) {
            node.insert("translation".into(), json!(local.translation.to_array()));
            node.insert("rotation".into(), json!(local.rotation.to_array()));
            node.insert("scale".into(), json!(local.scale.to_array()));
        }
    }
    if let Some(pile) = json.get_mut("nodes").and_then(|nodes| nodes.get_mut(index)) {
        pile["children"] = bodies.iter().filter(|body| !gone.contains(body)).copied().collect();
    }
    let mut text = serde_json::to_vec(&json).map_err(DocumentError::from)?;
    text.resize(text.len().next_multiple_of(4), b' ');
    // Chunks behind the first one stay as they are.
    let others = bytes.get(HEADER + CHUNK + json_length..).unwrap_or_default();
    let word = |n: usize| u32::try_from(n).unwrap_or(u32::MAX).to_le_bytes();
    let mut glb = Vec::with_capacity(HEADER + CHUNK + text.len() + others.len());
    glb.extend_from_slice(&bytes[..8]);
    glb.extend_from_slice(&word(HEADER + CHUNK + text.len() + others.len()));
    glb.extend_from_slice(&word(text.len()));
    glb.extend_from_slice(&rest[4..8]);
    glb.extend_from_slice(&text);
    glb.extend_from_slice(others);
    Ok(glb)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_result_that_keeps_its_data_elsewhere_is_refused() {
        let mut json = json!({
            "asset": { "version": "2.0" },
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "name": PILE, "children": [1] }, { "name": "stick" }],
            "buffers": [{ "byteLength": 16, "uri": "elsewhere.bin" }],
            "bufferViews": [{ "buffer": 0, "byteLength": 16 }],
            "accessors": [
                { "bufferView": 0, "componentType": 5126, "count": 1, "type": "SCALAR", "min": [0.0], "max": [0.0] },
                { "bufferView": 0, "byteOffset": 4, "componentType": 5126, "count": 1, "type": "VEC3" },
            ],
            "animations": [{
                "channels": [{ "sampler": 0, "target": { "node": 1, "path": "translation" } }],
                "samplers": [{ "input": 0, "output": 1 }],
            }],
        })
        .to_string()
        .into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let length = |bytes: usize| u32::try_from(bytes).unwrap().to_le_bytes();
        let mut glb = b"glTF".to_vec();
        glb.extend([2u32.to_le_bytes(), length(HEADER + CHUNK + json.len()), length(json.len())].concat());
        glb.extend(b"JSON");
        glb.extend(json);
        let error = run(&glb).unwrap_err().to_string();
        assert!(error.contains("a result holds its data itself"), "{error}");
    }
}
