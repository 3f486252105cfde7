//! Meshes of collision shapes.

use super::GlbFile;
use cairn_core::report::bake::BakedSolid;
use cairn_geometry::mesh::TriMesh;
use cairn_gltf::document::Object;
use serde_json::json;

/// What a buffer view is for, as glTF names it.
const ARRAY_BUFFER: u32 = 34962;
const INDEX_BUFFER: u32 = 34963;

impl GlbFile<'_> {
    /// The convex parts of a prop's collision shape, as meshes about the point that its bodies' nodes place.
    pub fn hulls(&mut self, name: &str, solid: &BakedSolid) -> Vec<usize> {
        let offset = solid.center - solid.pivot;
        let mut mesh = |(number, mut mesh): (usize, TriMesh)| {
            mesh.points.iter_mut().for_each(|point| *point += offset);
            self.mesh(&format!("{name}.{number}"), &mesh)
        };
        solid.solid.meshes().into_iter().enumerate().map(&mut mesh).collect()
    }

    /// Adds a mesh of triangles and gives its index.
    pub fn mesh(&mut self, name: &str, mesh: &TriMesh) -> usize {
        let points: Vec<[f32; 3]> = mesh.points.iter().map(|point| point.as_vec3().to_array()).collect();
        let outer = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
            let along = |axis: usize| points.iter().map(|point| point[axis]).reduce(pick).unwrap_or_default();
            (0..3).map(along).collect()
        };
        let bytes: Vec<u8> = points.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.out.push_view(&bytes, Object::from_iter([("target".to_owned(), json!(ARRAY_BUFFER))]));
        let positions = json!({
            "bufferView": view, "componentType": 5126, "type": "VEC3", "count": points.len(),
            "min": outer(f32::min), "max": outer(f32::max),
        });
        let positions = self.out.push("accessors", positions);
        let bytes: Vec<u8> = mesh.triangles.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.out.push_view(&bytes, Object::from_iter([("target".to_owned(), json!(INDEX_BUFFER))]));
        let indices = json!({
            "bufferView": view, "componentType": 5125, "type": "SCALAR", "count": 3 * mesh.triangles.len(),
        });
        let indices = self.out.push("accessors", indices);
        let primitive = json!({ "attributes": { "POSITION": positions }, "indices": indices });
        self.out.push("meshes", json!({ "name": name, "primitives": [primitive] }))
    }
}
