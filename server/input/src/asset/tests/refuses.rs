//! Files that are refused, and the messages.

use serde_json::{Value, json};

use super::model::{Model, glb, messages, no_files, read, read_with, tetrahedron};
use crate::asset::{
    Asset, AssetProblem, Limits, Log, Logged, ProblemKind, Source, guarded, note_flat, read_with as asset_of,
};
use crate::testing::says_only;
use cairn_geometry::topology::Flat;

/// The tetrahedron with one value changed is refused, and all of `parts` are said.
#[track_caller]
fn refused(pointer: &str, value: Value, parts: &[&str]) {
    said(&tetrahedron().set(pointer, value), parts);
}

#[track_caller]
fn said(model: &Model, parts: &[&str]) {
    let text = messages(model.read());
    assert!(text.starts_with("thing.glb: "), "{text}");
    for part in parts {
        assert!(text.contains(part), "{part:?} is not said in: {text}");
    }
}

#[test]
fn counts_offsets_and_strides() {
    refused("/accessors/0/count", json!(1u64 << 62), &["/accessors/0/count", "1,537,228,672,809,129,302 triangles"]);
    refused("/accessors/0/count", json!(u64::MAX), &["/accessors/0/count"]);
    refused("/accessors/0/count", json!(-1), &["/accessors/0/count", "found -1"]);
    refused("/accessors/0/count", json!(1.5), &["/accessors/0/count", "found 1.5"]);
    refused("/accessors/0/count", json!(5), &["accessor 0 (POSITION), /bufferViews/0", "bytes 0 to 60", "of 48"]);
    refused("/accessors/1/byteOffset", json!(1u64 << 63), &["node `Brick`, mesh 0, primitive 0, accessor 1 (indices)"]);
    refused("/accessors/1/byteOffset", json!(u64::MAX), &["accessor 1 (indices)"]);
    refused("/bufferViews/0/byteStride", json!(u64::MAX), &["accessor 0 (POSITION)"]);
    refused("/bufferViews/0/byteStride", json!(4), &["stride of 4 bytes", "12 bytes"]);
    refused("/bufferViews/0/byteOffset", json!(u64::MAX), &["/bufferViews/0", "of 72"]);
    refused("/bufferViews/0/byteLength", json!(u64::MAX), &["/bufferViews/0", "of 72"]);
    refused("/bufferViews/0/byteLength", json!(73), &["/bufferViews/0: bytes 0 to 73 are wanted of 72"]);
    refused("/buffers/0/byteLength", json!(100), &["/buffers/0", "should have 100 bytes but has 72", "cut off"]);
    refused("/buffers/0/byteLength", json!(1u64 << 62), &["/buffers/0"]);
    let zeros = json!({ "componentType": 5126, "count": 1u64 << 40, "type": "VEC3" });
    refused("/accessors/0", zeros, &["/accessors/0/count", "limit"]);
}

#[test]
fn references() {
    refused("/nodes/0/mesh", json!(3), &["node `Brick`, mesh 3: there is no mesh 3; the file has 1"]);
    refused("/nodes/0/mesh", json!("0"), &["/nodes/0/mesh", "found \"0\""]);
    refused("/scenes/0/nodes/0", json!(9), &["/scenes/0/nodes/0: there is no node 9"]);
    refused("/scene", json!(4), &["/scene: there is no scene 4"]);
    refused("/nodes/0/children", json!([7, "x"]), &["/nodes/0/children/0", "/nodes/0/children/1"]);
    refused("/meshes/0/primitives/0/indices", json!(5), &["primitive 0, accessor 5 (indices): there is no accessor 5"]);
    let far = json!(u32::MAX);
    refused("/meshes/0/primitives/0/attributes/POSITION", far, &["there is no accessor 4294967295"]);
    let further = json!(1u64 << 32);
    refused("/meshes/0/primitives/0/attributes/POSITION", further, &["POSITION: expected an integer of 32 bits"]);
    refused("/accessors/0/bufferView", json!(5), &["accessor 0 (POSITION): there is no buffer view 5"]);
    refused("/bufferViews/0/buffer", json!(5), &["/bufferViews/0/buffer: there is no buffer 5"]);
    refused("/meshes", json!({ "a": 1 }), &["/meshes: expected a list, found an object"]);
    refused("/meshes/0/primitives/0/mode", json!(7), &["/meshes/0/primitives/0/mode"]);
}

#[test]
fn formats() {
    refused(
        "/accessors/0/componentType",
        json!(5122),
        &["POSITION cannot hold VEC3 of component type 5122", "KHR_mesh_quantization"],
    );
    refused("/accessors/0/componentType", json!(1), &["component type 1"]);
    refused("/accessors/0/type", json!("MAT4"), &["MAT4"]);
    refused("/accessors/1/componentType", json!(5126), &["indices cannot hold SCALAR of component type 5126"]);
    refused("/accessors/1/componentType", json!(5120), &["indices cannot hold"]);
    refused("/accessors/0", json!({}), &["/accessors/0/componentType", "/accessors/0/count", "missing"]);
    refused("/accessors/0", json!(null), &["/accessors/0/componentType"]);
}

/// The tetrahedron with its bytes from `at` on replaced.
fn with_bytes(at: usize, bytes: &[u8]) -> Model {
    let mut model = tetrahedron();
    model.bin[at..at + bytes.len()].copy_from_slice(bytes);
    model
}

#[test]
fn vertices_and_indices() {
    let place = "node `Brick`, mesh 0, primitive 0";
    said(&with_bytes(16, &f32::NAN.to_le_bytes()), &[place, "vertex 1 is at [1, NaN, 0]", "Repair the mesh"]);
    said(&with_bytes(12, &f32::INFINITY.to_le_bytes()), &[place, "vertex 1", "inf"]);
    said(&with_bytes(12, &1e30f32.to_le_bytes()), &[place, "vertex 1", "further than 1e12 m", "metres"]);
    said(&with_bytes(48, &9u16.to_le_bytes()), &[place, "index 0 points at vertex 9, but there are 4"]);
    said(&with_bytes(48, &u16::MAX.to_le_bytes()), &[place, "vertex 65535"]);
    let flat = tetrahedron().set("/nodes/0/scale", json!([0, 0, 0]));
    said(&flat, &["no triangles: every triangle (4) has no area"]);
}

#[test]
fn sparse_accessors() {
    let sparse = |count: u64, indices: &[u8], code: u32| {
        let mut model = tetrahedron();
        let view = model.add_view(indices);
        let indices = json!({ "bufferView": view, "componentType": code });
        model.set("/accessors/0/sparse", json!({ "count": count, "indices": indices, "values": { "bufferView": 0 } }))
    };
    assert!(sparse(2, &[0, 3], 5121).read().is_ok());
    said(&sparse(2, &[3, 0], 5121), &["/accessors/0/sparse/indices", "do not ascend strictly"]);
    said(&sparse(2, &[1, 1], 5121), &["do not ascend strictly"]);
    said(&sparse(2, &[0, 4], 5121), &["reach beyond 4 elements"]);
    said(&sparse(5, &[0, 1, 2, 3, 4], 5121), &["5 sparse elements replace 4"]);
    said(&sparse(1 << 62, &[0], 5121), &["/accessors/0/sparse"]);
    said(&sparse(2, &[0], 5121), &["bytes 0 to 2 are wanted of 1"]);
    said(&sparse(2, &[0, 1], 5126), &["component type 5126"]);
    refused("/accessors/0/sparse", json!(3), &["/accessors/0/sparse/count"]);
    refused("/accessors/0/sparse", json!({ "count": 1 }), &["/accessors/0/sparse/indices/bufferView", "sparse/values"]);
}

#[test]
fn nodes() {
    let nodes = |nodes: Value| tetrahedron().set("/nodes", nodes);
    let own = nodes(json!([{ "name": "Ring", "mesh": 0, "children": [0] }]));
    said(&own, &["nodes contain themselves: node `Ring` > node `Ring`"]);
    let pair = nodes(json!([{ "name": "A", "mesh": 0, "children": [1] }, { "name": "B", "children": [0] }]));
    said(&pair, &["nodes contain themselves: ", "node `A` > node `B`", "one parent"]);
    let tail = nodes(json!([{ "children": [1] }, { "children": [2] }, { "mesh": 0, "children": [1] }]));
    said(&tail, &["nodes contain themselves: ", "node 1 > node 2 > node 1"]);
    assert!(messages(tail.read_node("A")).contains("no node has a name"));
    let mut rootless = pair.clone();
    rootless.json.as_object_mut().expect("an object").retain(|key, _| key != "scene" && key != "scenes");
    said(&rootless, &["nodes contain themselves"]);
    assert!(messages(pair.read_node("B")).contains("nodes contain themselves"));

    let two =
        nodes(json!([{ "children": [1, 2] }, { "children": [3] }, { "name": "C", "children": [3] }, { "mesh": 0 }]));
    said(&two, &["node 3: the node has two parents, node 1 and node `C`"]);
}

#[test]
fn transforms() {
    let place = "node `Brick`: ";
    refused("/nodes/0/rotation", json!([0, 0, 0, 0]), &[place, "quaternion of length 0"]);
    refused("/nodes/0/rotation", json!([1e300, 1e300, 0, 0]), &[place, "quaternion of length inf"]);
    refused("/nodes/0/rotation", json!([0, 0, 1]), &["/nodes/0/rotation: expected four numbers, found a list of 3"]);
    refused("/nodes/0/scale", json!(["1", 1, 1]), &["/nodes/0/scale: expected three numbers"]);
    refused("/nodes/0/matrix", json!(vec![1; 16]), &[place, "not affine"]);
    refused("/nodes/0/matrix", json!(vec![1; 15]), &["/nodes/0/matrix: expected sixteen numbers"]);
    refused("/nodes/0/translation", json!([1e13, 0, 0]), &["further than 1e12 m"]);
    refused("/nodes/0/translation", json!([1e308, 0, 0]), &["further than 1e12 m"]);
    let nodes = json!([{ "scale": [1e200, 1, 1], "children": [1] }, { "scale": [1e200, 1, 1], "mesh": 0 }]);
    refused("/nodes", nodes, &["node 1: the transforms down to this node multiply to no finite number"]);
    let loose = tetrahedron().set("/nodes/0/rotation", json!([0, 0, 0, 2])).read().expect("a direction is there");
    assert!(loose.notes[0].contains("normalised"));
    // A matrix given as text that JSON cannot hold.
    let text = tetrahedron().set("/nodes/0/translation", json!(["X", 0, 0])).json.to_string().replace("\"X\"", "1e999");
    let text = messages(read(text.as_bytes()));
    assert!(text.contains("/nodes/0/translation: the JSON cannot be read: number out of range."), "{text}");
}

#[test]
fn node_names() {
    let nodes = json!([{ "name": "Brick", "mesh": 0 }, { "name": "Brick_large", "mesh": 0 }, { "name": "Roof" }, {}]);
    let model = tetrahedron().set("/nodes", nodes);
    assert!(model.read_node("Brick").is_ok());
    assert!(messages(model.read_node("Birck")).contains("no node is called `Birck`; near it: `Brick`"));
    assert!(messages(model.read_node("brick")).contains("near it: `Brick`"));
    assert!(messages(model.read_node("Zeppelin")).contains("there are: `Brick`, `Brick_large`, `Roof`"));
    assert!(messages(model.read_node("Roof")).contains("it holds no triangles"));
    let twice = model.set("/nodes/2/name", json!("Brick"));
    assert!(messages(twice.read_node("Brick")).contains("2 nodes are called `Brick` (nodes 0, 2)"));
}

#[test]
fn uris() {
    for uri in ["../x.bin", "..\\x.bin", "%2e%2e/x.bin", "http://x/y", "ab:c", "~/x", "%ff"] {
        let model = tetrahedron().set("/buffers/0/uri", json!(uri));
        let text = model.json.to_string();
        let asked = |path: &str| -> Result<Vec<u8>, String> { panic!("{path} was asked for") };
        let text = messages(read_with(text.as_bytes(), None, &asked, Limits::default()));
        assert!(text.contains("/buffers/0/uri: the URI") && text.contains("is refused"), "{text}");
        assert!(text.contains("write its plain name"), "{text}");
    }
    refused("/buffers/0/uri", json!("gone.bin"), &["/buffers/0/uri", "\"gone.bin\" cannot be read: no such file"]);
    refused("/buffers/0/uri", json!("data:;base64,?"), &["/buffers/0/uri", "bad base64"]);
    refused("/buffers/0/uri", json!("data:;base64,AAAA"), &["/buffers/0", "72 bytes but has 3"]);
    refused("/buffers/0/uri", json!(3), &["/buffers/0/uri: expected a URI, found 3"]);
    let text = tetrahedron().json.to_string();
    assert!(messages(read(text.as_bytes())).contains("/buffers/0: the buffer has no data"));
    // A long URI is not repeated in full.
    let long = format!("{}.bin", "x".repeat(100_000));
    assert!(messages(tetrahedron().set("/buffers/0/uri", json!(long)).read()).len() < 400);
}

#[test]
fn extensions() {
    let used = tetrahedron().set("/nodes/0/extensions", json!({ "ACME_bend": {} }));
    assert!(used.read().is_ok());
    said(
        &used.set("/extensionsRequired", json!(["ACME_bend"])),
        &["/extensionsRequired", "ACME_bend", "without ACME_bend"],
    );
}

#[test]
fn limits() {
    let model = tetrahedron();
    let with = |limits: Limits| messages(read_with(&model.glb(), None, &no_files, limits));
    let default = Limits::default();
    assert!(with(Limits { bytes: 100, ..default }).contains("bytes are more than the limit of 100"));
    assert!(with(Limits { triangles: 3, ..default }).contains("more than the limit of"));
    assert!(with(Limits { nodes: 0, ..default }).contains("1 nodes are more than the limit of 0"));
    // So do the corners of a file that has none in common.
    let many = model.clone().set("/accessors/1/count", json!(15_728_640));
    let text = messages(many.read());
    assert!(text.contains("5,242,880 triangles are more than the limit of 4,000,000"), "{text}");
    // Instances count each time.
    let nodes: Vec<_> = (0..100).map(|_| json!({ "mesh": 0 })).collect();
    let many = model.clone().set("/nodes", json!(nodes)).set("/scenes/0/nodes", json!((0..100).collect::<Vec<_>>()));
    let text = messages(read_with(&many.glb(), None, &no_files, Limits { triangles: 399, ..default }));
    assert!(text.contains("400 triangles are more than the limit of 399"), "{text}");
    // Fetched buffers count as well.
    let external = model.clone().set("/buffers/0/uri", json!("big.bin")).json.to_string();
    let big = |_: &str| Ok(vec![0; 10_000]);
    let text = messages(read_with(external.as_bytes(), None, &big, Limits { bytes: 5000, ..default }));
    assert!(text.contains("/buffers/0/uri: 5,001 bytes are more"), "{text}");
    // A document of nothing but brackets must not fill the memory.
    let bomb = format!(r#"{{"asset":{{"version":"2.0"}},"nodes":[{}0]}}"#, "0,".repeat(5_000_000));
    assert!(messages(read(bomb.as_bytes())).contains("too many values"));
    let deep = format!(r#"{{"asset":{{"version":"2.0"}},"nodes":{}"#, "[".repeat(1_000_000));
    assert!(messages(read(deep.as_bytes())).contains("the JSON cannot be read: EOF while parsing"));
}

#[test]
fn versions() {
    refused("/asset/version", json!("1.0"), &["/asset/version", "glTF version \"1.0\" is not read", "gltf-pipeline"]);
    refused("/asset/version", json!("3.0"), &["\"3.0\""]);
    refused("/asset/version", json!(2), &["version \"2\""]);
    refused("/asset/minVersion", json!("2.1"), &["/asset/minVersion", "\"2.1\""]);
    refused("/asset", json!({}), &["/asset/version", "missing"]);
    assert!(tetrahedron().set("/asset/version", json!("2.1")).read().is_ok());
    let mut old = tetrahedron().glb();
    old[4] = 1;
    assert!(messages(read(&old)).contains("glTF version \"1\" is not read"));
}

#[test]
fn broken_glb() {
    let whole = tetrahedron().glb();
    for length in 0..whole.len() {
        let text = messages(read(&whole[..length]));
        let expected = match length {
            0 => "the file is empty",
            1..4 => "this is not glTF",
            _ => "the GLB container is broken: it ",
        };
        assert!(text.contains(expected), "{length}: {text}");
    }
    for (bytes, part) in [
        (glb(&[]), "no JSON chunk"),
        (glb(&[(b"BIN\0", b"1234")]), "first chunk is not JSON"),
        (glb(&[(b"JSON", b"")]), "the JSON cannot be read"),
        (glb(&[(b"JSON", b"{\"asset\":")]), "the JSON cannot be read: EOF while parsing a value at line 1"),
        (glb(&[(b"JSON", b"\xff\xfe")]), "the JSON cannot be read"),
        (glb(&[(b"JSON", b"[1, 2]")]), "this is not glTF; it looks like some other JSON"),
        (glb(&[(b"JSON", tetrahedron().json.to_string().as_bytes())]), "/buffers/0: the buffer has no data"),
    ] {
        let text = messages(read(&bytes));
        assert!(text.contains(part), "{text}");
    }
    let mut long = whole.clone();
    long[12] = 0xff;
    long[15] = 0xff;
    assert!(messages(read(&long)).contains("a chunk of"));
}

#[test]
fn other_files_are_named() {
    let stl = [&[b'x'; 80][..], &1u32.to_le_bytes(), &[0; 50]].concat();
    let files: [(&[u8], &str); 12] = [
        (b"", "the file is empty"),
        (b"\x89PNG\r\n\x1a\n", "a PNG picture"),
        (b"BLENDER-v300", "a Blender file"),
        (b"Kaydara FBX Binary  \0", "an FBX file"),
        (b"# made by hand\nv 0 0 0\nv 1 0 0\nf 1 2 3\n", "a Wavefront OBJ file"),
        (b"solid cube\n", "an STL file"),
        (&stl, "a binary STL file"),
        (b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
        (b"<!DOCTYPE html><html>", "a web page"),
        (b"Dear reader,\n", "some other text"),
        (b"\x01\x02\x03\xff", "some other binary file"),
        (b"{\"name\": \"package\"}", "some other JSON"),
    ];
    for (bytes, seems) in files {
        let text = messages(read(bytes));
        assert!(text.contains(seems), "{text}");
        assert!(text.contains("xport it"), "{text}");
    }
}

#[test]
fn nothing_to_read() {
    said(
        &tetrahedron().set("/nodes", json!([])).set("/scenes/0/nodes", json!([])),
        &["its scene shows none of 1 mesh"],
    );
    said(&tetrahedron().set("/nodes/0", json!({})), &["none of the nodes read (1) shows one"]);
    said(&tetrahedron().set("/nodes/0", json!({})).set("/meshes", json!([])), &["it has no mesh at all"]);
    said(&tetrahedron().set("/meshes/0/primitives/0/attributes", json!({})), &["only primitives without positions"]);
    said(&tetrahedron().set("/accessors/1/count", json!(0)), &["it holds no triangles"]);
}

#[test]
fn everything_wrong_is_told_at_once() {
    let model = tetrahedron()
        .set("/nodes", json!([{ "mesh": 0 }, { "mesh": 7 }, { "mesh": 1 }]))
        .set("/scenes/0/nodes", json!([0, 1, 2]))
        .set("/meshes/1", json!({ "primitives": [{ "attributes": { "POSITION": 2 }, "indices": 3 }] }))
        .set("/accessors/2", json!({ "bufferView": 0, "componentType": 5126, "count": 400, "type": "VEC3" }))
        .set("/accessors/3", json!({ "bufferView": 9, "componentType": 5125, "count": 3, "type": "SCALAR" }));
    let problems = model.read().expect_err("much is wrong");
    assert_eq!(problems.len(), 3, "{problems:#?}");
    // Faults of nodes do not hide those of meshes.
    let model = model.set("/nodes/0/rotation", json!([0, 0, 0, 0])).set("/nodes/1/children", json!([1, 99]));
    let text = messages(model.read());
    for part in ["length 0", "there is no node 99", "contain themselves", "there is no mesh 7", "no buffer view 9"] {
        assert!(text.contains(part), "{part:?} is not said in: {text}");
    }
    // The same fault is reported once, and their number is bounded.
    let nodes: Vec<_> = (0..1000).map(|i| json!({ "mesh": 100 + i })).collect();
    let model = tetrahedron().set("/nodes", json!(nodes)).set("/scenes/0/nodes", json!((0..1000).collect::<Vec<_>>()));
    let problems = model.read().expect_err("much is wrong");
    assert_eq!(problems.len(), 41);
    assert_eq!(problems[40].what, ProblemKind::More { count: 960 });
    let shared = tetrahedron()
        .set("/nodes", json!([{ "mesh": 0 }, { "mesh": 0 }]))
        .set("/scenes/0/nodes", json!([0, 1]))
        .set("/accessors/0/count", json!(5));
    assert_eq!(shared.read().expect_err("it is too long").len(), 1);
}

#[test]
fn each_word_of_the_reader_about_itself_has_its_cause() {
    let bytes = tetrahedron().embedded();
    let source = Source { name: "a.gltf", bytes: &bytes, node: None, resolve: &no_files, limits: Limits::default() };
    type Reader<'a> = &'a dyn Fn(&mut Log) -> Logged<Asset>;
    let whole: Reader = &|log| asset_of(&source, log);
    let empty: Reader = &|log| Err(log.refuse("", ProblemKind::EmptyFile));
    for (case, reader, words) in [
        ("when the file is read", whole, &[] as &[&str]),
        ("when the file is refused", empty, &["the file is empty"]),
        (
            "when the reader panics",
            &|_| panic!("index 7 of 3"),
            &["an internal error stopped the reader: index 7 of 3. Please report this with the file."],
        ),
    ] {
        let said = guarded(Log::new("a.gltf"), reader).err().unwrap_or_default();
        says_only(case, &said.iter().map(AssetProblem::to_string).collect::<Vec<_>>(), words);
    }
    for (case, flat, words) in [
        ("when no triangle is a line", Flat::default(), &[] as &[&str]),
        ("when lines are left out", Flat { dropped: 2, ..Flat::default() }, &[]),
        (
            "when lines are merged",
            Flat { folded: 2, ..Flat::default() },
            &["2: triangles of no area are merged with those beside them"],
        ),
        (
            "when lines hold a surface",
            Flat { left: 1, ..Flat::default() },
            &["1: triangles of no area could not be taken away and stay"],
        ),
    ] {
        let mut log = Log::new("a.gltf");
        note_flat(&flat, &mut log);
        says_only(case, &log.notes(), words);
    }
}
