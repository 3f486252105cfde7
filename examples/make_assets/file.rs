//! The bytes of a GLB file.

use serde_json::{Map, Value, json};

/// Buffer, views and accessors of a file.
#[derive(Default)]
pub struct File {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl File {
    pub fn view(&mut self, bytes: &[u8], mut view: Map<String, Value>) -> usize {
        view.insert("buffer".into(), json!(0));
        view.insert("byteOffset".into(), json!(self.bin.len()));
        view.insert("byteLength".into(), json!(bytes.len()));
        self.bin.extend_from_slice(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.views.push(Value::Object(view));
        self.views.len() - 1
    }

    fn accessor(&mut self, bytes: &[u8], target: u32, mut accessor: Value) -> usize {
        let view = self.view(bytes, Map::from_iter([("target".to_string(), json!(target))]));
        accessor["bufferView"] = json!(view);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    pub fn vectors<const N: usize>(&mut self, vectors: &[[f64; N]]) -> usize {
        let single: Vec<[f32; N]> = vectors.iter().map(|v| v.map(|x| x as f32)).collect();
        let bytes: Vec<u8> = single.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let extreme = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
            (0..N).map(|axis| single.iter().map(|v| v[axis]).reduce(pick).unwrap_or(0.0)).collect()
        };
        let accessor = json!({
            "componentType": 5126, "type": format!("VEC{N}"), "count": single.len(),
            "min": extreme(f32::min), "max": extreme(f32::max),
        });
        self.accessor(&bytes, 34962, accessor)
    }

    pub fn indices(&mut self, faces: &[[usize; 3]]) -> usize {
        let bytes: Vec<u8> = faces.iter().flatten().flat_map(|&i| (i as u16).to_le_bytes()).collect();
        let accessor = json!({ "componentType": 5123, "type": "SCALAR", "count": 3 * faces.len() });
        self.accessor(&bytes, 34963, accessor)
    }

    pub fn finish(self, mut root: Value) -> Vec<u8> {
        root["accessors"] = json!(self.accessors);
        root["bufferViews"] = json!(self.views);
        root["buffers"] = json!([{ "byteLength": self.bin.len() }]);
        let mut json = root.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let word = |n: usize| (n as u32).to_le_bytes();
        let total = 28 + json.len() + self.bin.len();
        let head = [*b"glTF", word(2), word(total), word(json.len()), *b"JSON"].concat();
        [&head, &json[..], &word(self.bin.len()), b"BIN\0", &self.bin].concat()
    }
}
