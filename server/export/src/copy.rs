//! Copies meshes, and all that they refer to, from source files into one new file.
//!
//! Vertex attributes, morph targets, materials, textures, samplers and extras stay as they came; only indices change.
//! Left out, because their targets are not copied: skin weights, and extensions that are not known to be safe to
//! move. Default weights of morph targets are left out, too: bodies have the base shape. So is what decorates and
//! cannot be read: it must not cost a bake. All binary data ends in one buffer, a buffer view at a time. Images in data
//! URIs and in files that can be reached are embedded too; an image that cannot be reached keeps its URI. The output
//! records all that is left out.

use super::left_out::{LeftOut, MissingImage};
use cairn_gltf::document::{DocumentError, Object, reference};
use cairn_gltf::picture::{PictureFault, uri_of};
use cairn_gltf::{DRACO, Document, MESHOPT, Resolver};
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
    pub left_out: LeftOut,
    /// Bytes that the buffer would have in an output that is not written; it stays empty there.
    pub rehearsed: Option<usize>,
}

impl GlbOutput {
    /// An output that is not written.
    pub fn rehearsal() -> GlbOutput {
        GlbOutput { rehearsed: Some(0), ..GlbOutput::default() }
    }

    /// Appends to a top-level array and gives the new entry's index.
    pub fn push(&mut self, kind: &'static str, value: impl Into<Value>) -> usize {
        let array = self.arrays.entry(kind).or_default();
        array.push(value.into());
        array.len() - 1
    }

    /// Sets an entry of a top-level array whose place was taken before.
    pub fn set(&mut self, kind: &'static str, index: usize, value: impl Into<Value>) {
        if let Some(entry) = self.arrays.get_mut(kind).and_then(|array| array.get_mut(index)) {
            *entry = value.into();
        }
    }

    /// A copy of an entry.
    pub fn entry(&self, kind: &str, index: usize) -> Value {
        self.arrays.get(kind).and_then(|array| array.get(index)).cloned().unwrap_or_default()
    }

    /// Lists an extension among those that the file uses.
    pub fn uses(&mut self, extension: &str) {
        self.used.insert(extension.into());
    }

    /// Appends bytes, aligned for any component type, as a buffer view; `view` may hold further members.
    pub fn push_view(&mut self, bytes: &[u8], mut view: Object) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        view.insert("buffer".into(), json!(0));
        view.insert("byteOffset".into(), json!(self.bin.len()));
        view.insert("byteLength".into(), json!(bytes.len()));
        match &mut self.rehearsed {
            Some(rehearsed) => *rehearsed += bytes.len(),
            None => self.bin.extend_from_slice(bytes),
        }
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
    /// The name of the material that is being copied.
    material: String,
}

impl<'a> Copier<'a> {
    pub fn new(document: Document<'a>, resolve: &'a Resolver<'a>) -> Self {
        Copier { document, resolve, copied: BTreeMap::new(), material: String::new() }
    }

    /// Copies a mesh and gives its new index.
    pub fn mesh(&mut self, index: usize, out: &mut GlbOutput) -> Result<usize, DocumentError> {
        self.once("meshes", index, out, |source, mesh, out| {
            out.left_out.extensions_of(mesh, &[]);
            out.left_out.weights_of(mesh);
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
        let position = reference(attributes, "POSITION");
        for name in attributes.keys().filter(|name| *name != "POSITION").cloned().collect::<Vec<_>>() {
            let copied = match reference(attributes, &name) {
                Some(accessor) => self.attribute(accessor, position, out),
                None => Err(DocumentError::malformed("meshes", mesh, "the number of an accessor is none")),
            };
            match copied {
                Ok(new) => drop(attributes.insert(name, json!(new))),
                Err(error) => {
                    attributes.remove(&name);
                    out.left_out.broken(format!("{name} of mesh {mesh}"), &error);
                }
            }
        }
        if let Some(position) = position {
            attributes.insert("POSITION".into(), json!(self.accessor(position, true, out)?));
        }
        if let Some(Value::Array(targets)) = primitive.get_mut("targets") {
            let mut all = targets.iter_mut().filter_map(Value::as_object_mut);
            if let Err(error) = all.try_for_each(|target| self.accessors(target, out)) {
                primitive.remove("targets");
                out.left_out.broken(format!("the morph targets of mesh {mesh}"), &error);
            }
        }
        if let Some(indices) = reference(primitive, "indices") {
            primitive.insert("indices".into(), json!(self.accessor(indices, false, out)?));
        }
        if let Some(material) = reference(primitive, "material") {
            match self.material(material, out) {
                Ok(new) => drop(primitive.insert("material".into(), json!(new))),
                Err(error) => {
                    primitive.remove("material");
                    out.left_out.broken(format!("the material of mesh {mesh}"), &error);
                }
            }
        }
        if primitive.get("extensions").is_some_and(|extensions| extensions.get(DRACO).is_some()) {
            return Err(DocumentError::malformed("meshes", mesh, "a primitive's compressed data cannot be decoded"));
        }
        out.left_out.extensions_of(primitive, &[]);
        for name in SILENT_EXTENSIONS {
            if self.lists("extensionsUsed", name) {
                self.use_extension(name, out);
            }
        }
        Ok(())
    }

    /// Copies an attribute that decorates, unless it is not there for each position.
    fn attribute(
        &mut self,
        index: usize,
        position: Option<usize>,
        out: &mut GlbOutput,
    ) -> Result<usize, DocumentError> {
        let count = |accessor: usize| self.document.get("accessors", accessor).map(|entry| reference(entry, "count"));
        if let Some(position) = position
            && count(index)? != count(position)?
        {
            return Err(DocumentError::malformed("accessors", index, "has another count than the positions"));
        }
        self.accessor(index, false, out)
    }

    /// Bounds are computed from the data: files state wrong ones. Only those of positions are required.
    fn accessor(&mut self, index: usize, bounded: bool, out: &mut GlbOutput) -> Result<usize, DocumentError> {
        self.once("accessors", index, out, |source, accessor, out| {
            out.left_out.extensions_of(accessor, &[]);
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
        let bytes = self.document.view(index)?;
        // Decoded data has a plain copy.
        out.left_out.extensions_of(&mut view, &MESHOPT);
        let new = out.push_view(bytes, view);
        self.copied.insert(("bufferViews", index), new);
        Ok(new)
    }

    pub fn material(&mut self, index: usize, out: &mut GlbOutput) -> Result<usize, DocumentError> {
        self.once("materials", index, out, |source, material, out| {
            let name = material.get("name").and_then(Value::as_str).filter(|name| !name.is_empty());
            source.material = name.map_or_else(|| index.to_string(), str::to_owned);
            source.textures_below(material, out);
            Ok(())
        })
    }

    /// Gives every texture below a material its new index: in glTF and in all its extensions, an object with a number
    /// `index` refers to a texture.
    fn textures_below(&mut self, object: &mut Object, out: &mut GlbOutput) {
        if let Some(Value::Object(extensions)) = object.get_mut("extensions") {
            let dropped = extensions.keys().filter(|name| DROPPED_EXTENSIONS.contains(&name.as_str()));
            dropped.for_each(|name| out.left_out.extension(name));
            extensions.retain(|name, _| !DROPPED_EXTENSIONS.contains(&name.as_str()));
            for name in extensions.keys() {
                self.use_extension(name, out);
            }
        }
        object.retain(|key, value| {
            let Value::Object(inner) = value else { return true };
            if key == "extras" {
                return true;
            }
            if let Some(texture) = reference(inner, "index") {
                match self.texture(texture, out) {
                    Ok(new) => drop(inner.insert("index".into(), json!(new))),
                    Err(error) => {
                        out.left_out.broken(format!("the texture {key} of material {}", self.material), &error);
                        return false;
                    }
                }
            }
            self.textures_below(inner, out);
            true
        });
    }

    fn texture(&mut self, index: usize, out: &mut GlbOutput) -> Result<usize, DocumentError> {
        self.once("textures", index, out, |source, texture, out| {
            if let Some(sampler) = reference(texture, "sampler") {
                let copied = source.once("samplers", sampler, out, |_, sampler, out| {
                    out.left_out.extensions_of(sampler, &[]);
                    Ok(())
                })?;
                texture.insert("sampler".into(), json!(copied));
            }
            source.move_image(texture, out)?;
            if let Some(Value::Object(extensions)) = texture.get_mut("extensions") {
                // Only the extensions that offer the image in another format (KTX2, WebP, AVIF, DDS).
                let is_kept = |value: &Value| value.get("source").is_some_and(Value::is_u64);
                let dropped = extensions.iter().filter(|(_, value)| !is_kept(value));
                dropped.for_each(|(name, _)| out.left_out.extension(name));
                extensions.retain(|_, value| is_kept(value));
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
            out.left_out.extensions_of(image, &[]);
            let fault = match source.document.picture(index, source.resolve) {
                Ok(picture) => {
                    // Some exporters write types that viewers refuse, such as `image/jpg`.
                    if let Some(media) = picture.media {
                        image.insert("mimeType".into(), json!(media));
                    }
                    if image.get("bufferView").is_some() {
                        return source.move_view(image, out);
                    }
                    let view = out.push_view(&picture.bytes, Object::new());
                    image.remove("uri");
                    image.insert("bufferView".into(), json!(view));
                    return Ok(());
                }
                Err(fault) => fault,
            };
            if let PictureFault::Broken(why) = &fault {
                return Err(DocumentError::malformed("images", index, why));
            }
            let uri = uri_of(image).unwrap_or_default().to_owned();
            out.left_out.image(MissingImage { uri, material: source.material.clone(), fault });
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
