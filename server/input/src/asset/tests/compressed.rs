//! Draco and meshopt: the tetrahedron as the reference encoders write it, and broken streams.

use base64::Engine;
use serde_json::{Value, json};

use super::model::{Model, messages, tetrahedron};
use crate::asset::Limits;
use cairn_geometry::topology::inspect;

/// The reference encoder's streams of the tetrahedron with positions of 11 bits: by edges, and one vertex after
/// another.
pub const DRACO: [&str; 2] = [
    "RFJBQ08CAgEBAAAABAQAAwAAAS8BARAB/wAAAQAJAwAAAgEBAQADAwEQATADAFCCJJEEAAAAAP8HAAAAAAAAAAAAAAAAAAAAAIA/Cw==",
    "RFJBQ08CAgEAAAAEBAEAAgEAAQMAAwIBAgMBAQAJAwAAAgABAQADAwEgASADACCEiIEBAAAAAP8HAAAAAAAAAAAAAAAAAAAAAIA/Cw==",
];
/// The reference encoder's streams of the positions in floats: versions 0 and 1, and version 1 filtered.
pub const POSITIONS: [(&str, &str); 3] = [
    (
        "NONE",
        "oAAAATwAAAD//wE8AAAAfn0AAAEPAAAA//8BDwAAAH59AAABAwAAAP8BAwAAAH4AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA==",
    ),
    ("NONE", "ofr66gAA/wAAf34AAAAA/wAAf34AAAB/AAAAAAAAAAAAAAAAAAAAAAAAAAAAAQEB"),
    ("EXPONENTIAL", "oe7u7gBAPwAAygAAAABAPwDKAAAAAABAAMoAAAAAAAAAAAAAAAAAAI4AAACOAAAAjgAAAA=="),
];
/// The same of the indices in 16 bits.
pub const INDICES: [(&str, &str); 2] =
    [("TRIANGLES", "4f4OAhHwBAB2h1ZneKmGZYlomAFpAAA="), ("INDICES", "0QAIAgIECAoMAgIEBAAAAAA=")];

pub fn bytes(text: &str) -> Vec<u8> {
    base64::engine::general_purpose::STANDARD.decode(text).expect("the constants are base64")
}

/// The tetrahedron whose data is a Draco stream alone.
pub fn draco(stream: &[u8]) -> Model {
    let mut model = tetrahedron();
    model.bin.clear();
    let view = model.add_view(stream);
    let extension = json!({ "KHR_draco_mesh_compression": { "bufferView": view, "attributes": { "POSITION": 0 } } });
    model
        .set("/accessors/0", json!({ "componentType": 5126, "count": 4, "type": "VEC3" }))
        .set("/accessors/1", json!({ "componentType": 5123, "count": 12, "type": "SCALAR" }))
        .set("/meshes/0/primitives/0/extensions", extension)
        .set("/extensionsRequired", json!(["KHR_draco_mesh_compression"]))
}

/// The tetrahedron whose views are meshopt streams alone: filter and stream of positions, mode and stream of indices.
pub fn meshopt(name: &str, positions: (&str, &str), indices: (&str, &str)) -> Model {
    let mut model = tetrahedron();
    model.bin.clear();
    let streams = [positions.1, indices.1].map(bytes);
    let fallback = json!({ "byteLength": 72, "extensions": { name: { "fallback": true } } });
    let mut model = model.set("/buffers/1", fallback).set("/extensionsRequired", json!([name]));
    let shapes = [("ATTRIBUTES", positions.0, 12, 4), (indices.0, "NONE", 2, 12)];
    for (i, ((mode, filter, stride, count), stream)) in shapes.into_iter().zip(&streams).enumerate() {
        let offset = model.bin.len();
        model.bin.extend_from_slice(stream);
        let extension = json!({ "buffer": 0, "byteOffset": offset, "byteLength": stream.len(), "byteStride": stride,
            "count": count, "mode": mode, "filter": filter });
        model.json["bufferViews"][i]["buffer"] = json!(1);
        model.json["bufferViews"][i]["extensions"] = json!({ name: extension });
    }
    model.json["buffers"][0]["byteLength"] = json!(model.bin.len());
    model
}

#[test]
fn compressed_files_are_the_plain_ones() {
    let plain = tetrahedron().read().expect("it is good");
    for stream in DRACO {
        let asset = draco(&bytes(stream)).read().unwrap_or_else(|problems| panic!("{problems:#?}"));
        let found = inspect(&asset.mesh);
        assert!(found.is_watertight() && found.triangles == 4, "{found:?}");
        assert!((found.signed_volume - 1.0 / 6.0).abs() < 1e-9, "the corners are on the grid: {found:?}");
        assert!(asset.notes.is_empty(), "{:?}", asset.notes);
    }
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        for positions in POSITIONS {
            for indices in INDICES {
                let asset = meshopt(name, positions, indices).read().unwrap_or_else(|p| panic!("{p:#?}"));
                assert_eq!(asset.mesh.points.len(), 4, "{positions:?}");
                let found = inspect(&asset.mesh);
                assert!(found.is_watertight() && found.triangles == 4, "{found:?}");
                assert!((found.signed_volume - inspect(&plain.mesh).signed_volume).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn integers_of_a_draco_stream_are_as_the_accessor_says() {
    let quantized = draco(&bytes(DRACO[0])).set("/extensionsUsed", json!(["KHR_mesh_quantization"]));
    assert!(quantized.read().is_ok(), "floats stay allowed");
    let text = messages(
        draco(&bytes(DRACO[0]))
            .set("/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression/attributes/POSITION", json!(7))
            .read(),
    );
    assert!(text.contains("it has no attribute 7"), "{text}");
}

#[test]
fn broken_streams_are_told_with_the_setting_that_avoids_them() {
    let stream = bytes(DRACO[0]);
    for length in 0..stream.len() - 1 {
        if let Err(problems) = draco(&stream[..length]).read() {
            let text = messages(Err(problems));
            assert!(text.contains("node `Brick`") && text.contains("Compression off"), "{length}: {text}");
        }
    }
    let model = meshopt("EXT_meshopt_compression", POSITIONS[0], INDICES[0]);
    let at = "/bufferViews/0/extensions/EXT_meshopt_compression";
    let said = |key: &str, value: Value, part: &str| {
        let text = messages(model.clone().set(&format!("{at}/{key}"), value).read());
        assert!(text.contains(part), "{part:?} is not said in: {text}");
    };
    said("mode", json!("STRIPS"), "mode STRIPS");
    said("filter", json!("BLUR"), "filter BLUR");
    said("byteStride", json!(300), "byteStride of 300");
    said("byteStride", json!(7), "multiple of 4");
    said("count", json!(3), "are wanted of 36");
    said("count", json!(1u64 << 62), "more than the limit of");
    said("count", json!(null), "expected an integer");
    said("buffer", json!(9), "no buffer 9");
    said("byteLength", json!(1000), "are wanted of");
    said("byteLength", json!(10), "-cc");
}

#[test]
fn little_bytes_cannot_stand_for_much() {
    let with = |model: &Model, limits: Limits| {
        messages(super::model::read_with(&model.glb(), None, &super::model::no_files, limits))
    };
    let few = Limits { triangles: 3, ..Limits::default() };
    assert!(with(&draco(&bytes(DRACO[0])), few).contains("over the caller's ceiling of 3"));
    let model = meshopt("EXT_meshopt_compression", POSITIONS[0], INDICES[0]);
    let short = Limits { bytes: model.glb().len() as u64 + 20, ..Limits::default() };
    assert!(with(&model, short).contains("bytes are more than the limit"));
    // Hundreds of broken streams take the time of a few.
    let mut many = draco(&bytes(DRACO[0])[..40]);
    let primitive = many.json["meshes"][0]["primitives"][0].clone();
    many.json["meshes"][0]["primitives"] = json!(vec![primitive; 300]);
    assert!(messages(many.read()).contains("it is not tried"));
}
