//! Decodes the compressed geometry of a document, so that writers and renderer need no decoder.
//!
//! A stream that cannot be decoded stays as it is: a fault only matters if the geometry is needed, and the reader of
//! scenes has reported it.

use gltf::accessor::DataType;
use serde_json::{Value, json};

use super::{Document, Object, reference};
use crate::compressed::{Attribute, DRACO, DracoMesh, MESHOPT, MOST_BROKEN, Meshopt};
use crate::source::Limits;

/// The amount that may still be decoded.
struct Budget {
    bytes: u64,
    triangles: u64,
    broken: u32,
}

impl Document<'_> {
    /// Replaces every compressed view and primitive by a decoded one.
    pub(super) fn decompress(&mut self) {
        let limits = Limits::default();
        let mut budget = Budget { bytes: limits.bytes, triangles: limits.triangles, broken: 0 };
        for index in 0..self.array("bufferViews").len() {
            if let Some(plain) = meshopt(self, index, &mut budget) {
                let buffer = self.push_buffer(plain);
                if let Some(view) = self.get_mut("bufferViews", index) {
                    view.insert("buffer".into(), json!(buffer));
                    view.remove("byteOffset");
                    remove_extensions(view, &MESHOPT);
                }
            }
        }
        for mesh in 0..self.array("meshes").len() {
            let count = self.array("meshes")[mesh].get("primitives").and_then(Value::as_array).map_or(0, Vec::len);
            for primitive in 0..count {
                if let Some(plain) = draco(self, mesh, primitive, &mut budget) {
                    let primitives = self.get_mut("meshes", mesh).and_then(|mesh| mesh.get_mut("primitives"));
                    if let Some(slot) = primitives.and_then(|list| list.get_mut(primitive)) {
                        *slot = Value::Object(plain);
                    }
                }
            }
        }
    }
}

/// The decoded bytes of a view; `None` if it is not compressed, or has plain bytes of its own.
fn meshopt(document: &Document<'_>, index: usize, budget: &mut Budget) -> Option<Vec<u8>> {
    let view = document.get("bufferViews", index).ok()?;
    let extensions = view.get("extensions")?;
    let (name, compressed) = MESHOPT.iter().find_map(|&name| Some((name, extensions.get(name)?.as_object()?)))?;
    let buffer = document.get("buffers", reference(view, "buffer")?).ok()?;
    let marked = buffer.get("extensions").and_then(|e| e.get(name)).is_some_and(|e| e.get("fallback").is_some());
    if !marked && document.view(index).is_ok() {
        return None;
    }
    let meshopt = Meshopt::read(compressed)?;
    budget.bytes = budget.bytes.checked_sub(meshopt.bytes())?;
    meshopt.decode(document.range("bufferViews", index, compressed).ok()?).ok()
}

/// A primitive with accessors of its decoded data; `None` if it is not compressed.
fn draco(document: &mut Document<'_>, mesh: usize, index: usize, budget: &mut Budget) -> Option<Object> {
    let primitive = document.get("meshes", mesh).ok()?.get("primitives")?.get(index)?.as_object()?;
    let compressed = primitive.get("extensions")?.get(DRACO)?.as_object()?;
    let mut primitive = primitive.clone();
    remove_extensions(&mut primitive, &[DRACO]);
    let old = |name: &str| reference(primitive.get("attributes")?.as_object()?, name);
    let has_data = |accessor: usize| document.get("accessors", accessor).is_ok_and(|a| a.contains_key("bufferView"));
    if old("POSITION").is_some_and(has_data) && reference(&primitive, "indices").is_none_or(has_data) {
        return Some(primitive);
    }
    if budget.broken >= MOST_BROKEN {
        return None;
    }
    let ids = compressed.get("attributes")?.as_object()?.iter();
    let ids: Vec<(String, u64)> = ids.filter_map(|(name, id)| Some((name.clone(), id.as_u64()?))).collect();
    let stream = document.view(reference(compressed, "bufferView")?).ok()?;
    let decoded = DracoMesh::decode(stream, budget.triangles, budget.bytes);
    let decoded = decoded.inspect_err(|_| budget.broken += 1).ok()?;
    budget.bytes = budget.bytes.checked_sub(decoded.bytes())?;

    let mut attributes = primitive.get("attributes")?.as_object()?.clone();
    for (name, id) in ids {
        let template = old(&name).and_then(|at| document.get("accessors", at).ok()).cloned().unwrap_or_default();
        let attribute = decoded.attribute(u32::try_from(id).ok()?)?;
        let accessor = accessor(document, &attribute, decoded.vertices(), &template)?;
        attributes.insert(name, json!(accessor));
    }
    let bytes: Vec<u8> = decoded.corners().flat_map(u32::to_le_bytes).collect();
    let count = bytes.len() / size_of::<u32>();
    let view = view(document, bytes, None);
    let corners = json!({ "bufferView": view, "componentType": 5125, "count": count, "type": "SCALAR" });
    primitive.insert("indices".into(), json!(document.push("accessors", corners)));
    primitive.insert("attributes".into(), Value::Object(attributes));
    primitive.remove("mode"); // the stream holds triangles, whatever they were made from
    Some(primitive)
}

/// Adds the accessor of a decoded attribute, and gives its index. `template` is the accessor that had no data.
fn accessor(document: &mut Document<'_>, attribute: &Attribute, count: usize, template: &Object) -> Option<usize> {
    let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"].get(attribute.components.checked_sub(1)?)?;
    // Vertices begin at multiples of four bytes.
    let width = attribute.components * attribute.component_type.size();
    let padded = width.next_multiple_of(4);
    let mut bytes = Vec::with_capacity(count * padded);
    for value in attribute.bytes.chunks_exact(width) {
        bytes.extend_from_slice(value);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
    }
    let view = view(document, bytes, Some(padded));
    let mut accessor = json!({
        "bufferView": view, "componentType": attribute.component_type, "count": count, "type": kind,
    });
    if let Some(normalized) = template.get("normalized").filter(|_| attribute.component_type != DataType::F32) {
        accessor["normalized"] = normalized.clone();
    }
    Some(document.push("accessors", accessor))
}

fn view(document: &mut Document<'_>, bytes: Vec<u8>, stride: Option<usize>) -> usize {
    let length = bytes.len();
    let buffer = document.push_buffer(bytes);
    let mut view = json!({ "buffer": buffer, "byteLength": length });
    if let Some(stride) = stride {
        view["byteStride"] = json!(stride);
    }
    document.push("bufferViews", view)
}

fn remove_extensions(object: &mut Object, names: &[&str]) {
    if let Some(Value::Object(extensions)) = object.get_mut("extensions") {
        extensions.retain(|name, _| !names.contains(&name.as_str()));
        if extensions.is_empty() {
            object.remove("extensions");
        }
    }
}
