//! The glTF files of a pack. Materials are the same in all of them; textures are files beside them.

use super::surface::{Surface, Surfaces, Vertex};
use super::{PackError, PackedFile};
use crate::copy::{Copier, GlbOutput};
use crate::glb::container;
use cairn_gltf::document::{Object, reference};
use meshoptimizer_rs::Workspace;
use meshoptimizer_rs::codec::{IndexEncoding, VertexEncoding, encode_index_buffer, encode_vertex_buffer};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// The version of the vertex stream that the extension has.
const STREAM_VERSION: u8 = 0;
/// The compression of buffer views, and the buffer that a reader without it would look for.
const MESHOPT: &str = cairn_gltf::MESHOPT[0];
const ARRAY_BUFFER: u32 = 34962;
const INDEX_BUFFER: u32 = 34963;
const TEXTURES: &str = "textures";

/// What all files of a pack share.
pub struct Looks {
    /// The arrays that materials lead to.
    arrays: Object,
    /// The new indices of materials.
    materials: BTreeMap<usize, usize>,
    pub textures: Vec<PackedFile>,
    /// Images that were not found, and the like.
    pub left_out: Vec<String>,
}

impl Looks {
    /// No materials.
    pub fn bare() -> Looks {
        let (materials, textures, left_out) = (BTreeMap::new(), Vec::new(), Vec::new());
        Looks { arrays: Object::new(), materials, textures, left_out }
    }

    /// Copies these materials.
    pub fn copy(source: &mut Copier, materials: impl Iterator<Item = usize>) -> Looks {
        let mut out = GlbOutput::default();
        let (mut copied, mut left_out) = (BTreeMap::new(), Vec::new());
        for material in materials {
            match source.material(material, &mut out) {
                Ok(new) => drop(copied.insert(material, new)),
                Err(error) => left_out.push(format!("material {material} is left out: {error}")),
            }
        }
        if out.left_out.has_images() {
            left_out.push("some images of the props were not found and are left out".into());
        }
        let (mut arrays, bin) = out.into_json();
        let views = arrays.remove("bufferViews").unwrap_or_default();
        let mut textures = Vec::new();
        for (number, image) in arrays.get_mut("images").and_then(Value::as_array_mut).into_iter().flatten().enumerate()
        {
            let Some(image) = image.as_object_mut() else { continue };
            let view = reference(image, "bufferView").and_then(|view| views.get(view)?.as_object());
            let range = view.and_then(|view| Some((reference(view, "byteOffset")?, reference(view, "byteLength")?)));
            let Some(bytes) = range.and_then(|(start, length)| bin.get(start..start + length)) else { continue };
            let kind = image.get("mimeType").and_then(Value::as_str).and_then(|media| media.strip_prefix("image/"));
            let extension = match kind {
                Some("jpeg") => "jpg",
                Some(kind) if kind.chars().all(|c| c.is_ascii_alphanumeric()) => kind,
                _ => "png",
            };
            let name = format!("{TEXTURES}/{number}.{extension}");
            textures.push(PackedFile::new(&name, "texture", bytes.to_vec()));
            image.remove("bufferView");
            image.insert("uri".into(), json!(name));
        }
        Looks { arrays, materials: copied, textures, left_out }
    }
}

/// Adds attributes of vertices to those of their primitive.
pub type AddAttributes<'a, 'f> = dyn FnMut(&mut GltfFile<'a>, &[Vertex], &mut Object) -> Result<(), PackError> + 'f;

/// A file while it grows.
pub struct GltfFile<'a> {
    pub out: GlbOutput,
    looks: &'a Looks,
    /// Compresses what a mesh has.
    is_compressed: bool,
    /// Bytes of all views that are compressed, as they come out.
    plain: usize,
    required: BTreeSet<&'static str>,
}

impl<'a> GltfFile<'a> {
    pub fn new(looks: &'a Looks, is_compressed: bool) -> GltfFile<'a> {
        GltfFile { out: GlbOutput::default(), looks, is_compressed, plain: 0, required: BTreeSet::new() }
    }

    pub fn requires(&mut self, extension: &'static str) {
        self.out.uses(extension);
        self.required.insert(extension);
    }

    /// Bytes of so many elements of a mesh, as a view.
    fn view(&mut self, bytes: &[u8], count: usize, target: u32) -> Result<usize, PackError> {
        let stride = bytes.len() / count.max(1);
        let is_index = target == INDEX_BUFFER;
        let mut view = Object::from_iter([("target".to_owned(), json!(target))]);
        if !self.is_compressed || count == 0 {
            return Ok(self.out.push_view(bytes, view));
        }
        let mut workspace = Workspace::default();
        let (stream, mode) = if is_index {
            let corners: Vec<u32> = bytes.as_chunks().0.iter().map(|c| u32::from_le_bytes(*c)).collect();
            (encode_index_buffer(&corners, IndexEncoding::DEFAULT, &mut workspace)?, "TRIANGLES")
        } else {
            view.insert("byteStride".into(), json!(stride));
            let encoding = VertexEncoding::new(STREAM_VERSION, 0)?;
            (encode_vertex_buffer(bytes, count, stride, encoding, &mut workspace)?, "ATTRIBUTES")
        };
        let stored = self.out.push_view(&stream, Object::new());
        let offset = self.out.bin.len() - stream.len();
        let extension = json!({
            "buffer": 0, "byteOffset": offset, "byteLength": stream.len(), "byteStride": stride, "count": count,
            "mode": mode,
        });
        view.insert("buffer".into(), json!(1));
        view.insert("byteOffset".into(), json!(self.plain));
        view.insert("byteLength".into(), json!(bytes.len()));
        view.insert("extensions".into(), json!({ MESHOPT: extension }));
        self.plain = (self.plain + bytes.len()).next_multiple_of(4);
        self.out.set("bufferViews", stored, view);
        self.requires(MESHOPT);
        Ok(stored)
    }

    /// An accessor of vectors of floats.
    pub fn floats<const N: usize>(&mut self, values: &[[f32; N]], bounded: bool) -> Result<usize, PackError> {
        let bytes: Vec<u8> = values.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
        let kind = if N == 1 { "SCALAR".to_owned() } else { format!("VEC{N}") };
        let view = self.view(&bytes, values.len(), ARRAY_BUFFER)?;
        let mut accessor = json!({ "bufferView": view, "componentType": 5126, "type": kind, "count": values.len() });
        if bounded {
            let outer = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
                (0..N).map(|axis| values.iter().map(|v| v[axis]).reduce(pick).unwrap_or_default()).collect()
            };
            accessor["min"] = json!(outer(f32::min));
            accessor["max"] = json!(outer(f32::max));
        }
        Ok(self.out.push("accessors", accessor))
    }

    /// An accessor of the only joint of each vertex, its body.
    pub fn joints(&mut self, vertices: &[Vertex]) -> Result<usize, PackError> {
        let joints = |vertex: &Vertex| [vertex.body as u16, 0, 0, 0];
        let bytes: Vec<u8> = vertices.iter().flat_map(joints).flat_map(u16::to_le_bytes).collect();
        let view = self.view(&bytes, vertices.len(), ARRAY_BUFFER)?;
        let accessor = json!({ "bufferView": view, "componentType": 5123, "type": "VEC4", "count": vertices.len() });
        Ok(self.out.push("accessors", accessor))
    }

    /// The mesh of some surfaces: a primitive for each material. `more` adds attributes.
    pub fn mesh(
        &mut self,
        name: &str,
        surfaces: &Surfaces,
        more: &mut AddAttributes<'a, '_>,
    ) -> Result<usize, PackError> {
        let mut primitives = Vec::new();
        for (material, surface) in &surfaces.0 {
            let Surface { vertices, triangles, .. } = surface;
            let positions: Vec<[f32; 3]> = vertices.iter().map(|v| v.position).collect();
            let normals: Vec<[f32; 3]> = vertices.iter().map(|v| v.normal).collect();
            let mut attributes = Object::new();
            attributes.insert("POSITION".into(), json!(self.floats(&positions, true)?));
            attributes.insert("NORMAL".into(), json!(self.floats(&normals, false)?));
            if surface.has_coordinates {
                let coordinates: Vec<[f32; 2]> = vertices.iter().map(|v| v.coordinates).collect();
                attributes.insert("TEXCOORD_0".into(), json!(self.floats(&coordinates, false)?));
            }
            if surface.has_colors {
                let colors: Vec<[f32; 4]> = vertices.iter().map(|v| v.color).collect();
                attributes.insert("COLOR_0".into(), json!(self.floats(&colors, false)?));
            }
            more(self, vertices, &mut attributes)?;
            let bytes: Vec<u8> = triangles.as_flattened().iter().flat_map(|corner| corner.to_le_bytes()).collect();
            let count = 3 * triangles.len();
            let view = self.view(&bytes, count, INDEX_BUFFER)?;
            let indices = json!({ "bufferView": view, "componentType": 5125, "type": "SCALAR", "count": count });
            let mut primitive = json!({ "attributes": attributes, "indices": self.out.push("accessors", indices) });
            if let Some(material) = material.and_then(|material| self.looks.materials.get(&material)) {
                primitive["material"] = json!(material);
            }
            primitives.push(primitive);
        }
        Ok(self.out.push("meshes", json!({ "name": name, "primitives": primitives })))
    }

    /// The bytes of the file, with these nodes at the top.
    pub fn finish(self, tops: &[usize]) -> Result<Vec<u8>, PackError> {
        let (mut json, bin) = self.out.into_json();
        for (key, value) in &self.looks.arrays {
            match (json.get_mut(key), value) {
                (Some(Value::Array(there)), Value::Array(more)) => {
                    there.extend(more.iter().filter(|one| !there.contains(one)).cloned().collect::<Vec<_>>());
                }
                _ => drop(json.insert(key.clone(), value.clone())),
            }
        }
        if !self.required.is_empty() {
            let required = json.entry("extensionsRequired").or_insert_with(|| json!([]));
            required.as_array_mut().into_iter().for_each(|all| all.extend(self.required.iter().map(|&one| json!(one))));
        }
        let generator = concat!("cairn ", env!("CARGO_PKG_VERSION"));
        json.insert("asset".into(), json!({ "version": "2.0", "generator": generator }));
        json.insert("scene".into(), json!(0));
        json.insert("scenes".into(), json!([{ "nodes": tops }]));
        let mut buffers = vec![json!({ "byteLength": bin.len() })];
        if self.plain > 0 {
            buffers.push(json!({ "byteLength": self.plain, "extensions": { MESHOPT: { "fallback": true } } }));
        }
        json.insert("buffers".into(), json!(buffers));
        Ok(container(&serde_json::to_vec(&json).map_err(std::io::Error::from)?, &bin)?)
    }
}
