//! A glTF file as it lies on disk: its JSON and its buffers, nothing interpreted.
//!
//! The exporter copies from it and the renderer reads from it, both once its compressed geometry is plain. Every index,
//! offset and length in the JSON is untrusted: the accessors here check them, and nothing panics on a hostile file.

use cairn_core::asset::container::{self, Container};
use cairn_core::asset::{ProblemKind, uri};
use serde_json::{Map, Value, json};

/// Gives the bytes of an external file, or why not. The path is relative to the glTF's folder, `/` between its parts,
/// and does not lead out of it: no root, drive, scheme, `..` or backslash.
pub type Resolver<'a> = dyn Fn(&str) -> Result<Vec<u8>, String> + 'a;

/// A parsed file with all its buffers.
#[derive(Debug)]
pub struct Document {
    json: Map<String, Value>,
    /// One per entry of `buffers`: its bytes, or why there are none. That only matters to who needs them.
    buffers: Vec<Result<Vec<u8>, String>>,
}

/// A part of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// A node with all that is below it.
    Node(usize),
    Scene(usize),
}

/// Why a file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DocumentError {
    #[error("not a glTF file: {0}")]
    Json(#[from] serde_json::Error),
    #[error(transparent)]
    Container(#[from] ProblemKind),
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

impl Document {
    /// Parses a `.gltf` or `.glb` and gathers its buffers, from data URIs or through `resolve`. Compressed geometry stays
    /// so.
    pub fn parse(bytes: &[u8], resolve: &Resolver) -> Result<Document, DocumentError> {
        let (json, mut bin) = split(bytes)?;
        let read = |(index, entry): (usize, &Value)| {
            let bin = if index == 0 { bin.take() } else { None };
            match entry.get("uri").and_then(Value::as_str) {
                Some(uri) => fetch(uri, resolve),
                None => bin.map(<[u8]>::to_vec).ok_or_else(|| "has no data".into()),
            }
        };
        let entries = json.get("buffers").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
        let buffers = entries.iter().enumerate().map(read).collect();
        Ok(Document { json, buffers })
    }

    /// The root object.
    pub fn json(&self) -> &Map<String, Value> {
        &self.json
    }

    /// A top-level array; empty if there is none.
    pub fn array(&self, kind: &str) -> &[Value] {
        self.json.get(kind).and_then(Value::as_array).map_or(&[], Vec::as_slice)
    }

    /// An entry of a top-level array.
    pub fn get(&self, kind: &'static str, index: usize) -> Result<&Map<String, Value>, DocumentError> {
        self.array(kind).get(index).and_then(Value::as_object).ok_or(DocumentError::Missing { kind, index })
    }

    /// An entry of a top-level array, to be changed.
    pub fn get_mut(&mut self, kind: &str, index: usize) -> Option<&mut Map<String, Value>> {
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
        self.buffers.push(Ok(bytes));
        index
    }

    /// The bytes of a buffer view.
    pub fn view(&self, index: usize) -> Result<&[u8], DocumentError> {
        self.range("bufferViews", index, self.get("bufferViews", index)?)
    }

    /// The range of a buffer that `view` names, which belongs to entry `index` of the array `kind`.
    pub fn range(&self, kind: &'static str, index: usize, view: &Map<String, Value>) -> Result<&[u8], DocumentError> {
        let malformed = |problem: &str| DocumentError::malformed(kind, index, problem);
        let buffer = reference(view, "buffer").ok_or_else(|| malformed("no buffer"))?;
        let entry = self.buffers.get(buffer).ok_or(DocumentError::Missing { kind: "buffers", index: buffer })?;
        let data = entry.as_ref().map_err(|problem| DocumentError::malformed("buffers", buffer, problem))?;
        let start = reference(view, "byteOffset").unwrap_or(0);
        let length = reference(view, "byteLength").ok_or_else(|| malformed("no byteLength"))?;
        let end = start.checked_add(length).ok_or_else(|| malformed("too long"))?;
        data.get(start..end).ok_or_else(|| malformed("reaches beyond its buffer"))
    }

    /// Whether the file needs no other: no buffer and no image lies outside.
    pub fn is_self_contained(&self) -> bool {
        let outside = |entry: &Value| entry.get("uri").and_then(Value::as_str).is_some_and(|u| !uri::is_data(u));
        !self.array("buffers").iter().any(outside) && !self.array("images").iter().any(outside)
    }

    /// The nodes listed by the default scene. Without any scene: all that are nobody's child.
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
pub fn reference(object: &Map<String, Value>, key: &str) -> Option<usize> {
    object.get(key).and_then(Value::as_u64).and_then(|v| usize::try_from(v).ok())
}

/// A member that is a list of non-negative integers; anything else in it is passed over.
pub fn references(object: &Map<String, Value>, key: &str) -> Vec<usize> {
    let items = object.get(key).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    items.iter().filter_map(|v| v.as_u64().and_then(|v| usize::try_from(v).ok())).collect()
}

/// The bytes that a URI stands for: its own data, or a file below the glTF's folder.
pub fn fetch(uri: &str, resolve: &Resolver) -> Result<Vec<u8>, String> {
    if uri::is_data(uri) {
        return uri::decode_data(uri);
    }
    resolve(&uri::relative_path(uri).map_err(|why| format!("{uri}: {why}"))?)
}

/// The files beside a glTF file that its buffers and images name, as paths relative to its folder.
pub fn external_files(bytes: &[u8]) -> Result<Vec<String>, DocumentError> {
    let (json, _) = split(bytes)?;
    let lists = ["buffers", "images"].iter().filter_map(|list| json.get(*list)?.as_array());
    let uris = lists.flatten().filter_map(|entry| entry.get("uri")?.as_str()).filter(|uri| !uri::is_data(uri));
    Ok(uris.filter_map(|uri| uri::relative_path(uri).ok()).collect())
}

/// The root object, and the binary chunk of a GLB.
type Parts<'a> = (Map<String, Value>, Option<&'a [u8]>);

fn split(bytes: &[u8]) -> Result<Parts<'_>, DocumentError> {
    let Container { json, bin } = container::open(bytes)?;
    Ok((serde_json::from_slice(json)?, bin))
}
