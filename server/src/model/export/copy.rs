//! Copies meshes, and all that they refer to, from source files into one new file.
//!
//! Vertex attributes, morph targets, materials, textures, samplers and extras stay as they came; only indices change.
//! Left out, because their targets are not copied: skin weights, and extensions that are not known to be safe to
//! move. All binary data ends in one buffer, a buffer view at a time. Images in data URIs and in files that can be
//! reached are embedded too; an image that cannot be reached keeps its URI.

use super::images;
use cairn_gltf::document::{DocumentError, Object, reference};
use cairn_gltf::{DRACO, Document, Resolver};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// Extensions that change how data is read although no object of theirs stands in the file.
const SILENT_EXTENSIONS: [&str; 1] = ["KHR_mesh_quantization"];
/// Extensions of materials and textures that point at a list which is not copied.
const DROPPED_EXTENSIONS: [&str; 1] = ["KHR_xmp_json_ld"];

/// The new file while it grows.
#[derive(Default)]
pub struct GlbOutput {
    /// The top-level arrays by name.
    arrays: BTreeMap<&'static str, Vec<Value>>,
    /// The one buffer.
    pub bin: Vec<u8>,
    used: BTreeSet<String>,
    required: BTreeSet<String>,
}

impl GlbOutput {
    /// Appends to a top-level array and gives the new entry's index.
    pub fn push(&mut self, kind: &'static str, value: impl Into<Value>) -> usize {
        let array = self.arrays.entry(kind).or_default();
        array.push(value.into());
        array.len() - 1
    }

    /// Appends bytes, aligned for any component type, as a buffer view; `view` may hold further members.
    pub fn push_view(&mut self, bytes: &[u8], mut view: Object) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        view.insert("buffer".into(), json!(0));
        view.insert("byteOffset".into(), json!(self.bin.len()));
        view.insert("byteLength".into(), json!(bytes.len()));
        self.bin.extend_from_slice(bytes);
        self.push("bufferViews", view)
    }

    /// The JSON without `asset`, `scene` and `buffers`.
    pub fn into_json(self) -> (Object, Vec<u8>) {
        let mut json = Object::new();
        for (key, names) in [("extensionsUsed", &self.used), ("extensionsRequired", &self.required)] {
            if !names.is_empty() {
                json.insert(key.into(), names.iter().cloned().collect());
            }
        }
        json.extend(self.arrays.into_iter().map(|(kind, entries)| (kind.into(), Value::Array(entries))));
        (json, self.bin)
    }
}

/// A source file that is being copied. It records the new index of each copied entry, so that nothing is copied twice.
pub struct Copier<'a> {
    pub document: Document<'a>,
    pub resolve: &'a Resolver<'a>,
    copied: BTreeMap<(&'static str, usize), usize>,
}

impl<'a> Copier<'a> {
    pub fn new(document: Document<'a>, resolve: &'a Resolver<'a>) -> Self {
        Copier { document, resolve, copied: BTreeMap::new() }
    }

    /// Copies a mesh and gives its new index.
    pub fn mesh(&mut self, index: usize, out: &mut GlbOutput) -> Result<usize, DocumentError> {
        self.once("meshes", index, out, |source, mesh, out| {
            mesh.remove("extensions");
            let Some(Value::Array(primitives)) = mesh.get_mut("primitives") else {
                return Err(DocumentError::malformed("meshes", index, "no primitives"));
            };
            for primitive in primitives {
                let primitive = primitive
                    .as_object_mut()
                    .ok_or_else(|| DocumentError::malformed("meshes", index, "a primitive is no object"))?;
                source.primitive(index, primitive, out)?;
            }
            Ok(())
        })
    }

    /// Gives the accessors of an object such as `attributes` their new indices.
    pub fn accessors(&mut self, map: &mut Object, out: &mut GlbOutput) -> Result<(), DocumentError> {
        for (name, value) in map {
            if let Some(old) = value.as_u64() {
                *value = json!(self.accessor(to_index(old), name == "POSITION", out)?);
            }
        }
        Ok(())
    }

    /// Records that an extension is used, and required if the source requires it.
    pub fn use_extension(&self, name: &str, out: &mut GlbOutput) {
        out.used.insert(name.into());
        if self.lists("extensionsRequired", name) {
            out.required.insert(name.into());
        }
    }

    fn lists(&self, key: &str, name: &str) -> bool {
        let names = self.document.json().get(key).and_then(Value::as_array);
        names.is_some_and(|names| names.iter().any(|n| n.as_str() == Some(name)))
    }

    /// Copies an entry of a top-level array, unless that was done before; `fill` adapts the copy.
    fn once(
        &mut self,
        kind: &'static str,
        index: usize,
        out: &mut GlbOutput,
        fill: impl FnOnce(&mut Self, &mut Object, &mut GlbOutput) -> Result<(), DocumentError>,
    ) -> Result<usize, DocumentError> {
        if let Some(&new) = self.copied.get(&(kind, index)) {
            return Ok(new);
        }
        let mut entry = self.document.get(kind, index)?.clone();
        fill(self, &mut entry, out)?;
        let new = out.push(kind, entry);
        self.copied.insert((kind, index), new);
        Ok(new)
    }

    fn primitive(&mut self, mesh: usize, primitive: &mut Object, out: &mut GlbOutput) -> Result<(), DocumentError> {
        let Some(Value::Object(attributes)) = primitive.get_mut("attributes") else {
            return Err(DocumentError::malformed("meshes", mesh, "a primitive has no attributes"));
        };
        attributes.retain(|name, _| !name.starts_with("JOINTS_") && !name.starts_with("WEIGHTS_"));
        self.accessors(attributes, out)?;
        if let Some(Value::Array(targets)) = primitive.get_mut("targets") {
            for target in targets.iter_mut().filter_map(Value::as_object_mut) {
                self.accessors(target, out)?;
            }
        }
        if let Some(indices) = reference(primitive, "indices") {
            primitive.insert("indices".into(), json!(self.accessor(indices, false, out)?));
        }
        if let Some(material) = reference(primitive, "material") {
            primitive.insert("material".into(), json!(self.material(material, out)?));
        }
        let extensions = primitive.remove("extensions");
        if extensions.is_some_and(|extensions| extensions.get(DRACO).is_some()) {
            return Err(DocumentError::malformed("meshes", mesh, "a primitive's compressed data cannot be decoded"));
        }
        for name in SILENT_EXTENSIONS {
            if self.lists("extensionsUsed", name) {
                self.use_extension(name, out);
            }
        }
        Ok(())
    }

    /// Bounds are computed from the data: files state wrong ones. Only those of positions are required.
    fn accessor(&mut self, index: usize, bounded: bool, out: &mut GlbOutput) -> Result<usize, DocumentError> {
        self.once("accessors", index, out, |source, accessor, out| {
            accessor.remove("extensions");
            let stated = ["min", "max"].map(|key| accessor.remove(key).is_some());
            let is_vec3 = accessor.get("type").and_then(Value::as_str) == Some("VEC3");
            if is_vec3
                && (bounded || stated[0])
                && let Ok(Some([low, high])) = source.document.bounds::<3>(index)
            {
                accessor.insert("min".into(), json!(low));
                accessor.insert("max".into(), json!(high));
            }
            source.move_view(accessor, out)?;
            if let Some(Value::Object(sparse)) = accessor.get_mut("sparse") {
                for part in ["indices", "values"] {
                    if let Some(Value::Object(part)) = sparse.get_mut(part) {
                        source.move_view(part, out)?;
                    }
                }
            }
            Ok(())
        })
    }

    /// Replaces the member `bufferView`.
    fn move_view(&mut self, object: &mut Object, out: &mut GlbOutput) -> Result<(), DocumentError> {
        if let Some(view) = reference(object, "bufferView") {
            object.insert("bufferView".into(), json!(self.view(view, out)?));
        }
        Ok(())
    }

    fn view(&mut self, index: usize, out: &mut GlbOutput) -> Result<usize, DocumentError> {
        if let Some(&new) = self.copied.get(&("bufferViews", index)) {
            return Ok(new);
        }
        let mut view = self.document.get("bufferViews", index)?.clone();
        view.remove("extensions");
        let new = out.push_view(self.document.view(index)?, view);
        self.copied.insert(("bufferViews", index), new);
        Ok(new)
    }

    fn material(&mut self, index: usize, out: &mut GlbOutput) -> Result<usize, DocumentError> {
        self.once("materials", index, out, |source, material, out| source.textures_below(material, out))
    }

    /// Gives every texture below a material its new index: in glTF and in all its extensions, an object with a number
    /// `index` refers to a texture.
    fn textures_below(&mut self, object: &mut Object, out: &mut GlbOutput) -> Result<(), DocumentError> {
        if let Some(Value::Object(extensions)) = object.get_mut("extensions") {
            extensions.retain(|name, _| !DROPPED_EXTENSIONS.contains(&name.as_str()));
            for name in extensions.keys() {
                self.use_extension(name, out);
            }
        }
        if let Some(texture) = reference(object, "index") {
            object.insert("index".into(), json!(self.texture(texture, out)?));
        }
        for (_, value) in object.iter_mut().filter(|(key, _)| *key != "extras") {
            if let Value::Object(inner) = value {
                self.textures_below(inner, out)?;
            }
        }
        Ok(())
    }

    fn texture(&mut self, index: usize, out: &mut GlbOutput) -> Result<usize, DocumentError> {
        self.once("textures", index, out, |source, texture, out| {
            if let Some(sampler) = reference(texture, "sampler") {
                let copied = source.once("samplers", sampler, out, |_, sampler, _| {
                    sampler.remove("extensions");
                    Ok(())
                })?;
                texture.insert("sampler".into(), json!(copied));
            }
            source.move_image(texture, out)?;
            if let Some(Value::Object(extensions)) = texture.get_mut("extensions") {
                // Only the extensions that offer the image in another format (KTX2, WebP, AVIF, DDS).
                extensions.retain(|_, value| value.get("source").is_some_and(Value::is_u64));
                for (name, value) in extensions.iter_mut() {
                    source.use_extension(name, out);
                    if let Value::Object(value) = value {
                        source.move_image(value, out)?;
                    }
                }
                if extensions.is_empty() {
                    texture.remove("extensions");
                }
            }
            Ok(())
        })
    }

    /// Replaces the member `source`.
    fn move_image(&mut self, object: &mut Object, out: &mut GlbOutput) -> Result<(), DocumentError> {
        let Some(index) = reference(object, "source") else { return Ok(()) };
        let new = self.once("images", index, out, |source, image, out| {
            image.remove("extensions");
            if let Some(view) = reference(image, "bufferView") {
                // Some exporters write types that viewers refuse, such as `image/jpg`.
                if let Some(media) = images::media_type(source.document.view(view)?) {
                    image.insert("mimeType".into(), json!(media));
                }
                return source.move_view(image, out);
            }
            if let Some((media, bytes)) = images::external(image, source.resolve) {
                let view = out.push_view(&bytes, Object::new());
                image.remove("uri");
                image.insert("bufferView".into(), json!(view));
                image.insert("mimeType".into(), json!(media));
            }
            Ok(())
        })?;
        object.insert("source".into(), json!(new));
        Ok(())
    }
}

/// An index of any size. One that does not fit `usize` becomes an index that no list has.
fn to_index(value: u64) -> usize {
    usize::try_from(value).unwrap_or(usize::MAX)
}
