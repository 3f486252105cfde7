//! A glTF file as it lies on disk: its JSON and its buffers, nothing interpreted.
//!
//! Writers copy from it and the renderer reads from it, both once its compressed geometry is decoded. Every index,
//! offset and length in the JSON is untrusted: the methods here check them, and nothing panics on a hostile file.

mod decompress;
mod instances;
mod local;
mod numbers;
mod triangles;

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::container::{self, Chunks};
use crate::media::media_type;
use crate::node::VISIBILITY;
use crate::problem::{ProblemKind, clip};
use crate::remedy;
use crate::source::Resolver;
use crate::uri::{self, Reach};
pub use local::{LocalTransform, matrix, unit};
pub use triangles::Triangles;

/// A JSON object.
pub type Object = Map<String, Value>;

/// A parsed file with all its buffers.
#[derive(Debug)]
pub struct Document<'a> {
    json: Object,
    /// One per entry of `buffers`: its bytes, or why there are none. A reason only matters when the bytes are needed.
    buffers: Vec<Result<Cow<'a, [u8]>, String>>,
}

/// A part of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// A node with all that is below it.
    Node(usize),
    Scene(usize),
}

/// The reason for which a file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DocumentError {
    #[error("not a glTF file: {0}")]
    Json(#[from] serde_json::Error),
    #[error(transparent)]
    Problem(#[from] ProblemKind),
    #[error("{kind}[{index}] does not exist")]
    Missing { kind: &'static str, index: usize },
    #[error("{kind}[{index}]: {problem}")]
    Malformed { kind: &'static str, index: usize, problem: String },
    #[error("no node or scene \"{0}\" exists")]
    NoSuchNode(String),
    #[error("holds no mesh")]
    NoMesh,
}

impl DocumentError {
    pub fn malformed(kind: &'static str, index: usize, problem: impl Into<String>) -> Self {
        DocumentError::Malformed { kind, index, problem: problem.into() }
    }
}

impl<'a> Document<'a> {
    /// Parses a `.gltf` or `.glb`, gathers its buffers, from data URIs or through `resolve`, and decodes its compressed
    /// geometry. A stream that cannot be decoded stays as it is.
    pub fn open(bytes: &'a [u8], resolve: &Resolver) -> Result<Document<'a>, DocumentError> {
        let mut document = Document::parse(bytes, resolve)?;
        document.decompress();
        Ok(document)
    }

    /// As [`Document::open`], but compressed geometry stays compressed.
    pub fn parse(bytes: &'a [u8], resolve: &Resolver) -> Result<Document<'a>, DocumentError> {
        let (json, mut bin) = split(bytes)?;
        let read = |(index, entry): (usize, &Value)| {
            let bin = if index == 0 { bin.take() } else { None };
            match entry.get("uri").and_then(Value::as_str) {
                Some(uri) => uri::fetch(uri, resolve).map(Cow::Owned),
                None => bin.map(Cow::Borrowed).ok_or_else(|| "has no data".into()),
            }
        };
        let entries = json.get("buffers").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
        let buffers = entries.iter().enumerate().map(read).collect();
        Ok(Document { json, buffers })
    }

    /// The root object.
    pub fn json(&self) -> &Object {
        &self.json
    }

    /// A top-level array; empty if there is none.
    pub fn array(&self, kind: &str) -> &[Value] {
        self.json.get(kind).and_then(Value::as_array).map_or(&[], Vec::as_slice)
    }

    /// An entry of a top-level array.
    pub fn get(&self, kind: &'static str, index: usize) -> Result<&Object, DocumentError> {
        self.array(kind).get(index).and_then(Value::as_object).ok_or(DocumentError::Missing { kind, index })
    }

    /// An entry of a top-level array, to change it.
    pub fn get_mut(&mut self, kind: &str, index: usize) -> Option<&mut Object> {
        self.json.get_mut(kind)?.get_mut(index)?.as_object_mut()
    }

    /// Appends an entry to a top-level array, and gives its index.
    pub fn push(&mut self, kind: &str, entry: Value) -> usize {
        let array = self.json.entry(kind).or_insert_with(|| json!([]));
        if !array.is_array() {
            *array = json!([]);
        }
        let array = array.as_array_mut().expect("it is an array");
        array.push(entry);
        array.len() - 1
    }

    /// Appends a buffer of these bytes, and gives its index.
    pub fn push_buffer(&mut self, bytes: Vec<u8>) -> usize {
        let index = self.push("buffers", json!({ "byteLength": bytes.len() }));
        self.buffers.push(Ok(Cow::Owned(bytes)));
        index
    }

    /// The bytes of a buffer view.
    pub fn view(&self, index: usize) -> Result<&[u8], DocumentError> {
        self.range("bufferViews", index, self.get("bufferViews", index)?)
    }

    /// The range of a buffer that `view` names, which belongs to entry `index` of the array `kind`.
    pub fn range(&self, kind: &'static str, index: usize, view: &Object) -> Result<&[u8], DocumentError> {
        let malformed = |problem: &str| DocumentError::malformed(kind, index, problem);
        let buffer = reference(view, "buffer").ok_or_else(|| malformed("no buffer"))?;
        let entry = self.buffers.get(buffer).ok_or(DocumentError::Missing { kind: "buffers", index: buffer })?;
        let data = entry.as_ref().map_err(|problem| DocumentError::malformed("buffers", buffer, problem))?;
        let start = reference(view, "byteOffset").unwrap_or(0);
        let length = reference(view, "byteLength").ok_or_else(|| malformed("no byteLength"))?;
        let end = start.checked_add(length).ok_or_else(|| malformed("too long"))?;
        data.get(start..end).ok_or_else(|| malformed("reaches beyond its buffer"))
    }

    /// The primitives of a mesh.
    pub fn primitives(&self, mesh: usize) -> Result<impl Iterator<Item = &Object>, DocumentError> {
        let list = self.get("meshes", mesh)?.get("primitives").and_then(Value::as_array);
        Ok(list.map_or(&[][..], Vec::as_slice).iter().filter_map(Value::as_object))
    }

    /// All buffers and images are inside the file.
    pub fn is_self_contained(&self) -> bool {
        let outside = |entry: &Value| entry.get("uri").and_then(Value::as_str).is_some_and(|u| !uri::is_data(u));
        !self.array("buffers").iter().any(outside) && !self.array("images").iter().any(outside)
    }

    /// The nodes listed by the default scene. Without any scene: all nodes without a parent.
    pub fn roots(&self) -> Vec<usize> {
        self.roots_of(reference(&self.json, "scene").unwrap_or(0))
    }

    /// The nodes listed by a scene.
    pub fn roots_of(&self, scene: usize) -> Vec<usize> {
        match self.array("scenes").get(scene).and_then(Value::as_object) {
            Some(scene) => references(scene, "nodes"),
            None => (self.parents().iter().enumerate()).filter(|(_, p)| p.is_none()).map(|(n, _)| n).collect(),
        }
    }

    /// The node of that name, the first if there are several; or the scene.
    pub fn part(&self, name: &str) -> Result<Part, DocumentError> {
        let named = |entry: &Value| entry.get("name").and_then(Value::as_str) == Some(name);
        let find = |kind: &str| self.array(kind).iter().position(named);
        let part = find("nodes").map(Part::Node).or_else(|| find("scenes").map(Part::Scene));
        part.ok_or_else(|| DocumentError::NoSuchNode(name.into()))
    }

    /// The parent of each node, the first if several claim it.
    pub fn parents(&self) -> Vec<Option<usize>> {
        let nodes = self.array("nodes");
        let mut parents = vec![None; nodes.len()];
        for (parent, node) in nodes.iter().enumerate() {
            for child in node.as_object().map(|n| references(n, "children")).unwrap_or_default() {
                if let Some(slot) = parents.get_mut(child) {
                    slot.get_or_insert(parent);
                }
            }
        }
        parents
    }
}

/// A member that is a non-negative integer.
pub fn reference(object: &Object, key: &str) -> Option<usize> {
    object.get(key).and_then(Value::as_u64).and_then(|v| usize::try_from(v).ok())
}

/// A member that is a list of non-negative integers; other items are skipped.
pub fn references(object: &Object, key: &str) -> Vec<usize> {
    let items = object.get(key).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    items.iter().filter_map(|v| v.as_u64().and_then(|v| usize::try_from(v).ok())).collect()
}

/// Whether this is a glTF file: a GLB, or an object in JSON, that states its version. Else why not, and a remedy.
pub fn recognise(bytes: &[u8]) -> Result<(), (ProblemKind, String)> {
    let read = |bytes| {
        let Chunks { json, .. } = container::open(bytes)?;
        let root = serde_json::from_slice(json).map_err(|error| match error.is_data() {
            true => ProblemKind::NotGltf { seems: "some other JSON" },
            false => ProblemKind::Json { message: clip(&error.to_string()) },
        });
        let root: Header = root?;
        let is_gltf = root.asset.is_some_and(|asset| asset.version.is_string());
        if is_gltf { Ok(()) } else { Err(ProblemKind::NotGltf { seems: "some other JSON" }) }
    };
    read(bytes).map_err(|what: ProblemKind| {
        let remedy = remedy::of(&what);
        (what, remedy)
    })
}

/// What a glTF file says of itself.
#[derive(Deserialize)]
struct Header {
    asset: Option<AssetHeader>,
}

#[derive(Deserialize)]
struct AssetHeader {
    #[serde(default)]
    version: Value,
}

/// The files beside a glTF file that its buffers and images name and that `resolve` gives, by their paths from its
/// folder. Missing ones are left out, and pictures that are none by their first bytes.
pub fn external_files(bytes: &[u8], resolve: &Resolver) -> Result<BTreeMap<String, Vec<u8>>, DocumentError> {
    let (json, _) = split(bytes)?;
    let mut files = BTreeMap::new();
    for (list, reach) in [("buffers", Reach::Below), ("images", Reach::Above)] {
        let entries = json.get(list).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
        let uris = entries.iter().filter_map(|entry| entry.get("uri")?.as_str()).filter(|uri| !uri::is_data(uri));
        let is_picture = |bytes: &[u8]| media_type(bytes).is_some();
        let found = uris.filter_map(|uri| uri::find(uri, reach, resolve, is_picture).ok());
        files.extend(found.filter(|(_, bytes)| reach == Reach::Below || is_picture(bytes)));
    }
    Ok(files)
}

/// Whether a node is hidden, with all that is below it.
pub fn is_hidden(node: &Object) -> bool {
    let visibility = node.get("extensions").and_then(|extensions| extensions.get(VISIBILITY));
    visibility.and_then(|visibility| visibility.get("visible")).and_then(Value::as_bool) == Some(false)
}

/// The root object, and the binary chunk of a GLB.
fn split(bytes: &[u8]) -> Result<(Object, Option<&[u8]>), DocumentError> {
    let Chunks { json, bin } = container::open(bytes)?;
    Ok((serde_json::from_slice(json)?, bin))
}
