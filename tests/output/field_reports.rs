//! Files that other importers stumbled over, rebuilt: `field_reports.md` has where each was reported, and what Cairn
//! does.

use crate::output::files::{PNG, encode, no_files, pile_of};
use crate::output::reader::json_of;
use cairn_export::{ExportScene, Format, SourceModel, rehearse};
use cairn_files::Disk;
use cairn_geometry::pose::Pose;
use cairn_gltf::Resolver;
use cairn_input::asset::{self, Asset, AssetProblem, Limits, Source};
use glam::{DQuat, DVec3};
use serde_json::{Value, json};
use std::path::Path;

/// Corners and faces of a tetrahedron of 1/6 m^3 that faces outward.
const CORNERS: [[f32; 3]; 4] = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
const FACES: [u16; 12] = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];

fn bytes_of(corners: &[[f32; 3]], faces: &[u16]) -> Vec<u8> {
    let corners = corners.iter().flatten().flat_map(|x| x.to_le_bytes());
    corners.chain(faces.iter().flat_map(|i| i.to_le_bytes())).collect()
}

fn data_uri(bytes: &[u8]) -> String {
    format!("data:,{}", bytes.iter().map(|byte| format!("%{byte:02x}")).collect::<String>())
}

fn tetrahedron() -> Value {
    let bytes = bytes_of(&CORNERS, &FACES);
    json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 4 },
            { "bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 12 },
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": 48 }, { "buffer": 0, "byteOffset": 48, "byteLength": 24 }],
        "buffers": [{ "byteLength": 72, "uri": data_uri(&bytes) }],
    })
}

fn read(bytes: &[u8]) -> Result<Asset, Vec<AssetProblem>> {
    let limits = Limits::default();
    asset::read(&Source { name: "file", bytes, node: None, resolve: &no_files, limits })
}

/// The mesh's volume, its notes with those about the result, and the result.
fn baked_with(bytes: &[u8], resolve: &Resolver) -> (f64, Vec<String>, Value) {
    let limits = Limits::default();
    let read = asset::read(&Source { name: "file", bytes, node: None, resolve, limits });
    let Asset { mesh, mut notes, .. } = read.unwrap_or_else(|problems| panic!("{problems:?}"));
    let model = SourceModel { name: "file", file: "file", bytes, node: None, resolve, asset: None };
    notes.extend(rehearse(&[model], false, &Disk::default()).unwrap().left_out);
    let pose = Pose { translation: DVec3::Y, rotation: DQuat::IDENTITY };
    let scene = ExportScene { props: vec![model], ..Default::default() };
    let result = encode(Format::Glb, &pile_of(&[(0, 1.0)], vec![vec![pose]]), &scene).unwrap();
    (mesh.signed_volume(), notes, json_of(&result))
}

fn baked(document: &Value) -> (f64, Vec<String>, Value) {
    baked_with(document.to_string().as_bytes(), &no_files)
}

fn is_whole(volume: f64) -> bool {
    (volume - 1.0 / 6.0).abs() < 1e-6
}

/// A GLB of these chunks.
fn glb(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
    let mut body = Vec::new();
    for (kind, bytes) in chunks {
        body.extend((bytes.len() as u32).to_le_bytes());
        body.extend_from_slice(*kind);
        body.extend_from_slice(bytes);
    }
    [b"glTF".as_slice(), &2_u32.to_le_bytes(), &(12 + body.len() as u32).to_le_bytes(), &body].concat()
}

fn padded(document: &Value) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    text
}

/// The table has a row for each test, and a test for each row.
#[test]
fn the_table_is_complete() {
    let page = include_str!("field_reports.md");
    let rows: Vec<&str> = page.lines().filter_map(|line| line.strip_prefix("| `")?.split('`').next()).collect();
    let code = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file!())).unwrap();
    let tests = code.split("#[test]\nfn ").skip(2).filter_map(|rest| rest.split('(').next());
    assert_eq!(tests.collect::<Vec<_>>(), rows);
    assert!(rows.len() >= 10 && page.matches("https://github.com/").count() >= rows.len());
}

#[test]
fn interleaved_attributes_in_views_of_their_own() {
    let mut document = tetrahedron();
    let point = |[x, y, z]: [f32; 3]| [x, y, z, 0.0, 1.0, 0.0].map(f32::to_le_bytes).concat();
    let mut bytes: Vec<u8> = CORNERS.into_iter().flat_map(point).collect();
    bytes.extend(FACES.iter().flat_map(|i| i.to_le_bytes()));
    document["bufferViews"] = json!([
        { "buffer": 0, "byteLength": 84, "byteStride": 24 },
        { "buffer": 0, "byteOffset": 96, "byteLength": 24 },
        { "buffer": 0, "byteOffset": 12, "byteLength": 84, "byteStride": 24 },
    ]);
    let normals = json!({ "bufferView": 2, "componentType": 5126, "type": "VEC3", "count": 4 });
    document["accessors"].as_array_mut().unwrap().push(normals);
    document["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(2);
    document["buffers"] = json!([{ "byteLength": bytes.len(), "uri": data_uri(&bytes) }]);
    let (volume, notes, result) = baked(&document);
    assert!(is_whole(volume) && notes.is_empty(), "{notes:?}");
    assert_eq!(result["bufferViews"][0]["byteStride"], 24);
}

#[test]
fn a_sparse_list_without_a_base() {
    let mut document = tetrahedron();
    let indices = [1_u16, 2, 3].map(u16::to_le_bytes).concat();
    let values = bytes_of(&CORNERS[1..], &[]);
    let bytes = [bytes_of(&[], &FACES), indices, vec![0; 2], values].concat();
    document["accessors"][0] = json!({
        "componentType": 5126, "type": "VEC3", "count": 4,
        "sparse": {
            "count": 3, "indices": { "bufferView": 0, "componentType": 5123 }, "values": { "bufferView": 2 },
        },
    });
    document["bufferViews"] = json!([
        { "buffer": 0, "byteOffset": 24, "byteLength": 6 },
        { "buffer": 0, "byteLength": 24 },
        { "buffer": 0, "byteOffset": 32, "byteLength": 36 },
    ]);
    document["buffers"] = json!([{ "byteLength": bytes.len(), "uri": data_uri(&bytes) }]);
    let (volume, notes, result) = baked(&document);
    assert!(is_whole(volume) && notes.is_empty(), "{notes:?}");
    assert_eq!(result["accessors"][0]["sparse"]["count"], 3);
}

#[test]
fn mirrored_nodes_face_outward() {
    let mut document = tetrahedron();
    document["nodes"][0]["scale"] = json!([-1, 1, 1]);
    let (volume, notes, _) = baked(&document);
    assert!(is_whole(volume) && notes.is_empty(), "{volume} {notes:?}");
}

#[test]
fn strips_and_fans() {
    // A tetrahedron as a strip around its edges, and as a fan around a corner with its lid.
    for (mode, faces) in [(5, &[0_u16, 2, 1, 3, 0, 2][..]), (6, &[0, 2, 1, 3, 2])] {
        let mut document = tetrahedron();
        let mut primitives = vec![json!({ "attributes": { "POSITION": 0 }, "indices": 1, "mode": mode })];
        let mut bytes = bytes_of(&CORNERS, faces);
        let begin = bytes.len();
        if mode == 6 {
            bytes.extend([1_u16, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
            primitives.push(json!({ "attributes": { "POSITION": 0 }, "indices": 2 }));
        }
        document["accessors"][1]["count"] = json!(faces.len());
        document["accessors"].as_array_mut().unwrap().push(json!({
            "bufferView": 1, "byteOffset": begin - 48, "componentType": 5123, "type": "SCALAR", "count": 3,
        }));
        document["bufferViews"][1]["byteLength"] = json!(bytes.len() - 48);
        document["meshes"][0]["primitives"] = json!(primitives);
        document["buffers"] = json!([{ "byteLength": bytes.len(), "uri": data_uri(&bytes) }]);
        let (volume, notes, _) = baked(&document);
        assert!(is_whole(volume.abs()), "mode {mode}: {volume} {notes:?}");
    }
}

#[test]
fn primitives_with_too_few_corners() {
    for mode in 1..=6 {
        for count in [1, 2] {
            let mut document = tetrahedron();
            let primitive = document["meshes"][0]["primitives"][0].clone();
            let few = json!({ "attributes": { "POSITION": 0 }, "indices": 2, "mode": mode });
            document["meshes"][0]["primitives"] = json!([primitive, few]);
            let accessor = json!({ "bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": count });
            document["accessors"].as_array_mut().unwrap().push(accessor);
            let (volume, ..) = baked(&document);
            assert!(is_whole(volume), "mode {mode}, {count} indices");
        }
    }
}

#[test]
fn unknown_chunks_and_no_binary_chunk() {
    let file = glb(&[(b"JSON", &padded(&tetrahedron())), (b"ACME", &[1, 2, 3, 4])]);
    let (volume, notes, _) = baked_with(&file, &no_files);
    assert!(is_whole(volume) && notes.is_empty(), "{notes:?}");
}

#[test]
fn a_binary_chunk_longer_than_its_buffer() {
    let mut document = tetrahedron();
    document["buffers"] = json!([{ "byteLength": 72 }]);
    let mut bytes = bytes_of(&CORNERS, &FACES);
    bytes.resize(96, 7);
    let (volume, notes, _) = baked_with(&glb(&[(b"JSON", &padded(&document)), (b"BIN\0", &bytes)]), &no_files);
    assert!(is_whole(volume) && notes.is_empty(), "{notes:?}");
}

#[test]
fn files_shorter_than_a_header() {
    for bytes in [&b"glTF"[..], b"glTF\x02\0\0\0", b"{\"hello\": \"123\"}", b"{", b"glTF\x02\0\0\0\x0c\0\0\0"] {
        let problems = read(bytes).expect_err("it is no model");
        assert!(!problems.is_empty() && problems.iter().all(|problem| !problem.remedy.is_empty()), "{bytes:?}");
    }
}

#[test]
fn rotations_that_are_not_unit() {
    let mut document = tetrahedron();
    document["nodes"][0]["rotation"] = json!([0.0, 0.6, 0.0, 1.2]);
    let (volume, notes, _) = baked(&document);
    assert!(is_whole(volume) && notes.iter().any(|note| note.contains("it was normalised")), "{volume} {notes:?}");
}

#[test]
fn a_root_of_two_scenes() {
    let mut document = tetrahedron();
    document["scenes"] = json!([{ "name": "Scene", "nodes": [0] }, { "name": "Scene2", "nodes": [0] }]);
    let (volume, notes, result) = baked(&document);
    assert!(is_whole(volume) && notes.len() == 1 && notes[0].contains("several scenes"), "{notes:?}");
    assert_eq!(result["meshes"].as_array().unwrap().len(), 1);
}

/// A tetrahedron with a picture.
fn painted(image: Value) -> Value {
    let mut document = tetrahedron();
    document["meshes"][0]["primitives"][0]["material"] = json!(0);
    document["materials"] = json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
    document["textures"] = json!([{ "source": 0 }]);
    document["images"] = json!([image]);
    document
}

#[test]
fn a_texture_without_data() {
    let (volume, notes, result) = baked(&painted(json!({ "name": "nothing" })));
    assert!(is_whole(volume) && notes.len() == 1 && notes[0].contains("cannot be read and is left out"), "{notes:?}");
    assert!(result.get("images").is_none() && result.get("textures").is_none(), "{result}");
}

#[test]
fn pictures_under_the_wrong_name() {
    let resolve = |path: &str| if path == "picture.jpg" { Ok(PNG.to_vec()) } else { no_files(path) };
    let (_, notes, result) = baked_with(painted(json!({ "uri": "picture.jpg" })).to_string().as_bytes(), &resolve);
    assert!(notes.is_empty() && result["images"][0]["mimeType"] == "image/png", "{notes:?}");
    for media in [json!("image/jpg"), json!(null)] {
        let mut document = painted(json!({ "bufferView": 2, "mimeType": media }));
        let mut bytes = bytes_of(&CORNERS, &FACES);
        bytes.extend_from_slice(PNG);
        let view = json!({ "buffer": 0, "byteOffset": 72, "byteLength": PNG.len() });
        document["bufferViews"].as_array_mut().unwrap().push(view);
        document["buffers"] = json!([{ "byteLength": bytes.len(), "uri": data_uri(&bytes) }]);
        let (_, notes, result) = baked(&document);
        assert!(notes.is_empty() && result["images"][0]["mimeType"] == "image/png", "{notes:?}");
    }
}

#[test]
fn texture_coordinates_of_another_count() {
    let mut document = tetrahedron();
    let coordinates = json!({ "bufferView": 0, "componentType": 5126, "type": "VEC2", "count": 0 });
    document["accessors"].as_array_mut().unwrap().push(coordinates);
    document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(2);
    let (volume, notes, result) = baked(&document);
    assert!(is_whole(volume) && notes.len() == 1 && notes[0].contains("TEXCOORD_0 of mesh 0"), "{notes:?}");
    assert!(result["meshes"][0]["primitives"][0]["attributes"].get("TEXCOORD_0").is_none());
}
