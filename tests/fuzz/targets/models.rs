//! Any bytes as a glTF file, and any mesh as a prop.

use super::{contents, root};
use cairn_engine::shape;
use cairn_geometry::mesh::TriMesh;
use cairn_gltf::Document;
use cairn_input::asset::{self, Limits, ProblemKind, Source};
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, Params};
use cairn_input::scene::{Model, Prop, Scene};
use cairn_prepare::check;
use glam::DVec3;

/// What a small file may cost: far less than what a large one may.
const LIMITS: Limits = Limits { bytes: 16 << 20, triangles: 20_000, nodes: 2_000 };

/// glTF -> mesh, and the other reader, which exports and renders.
pub fn reading(bytes: &[u8]) {
    // A file beside it, for those that name one.
    let beside =
        |path: &str| if path.len().is_multiple_of(2) { Ok(bytes.to_vec()) } else { Err("no such file".to_owned()) };
    for node in [None, Some("Brick")] {
        let source = Source { name: "model.glb", bytes, node, resolve: &beside, limits: LIMITS };
        match asset::read(&source) {
            Ok(asset) => assert_mesh(&asset.mesh),
            Err(problems) => {
                assert!(!problems.is_empty(), "it is refused, and nothing is reported");
                for problem in problems {
                    assert!(!matches!(problem.what, ProblemKind::Internal { .. }), "{problem}");
                }
            }
        }
    }
    if let Ok(document) = Document::open(bytes, &|path: &str| beside(path)) {
        let _ = document.part("Brick");
        document.roots();
        document.parents();
    }
}

/// What the reader promises.
fn assert_mesh(mesh: &TriMesh) {
    assert!(!mesh.triangles.is_empty(), "at least one triangle");
    assert!(mesh.points.iter().all(|point| point.is_finite()), "finite points");
    let mut used = vec![false; mesh.points.len()];
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|corner| corner as usize);
        assert!(a != b && b != c && c != a, "no two equal corners");
        [a, b, c].into_iter().for_each(|corner| used[corner] = true);
    }
    assert!(used.iter().all(|used| *used), "every point is used");
}

/// Our own small files, and those of a collection, if there is one.
pub fn seeds() -> Vec<Vec<u8>> {
    let mut folders: Vec<_> = ["examples/assets", "tests"].map(|folder| root().join(folder)).into();
    if std::env::var_os("CAIRN_FUZZ_ALL").is_some() {
        let collection = std::env::var_os("CAIRN_COLLECTION").map_or_else(|| root().join("../shared/data"), Into::into);
        folders.extend(["invalid", "reader"].map(|name| collection.join(name)));
    }
    let mut seeds: Vec<Vec<u8>> = folders.iter().flat_map(|folder| contents(folder, &[".glb", ".gltf"])).collect();
    seeds.extend([tetrahedron(1.0), tetrahedron(1e-30), b"glTF\x02\0\0\0".to_vec(), b"{}".to_vec()]);
    seeds
}

/// A `.gltf` with its data inside.
fn tetrahedron(size: f32) -> Vec<u8> {
    use base64::Engine;
    let corners = [[0.0, 0.0, 0.0], [size, 0.0, 0.0], [0.0, size, 0.0], [0.0, 0.0, size]];
    let mut data: Vec<u8> = corners.iter().flatten().flat_map(|x: &f32| x.to_le_bytes()).collect();
    data.extend([0_u16, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3].iter().flat_map(|corner| corner.to_le_bytes()));
    let uri = format!("data:;base64,{}", base64::engine::general_purpose::STANDARD.encode(&data));
    let document = serde_json::json!({
        "asset": { "version": "2.0" },
        "nodes": [{ "mesh": 0, "name": "Brick", "scale": [1, 2, 1] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR" }
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 24 }
        ],
        "buffers": [{ "byteLength": 72, "uri": uri }]
    });
    document.to_string().into_bytes()
}

/// A mesh -> the shape of a prop. First byte: how its points are written; second: their number. Then the points, and
/// all that is left as corners of triangles.
pub fn shape(bytes: &[u8]) {
    /// A shape of more takes too long to try many.
    const MOST_POINTS: usize = 24;
    const MOST_TRIANGLES: usize = 40;
    let [form, points, rest @ ..] = bytes else { return };
    let count = usize::from(*points) % MOST_POINTS + 1;
    let width = if form % 2 == 0 { 3 } else { 12 };
    if rest.len() < count * width {
        return;
    }
    let (points, corners) = rest.split_at(count * width);
    let scale = 10f64.powi(i32::from(form / 2 % 8) - 4);
    let point = |bytes: &[u8]| match width {
        3 => DVec3::from_array([0, 1, 2].map(|i| f64::from(bytes[i] as i8) / 16.0 * scale)),
        _ => DVec3::from_array([0, 4, 8].map(|i| f64::from(f32::from_le_bytes(bytes[i..i + 4].try_into().unwrap())))),
    };
    let points: Vec<DVec3> = points.chunks_exact(width).map(point).collect();
    let corner = |byte: &u8| u32::from(*byte) % count as u32;
    let triangles = corners.chunks_exact(3).take(MOST_TRIANGLES).map(|each| [0, 1, 2].map(|i| corner(&each[i])));
    let Some(mesh) = read(&points, &triangles.collect::<Vec<_>>()) else { return };
    let prop = Prop::new(Model::new("prop", mesh));
    let scene = Scene { control: Some(Model::new("control", cube())), props: vec![prop], ..Scene::default() };
    let params = Params::new(Accuracy::Draft);
    let checked = match check::run(&scene, &params) {
        Ok(checked) => checked,
        Err(problems) => {
            assert!(!problems.is_empty(), "it is refused, and nothing is reported");
            return;
        }
    };
    match shape::run(&scene, &params, &checked.sizes, &mut Silent) {
        Ok(shapes) => {
            let shape = &shapes[0];
            assert!(shape.mass > 0.0 && shape.mass.is_finite(), "mass {}", shape.mass);
            assert!(shape.center.is_finite() && shape.radius > 0.0 && shape.radius.is_finite(), "{shape:?}");
            let (inertia, frame) = shape.inertia;
            assert!(inertia.is_finite() && inertia.min_element() > 0.0 && frame.is_finite(), "{shape:?}");
            assert!(shape.solid.parts() > 0 && shape.report.deviation_rel.is_finite(), "{shape:?}");
        }
        Err(cairn_core::Error::Invalid(problems)) => assert!(!problems.is_empty()),
        Err(error) => panic!("{error}"),
    }
}

/// The mesh, as a file that held it would be read.
fn read(points: &[DVec3], triangles: &[[u32; 3]]) -> Option<TriMesh> {
    let glb = glb(points, triangles);
    let source = Source { name: "prop", bytes: &glb, node: None, resolve: &|_| Err("none".into()), limits: LIMITS };
    let asset = asset::read(&source).ok()?;
    assert_mesh(&asset.mesh);
    Some(asset.mesh)
}

fn glb(points: &[DVec3], triangles: &[[u32; 3]]) -> Vec<u8> {
    let mut data: Vec<u8> = points.iter().flat_map(|p| p.as_vec3().to_array()).flat_map(f32::to_le_bytes).collect();
    data.extend(triangles.iter().flatten().flat_map(|corner| corner.to_le_bytes()));
    let document = serde_json::json!({
        "asset": { "version": "2.0" },
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": points.len(), "type": "VEC3" },
            { "bufferView": 1, "componentType": 5125, "count": 3 * triangles.len(), "type": "SCALAR" }
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 12 * points.len() },
            { "buffer": 0, "byteOffset": 12 * points.len(), "byteLength": 12 * triangles.len() }
        ],
        "buffers": [{ "byteLength": data.len() }]
    });
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let word = |n: usize| (n as u32).to_le_bytes();
    let (all, json, bin) = (word(28 + text.len() + data.len()), word(text.len()), word(data.len()));
    [b"glTF\x02\0\0\0", &all[..], &json, b"JSON", &text, &bin, b"BIN\0", &data].concat()
}

const CUBE: [[u32; 3]; 12] = [
    [0, 1, 3],
    [0, 3, 2],
    [4, 6, 7],
    [4, 7, 5],
    [0, 4, 5],
    [0, 5, 1],
    [2, 3, 7],
    [2, 7, 6],
    [0, 2, 6],
    [0, 6, 4],
    [1, 5, 7],
    [1, 7, 3],
];

/// 100 km: any prop fits.
fn cube() -> TriMesh {
    let points = (0..8).map(|i| DVec3::new(f64::from(i >> 2), f64::from(i >> 1 & 1), f64::from(i & 1)) * 1e5);
    TriMesh { points: points.collect(), triangles: CUBE.to_vec() }.outward().into_owned()
}

pub fn shape_seeds() -> Vec<Vec<u8>> {
    let corners: Vec<u8> = CUBE.iter().flatten().map(|&corner| corner as u8).collect();
    let cube = |form: u8, x: u8, y: u8, z: u8| {
        let points = (0..8_u8).flat_map(|i| [x * (i >> 2), y * (i >> 1 & 1), z * (i & 1)]);
        [form, 7].into_iter().chain(points).chain(corners.clone()).collect()
    };
    let tetrahedron = vec![8, 3, 0, 0, 0, 16, 0, 0, 0, 16, 0, 0, 0, 16, 0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];
    let sheet = vec![8, 2, 0, 0, 0, 16, 0, 0, 0, 16, 0, 0, 1, 2];
    vec![cube(8, 16, 16, 16), cube(8, 100, 1, 1), cube(6, 90, 90, 1), cube(8, 16, 0, 16), tetrahedron, sheet]
}
