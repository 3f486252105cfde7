//! A tetrahedron as a glTF file that tests bend to their purpose.

use base64::Engine;
use serde_json::{Value, json};

use crate::asset::{self, Asset, AssetProblem, Limits, Source};

/// A document and its one buffer.
#[derive(Clone)]
pub struct Model {
    pub json: Value,
    pub bin: Vec<u8>,
}

/// Corners of the tetrahedron below: volume 1/6, outward.
pub const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
pub const FACES: [u16; 12] = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];

/// One node `Brick` that shows [`CORNERS`] and [`FACES`]: view 0 and accessor 0 hold positions, 1 indices.
pub fn tetrahedron() -> Model {
    let mut bin: Vec<u8> = CORNERS.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    bin.extend(FACES.iter().flat_map(|i| i.to_le_bytes()));
    let json = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "Brick", "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR" }
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 24 }
        ],
        "buffers": [{ "byteLength": 72 }]
    });
    Model { json, bin }
}

impl Model {
    /// Sets the value at a JSON pointer; its parents must be there.
    pub fn set(mut self, pointer: &str, value: Value) -> Model {
        let (parent, key) = pointer.rsplit_once('/').expect("a pointer begins with a slash");
        match self.json.pointer_mut(parent).expect("the parent is there") {
            Value::Array(items) => {
                let at: usize = key.parse().expect("a place in a list");
                if at == items.len() { items.push(value) } else { items[at] = value }
            }
            object => object[key] = value,
        }
        self
    }

    /// Adds bytes to the buffer behind a view of their own; gives the view's number.
    pub fn add_view(&mut self, bytes: &[u8]) -> usize {
        let (offset, views) = (self.bin.len(), self.json["bufferViews"].as_array_mut().expect("a list"));
        views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() }));
        let number = views.len() - 1;
        self.bin.extend_from_slice(bytes);
        self.json["buffers"][0]["byteLength"] = json!(self.bin.len());
        number
    }

    /// As a GLB.
    pub fn glb(&self) -> Vec<u8> {
        let mut text = self.json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        glb(&[(b"JSON", &text), (b"BIN\0", &bin)])
    }

    /// As a `.gltf` with the buffer in it.
    pub fn embedded(&self) -> Vec<u8> {
        let data = base64::engine::general_purpose::STANDARD.encode(&self.bin);
        let uri = format!("data:application/octet-stream;base64,{data}");
        self.clone().set("/buffers/0/uri", json!(uri)).json.to_string().into_bytes()
    }

    pub fn read(&self) -> Result<Asset, Vec<AssetProblem>> {
        read(&self.glb())
    }

    pub fn read_node(&self, node: &str) -> Result<Asset, Vec<AssetProblem>> {
        read_with(&self.glb(), Some(node), &no_files, Limits::default())
    }
}

/// A GLB of any chunks.
pub fn glb(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
    let length = 12 + chunks.iter().map(|(_, data)| 8 + data.len()).sum::<usize>();
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((length as u32).to_le_bytes());
    for (kind, data) in chunks {
        out.extend((data.len() as u32).to_le_bytes());
        out.extend(*kind);
        out.extend(*data);
    }
    out
}

pub fn no_files(_: &str) -> Result<Vec<u8>, String> {
    Err("no such file".to_owned())
}

pub fn read(bytes: &[u8]) -> Result<Asset, Vec<AssetProblem>> {
    read_with(bytes, None, &no_files, Limits::default())
}

pub fn read_with(
    bytes: &[u8],
    node: Option<&str>,
    resolve: &dyn Fn(&str) -> Result<Vec<u8>, String>,
    limits: Limits,
) -> Result<Asset, Vec<AssetProblem>> {
    asset::read(&Source { name: "thing.glb", bytes, node, resolve, limits })
}

/// All problems in one text.
pub fn messages(result: Result<Asset, Vec<AssetProblem>>) -> String {
    match result {
        Ok(asset) => panic!("it was read: {asset:?}"),
        Err(problems) => problems.iter().map(AssetProblem::to_string).collect::<Vec<_>>().join("\n"),
    }
}
