//! Meshes made in code, as files.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use cairn_geometry::mesh::TriMesh;

/// A glTF file with its buffer inside.
pub fn gltf(mesh: &TriMesh) -> String {
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
            { "bufferView": 0, "componentType": 5126, "count": mesh.points.len(), "type": "VEC3", "min": near(lo),
              "max": near(hi) },
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
