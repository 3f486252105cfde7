//! Files that are read, and the meshes that they give.

use glam::{DMat3, DVec3};
use serde_json::json;

use super::model::{CORNERS, FACES, Model, glb, messages, read, read_with, tetrahedron};
use crate::asset::{Asset, Limits};
use cairn_geometry::topology::inspect;

fn mesh_of(model: &Model) -> Asset {
    model.read().unwrap_or_else(|problems| panic!("{problems:#?}"))
}

fn assert_tetrahedron(asset: &Asset, volume: f64) {
    let found = inspect(&asset.mesh);
    assert!(found.is_watertight() && found.triangles == 4, "{found:?}");
    assert!((found.signed_volume - volume).abs() < 1e-9 * volume, "{found:?}");
}

#[test]
fn a_file_in_each_container_is_the_same() {
    let model = tetrahedron();
    let plain = mesh_of(&model);
    assert_tetrahedron(&plain, 1.0 / 6.0);
    assert_eq!(plain.mesh.points.len(), 4);
    assert_eq!((plain.linear, plain.root, plain.degenerate), (DMat3::IDENTITY, None, 0));
    assert!(plain.notes.is_empty(), "{:?}", plain.notes);
    assert_eq!(read(&model.embedded()).as_ref(), Ok(&plain));

    let external = model.clone().set("/buffers/0/uri", json!("./sub/my%20thing.bin")).json.to_string();
    let resolve = |path: &str| if path == "sub/my thing.bin" { Ok(model.bin.clone()) } else { Err(path.to_owned()) };
    assert_eq!(read_with(external.as_bytes(), None, &resolve, Limits::default()).as_ref(), Ok(&plain));

    // What other writers get wrong without harm: marks, padding, alignment, trailing bytes, unknown chunks.
    let marked = [b"\xef\xbb\xbf \n".as_slice(), &model.embedded()].concat();
    assert_eq!(read(&marked).as_ref(), Ok(&plain));
    let text = [model.json.to_string().as_bytes(), b"\0"].concat();
    let mut odd = glb(&[(b"JSON", &text), (b"XTRA", b"?"), (b"BIN\0", &model.bin), (b"BIN\0", b"more")]);
    odd.extend(b"trailing");
    assert_eq!(read(&odd).as_ref(), Ok(&plain));
    let longer = Model { bin: [model.bin.as_slice(), b"pad"].concat(), ..model };
    assert_eq!(longer.read().as_ref(), Ok(&plain));
}

#[test]
fn triangles_that_are_there_very_often() {
    let plain = tetrahedron();
    let one = plain.json["meshes"][0]["primitives"][0].clone();
    let repeated = |times: usize| mesh_of(&plain.clone().set("/meshes/0/primitives", json!(vec![one.clone(); times])));
    assert_eq!(repeated(10_001).mesh, mesh_of(&plain).mesh);
    let even = repeated(10_000);
    assert_eq!((even.mesh.triangles.len(), repeated(2).mesh.triangles.len()), (8, 8));
    assert!(even.notes[0].contains("more than twice, facing the same way, are left out"), "{:?}", even.notes);
    assert!(repeated(2).notes.is_empty());
}

#[test]
fn every_index_format_and_none() {
    let plain = mesh_of(&tetrahedron());
    for (code, size) in [(5121, 1), (5123, 2), (5125, 4)] {
        let mut model = tetrahedron();
        let bytes: Vec<u8> = FACES.iter().flat_map(|&i| u32::from(i).to_le_bytes()[..size].to_vec()).collect();
        let view = model.add_view(&bytes);
        let model = model.set("/accessors/1/bufferView", json!(view)).set("/accessors/1/componentType", json!(code));
        assert_eq!(mesh_of(&model).mesh, plain.mesh);
    }
    let mut model = tetrahedron();
    let bytes: Vec<u8> = FACES.iter().flat_map(|&i| CORNERS[usize::from(i)]).flat_map(f32::to_le_bytes).collect();
    let view = model.add_view(&bytes);
    let mut model = model.set("/accessors/0/bufferView", json!(view)).set("/accessors/0/count", json!(12));
    model.json["meshes"][0]["primitives"][0].as_object_mut().expect("an object").remove("indices");
    assert_eq!(mesh_of(&model).mesh, plain.mesh);
}

#[test]
fn interleaved_vertices_and_offsets() {
    let mut model = tetrahedron();
    let bytes: Vec<u8> = CORNERS.iter().flat_map(|c| [7.0, c[0], c[1], c[2], 7.0]).flat_map(f32::to_le_bytes).collect();
    let view = model.add_view(&bytes);
    let model = model
        .set(&format!("/bufferViews/{view}/byteStride"), json!(20))
        .set("/accessors/0/bufferView", json!(view))
        .set("/accessors/0/byteOffset", json!(4));
    assert_eq!(mesh_of(&model).mesh, mesh_of(&tetrahedron()).mesh);
}

/// A primitive of the four corners with these indices, as triangles of corners.
fn drawn(mode: u8, indices: &[u8]) -> Asset {
    let mut model = tetrahedron();
    let view = model.add_view(indices);
    let accessor = json!({ "bufferView": view, "componentType": 5121, "count": indices.len(), "type": "SCALAR" });
    mesh_of(&model.set("/accessors/1", accessor).set("/meshes/0/primitives/0/mode", json!(mode)))
}

fn by_corner(asset: &Asset) -> Vec<[DVec3; 3]> {
    (0..asset.mesh.triangles.len()).map(|i| asset.mesh.corners(i)).collect()
}

#[test]
fn strips_and_fans() {
    assert_eq!(by_corner(&drawn(5, &[0, 1, 2, 3])), by_corner(&drawn(4, &[0, 1, 2, 1, 3, 2])));
    assert_eq!(by_corner(&drawn(6, &[0, 1, 2, 3])), by_corner(&drawn(4, &[1, 2, 0, 2, 3, 0])));
    // A closed surface from one strip faces outward throughout.
    assert_tetrahedron(&drawn(5, &[0, 2, 1, 3, 0, 2]), 1.0 / 6.0);
}

#[test]
fn the_largest_index_begins_a_new_strip() {
    let asset = drawn(5, &[0, 1, 2, 255, 3, 2, 1, 0]);
    assert_eq!(by_corner(&asset), by_corner(&drawn(4, &[0, 1, 2, 3, 2, 1, 2, 0, 1])));
    assert!(asset.notes[0].contains("begins a new strip"), "{:?}", asset.notes);
}

#[test]
fn leftover_corners_are_told() {
    let asset = drawn(4, &[0, 1, 2, 3, 1]);
    assert_eq!(asset.mesh.triangles.len(), 1);
    assert_eq!(asset.mesh.points.len(), 3, "unused points are not kept");
    assert!(asset.notes[0].contains("multiple of three"), "{:?}", asset.notes);
}

#[test]
fn points_and_lines_are_left_out_with_a_note() {
    let lines = json!({ "attributes": { "POSITION": 0 }, "mode": 1 });
    let asset = mesh_of(&tetrahedron().set("/meshes/0/primitives/1", lines));
    assert_eq!(asset.mesh, mesh_of(&tetrahedron()).mesh);
    assert_eq!(asset.notes, ["node `Brick`, mesh 0, primitive 1: points and lines are left out"]);
    let alone = tetrahedron().set("/meshes/0/primitives/0/mode", json!(0));
    assert!(messages(alone.read()).contains("it holds no triangles: only points and lines"));
}

#[test]
fn transforms_multiply_down_the_hierarchy() {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let model = tetrahedron().set(
        "/nodes",
        json!([
            { "name": "Top", "translation": [10.0, 0.0, 0.0], "scale": [2.0, 2.0, 2.0], "children": [1] },
            { "name": "Middle", "rotation": [0.0, 0.0, half, half], "children": [2] },
            { "name": "Brick", "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1], "mesh": 0 }
        ]),
    );
    let asset = mesh_of(&model);
    assert_tetrahedron(&asset, 8.0 / 6.0);
    // The corner (1, 0, 0) moves by 5 along x, turns to y, doubles, and moves by 10 along x.
    assert!(asset.mesh.points.iter().any(|p| p.distance(DVec3::new(10.0, 12.0, 0.0)) < 1e-12), "{asset:?}");

    // The chosen node's frame: its own origin, the world's axes.
    let brick = model.read_node("Brick").expect("it is there");
    assert_eq!(brick.root, Some(2));
    assert!(brick.mesh.points.iter().any(|p| p.distance(DVec3::new(0.0, 2.0, 0.0)) < 1e-12), "{brick:?}");
    assert!((brick.linear * DVec3::X).distance(DVec3::new(0.0, 2.0, 0.0)) < 1e-12);
    let middle = model.read_node("Middle").expect("it is there");
    assert!(middle.mesh.points.iter().any(|p| p.distance(DVec3::new(0.0, 12.0, 0.0)) < 1e-12), "{middle:?}");
}

#[test]
fn a_chosen_node_comes_with_what_is_below_and_nothing_else() {
    let model = tetrahedron().set(
        "/nodes",
        json!([
            { "name": "Kit", "children": [1, 3] },
            { "name": "Cart", "mesh": 0, "children": [2], "translation": [0.0, 100.0, 0.0] },
            { "name": "Wheel", "mesh": 0, "translation": [3.0, 0.0, 0.0] },
            { "name": "Other", "mesh": 0 }
        ]),
    );
    let cart = model.read_node("Cart").expect("it is there");
    assert_eq!(cart.mesh.triangles.len(), 8);
    assert_eq!(cart.mesh.bounds(), (DVec3::ZERO, DVec3::new(4.0, 1.0, 1.0)));
    // Nodes outside of the scene can be chosen too.
    let apart = model.set("/scenes/0/nodes", json!([]));
    assert_eq!(apart.read_node("Wheel").expect("it is there").mesh.triangles.len(), 4);
}

#[test]
fn mirrored_and_sheared_nodes_stay_outward() {
    let mirrored = tetrahedron().set("/nodes/0/scale", json!([-1.0, 2.0, 1.0]));
    assert_tetrahedron(&mesh_of(&mirrored), 2.0 / 6.0);
    let sheared = json!([1, 0, 0, 0, 3, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
    let sheared = tetrahedron().set("/nodes/0/matrix", sheared);
    assert_tetrahedron(&mesh_of(&sheared), 1.0 / 6.0);
    let asset = sheared.read_node("Brick").expect("it is there");
    assert_eq!(asset.linear * DVec3::Y, DVec3::new(3.0, 1.0, 0.0));
}

#[test]
fn scenes() {
    let two = json!([{ "mesh": 0 }, { "mesh": 0, "translation": [5, 0, 0] }]);
    let model = tetrahedron().set("/nodes", two).set("/scenes", json!([{ "nodes": [0] }, { "nodes": [0, 1] }]));
    let asset = mesh_of(&model);
    assert_eq!(asset.mesh.triangles.len(), 4);
    assert!(asset.notes[0].contains("several scenes"), "{:?}", asset.notes);
    assert_eq!(mesh_of(&model.clone().set("/scene", json!(1))).mesh.triangles.len(), 8);

    // By name, where no node has it.
    let named = model.clone().set("/scenes/1/name", json!("Shelf"));
    let asset = named.read_node("Shelf").expect("the scene is there");
    assert_eq!((asset.mesh.triangles.len(), asset.root), (8, None));
    assert!(asset.notes.is_empty(), "{:?}", asset.notes);
    let both = named.set("/nodes/0/name", json!("Shelf"));
    assert_eq!(both.read_node("Shelf").expect("the node is there").root, Some(0));

    let mut bare = model;
    bare.json.as_object_mut().expect("an object").retain(|key, _| key != "scene" && key != "scenes");
    let asset = mesh_of(&bare);
    assert_eq!(asset.mesh.triangles.len(), 8);
    assert!(asset.notes[0].contains("no scene"), "{:?}", asset.notes);
}

#[test]
fn a_node_that_is_root_and_child_counts_once_below_its_parent() {
    let nodes = json!([{ "translation": [5, 0, 0], "children": [1] }, { "mesh": 0 }]);
    for roots in [json!([0, 1]), json!([1, 0]), json!([1, 1, 0, 0])] {
        let asset = mesh_of(&tetrahedron().set("/nodes", nodes.clone()).set("/scenes/0/nodes", roots));
        assert_eq!(asset.mesh.triangles.len(), 4);
        assert_eq!(asset.mesh.bounds().0.x, 5.0);
    }
}

#[test]
fn a_long_chain_of_nodes_is_no_trouble() {
    let count = 100_000;
    let mut nodes: Vec<_> = (0..count).map(|i| json!({ "children": [i + 1], "translation": [0.001, 0, 0] })).collect();
    nodes.push(json!({ "name": "End", "mesh": 0 }));
    let model = tetrahedron().set("/nodes", json!(nodes));
    // Every node as a root besides, deepest first.
    let model = model.set("/scenes/0/nodes", json!((0..=count).rev().collect::<Vec<_>>()));
    let asset = mesh_of(&model);
    assert_eq!(asset.mesh.triangles.len(), 4);
    assert!((asset.mesh.bounds().0.x - 100.0).abs() < 1e-6);
    assert_eq!(model.read_node("End").expect("it is there").mesh.bounds().0.x, 0.0);
}

#[test]
fn one_mesh_shown_often() {
    let nodes: Vec<_> = (0..10).map(|i| json!({ "mesh": 0, "translation": [2 * i, 0, 0] })).collect();
    let model = tetrahedron().set("/nodes", json!(nodes)).set("/scenes/0/nodes", json!((0..10).collect::<Vec<_>>()));
    let found = inspect(&mesh_of(&model).mesh);
    assert!(found.components == 10 && found.is_watertight() && found.triangles == 40, "{found:?}");
    // Two that touch in a face share its points: welding knows no nodes.
    let touching = json!([{ "mesh": 0 }, { "mesh": 0, "scale": [-1, 1, 1] }]);
    let touching = tetrahedron().set("/nodes", touching).set("/scenes/0/nodes", json!([0, 1]));
    assert_eq!(mesh_of(&touching).mesh.points.len(), 5);
}

#[test]
fn gpu_instances() {
    let mut model = tetrahedron();
    let floats = |x: &[f32]| x.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let moves = model.add_view(&floats(&[0.0, 0.0, 0.0, 5.0, 0.0, 0.0]));
    let turns = model.add_view(&[0, 0, 0, 127, 0, 0, 127, 0]);
    let attributes = json!({ "TRANSLATION": 2, "ROTATION": 3 });
    let model = model
        .set("/accessors/2", json!({ "bufferView": moves, "componentType": 5126, "count": 2, "type": "VEC3" }))
        .set("/accessors/3", json!({ "bufferView": turns, "componentType": 5120, "count": 2, "type": "VEC4" }))
        .set("/nodes/0/extensions", json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } }))
        .set("/extensionsRequired", json!(["EXT_mesh_gpu_instancing"]));
    let asset = mesh_of(&model);
    assert_eq!(asset.mesh.triangles.len(), 8);
    // The second one is turned by half a turn around z.
    assert_eq!(asset.mesh.bounds(), (DVec3::new(0.0, -1.0, 0.0), DVec3::new(5.0, 1.0, 1.0)));
}

#[test]
fn sparse_accessors_and_accessors_without_a_view() {
    let mut model = tetrahedron();
    let places = model.add_view(&[1, 2, 3]);
    let values: Vec<u8> = CORNERS[1..].iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    let values = model.add_view(&values);
    let sparse = json!({
        "count": 3,
        "indices": { "bufferView": places, "componentType": 5121 },
        "values": { "bufferView": values }
    });
    let zeros = json!({ "componentType": 5126, "count": 4, "type": "VEC3", "sparse": sparse.clone() });
    assert_eq!(mesh_of(&model.clone().set("/accessors/0", zeros)).mesh, mesh_of(&tetrahedron()).mesh);
    assert_eq!(mesh_of(&model.set("/accessors/0/sparse", sparse)).mesh, mesh_of(&tetrahedron()).mesh);
}

#[test]
fn quantized_positions() {
    let mut model = tetrahedron();
    let bytes: Vec<u8> = CORNERS.iter().flat_map(|c| c.map(|x| x as i16 * 32767)).flat_map(i16::to_le_bytes).collect();
    let view = model.add_view(&bytes);
    let accessor = json!({ "bufferView": view, "componentType": 5122, "count": 4, "type": "VEC3", "normalized": true });
    let model = model.set("/accessors/0", accessor).set("/extensionsRequired", json!(["KHR_mesh_quantization"]));
    assert_eq!(mesh_of(&model).mesh, mesh_of(&tetrahedron()).mesh);
    let whole = model.set("/accessors/0/normalized", json!(false)).set("/nodes/0/scale", json!([1e-3, 1e-3, 1e-3]));
    assert_tetrahedron(&mesh_of(&whole), 32.767f64.powi(3) / 6.0);
}

#[test]
fn extensions_that_leave_geometry_alone_do_not_matter() {
    let required = json!(["KHR_materials_unlit", "KHR_texture_basisu", "FAKE_materials_glow", "ACME_elsewhere"]);
    let asset = mesh_of(&tetrahedron().set("/extensionsRequired", required));
    assert_eq!(asset.mesh, mesh_of(&tetrahedron()).mesh);
    assert_eq!(asset.notes.len(), 1);
    assert!(asset.notes[0].contains("nothing with geometry uses it"));
    // Compressed, with a plain copy beside it.
    let draco = json!({ "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": { "POSITION": 0 } } });
    let both = tetrahedron().set("/meshes/0/primitives/0/extensions", draco);
    assert_eq!(mesh_of(&both).mesh, mesh_of(&tetrahedron()).mesh);
}

#[test]
fn faults_outside_of_geometry_do_not_matter() {
    let mut model = tetrahedron()
        .set("/images", json!([{ "uri": "../../missing.png" }, 7]))
        .set("/textures", json!("none"))
        .set("/materials", json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 99 } } }]))
        .set("/animations", json!([{ "channels": 3 }]))
        .set("/meshes/0/primitives/0/material", json!(12))
        .set("/buffers/1", json!({ "uri": "/etc/passwd", "byteLength": 1u64 << 62 }))
        .set("/bufferViews/2", json!({ "buffer": 1, "byteLength": "many" }))
        .set("/accessors/2", json!({ "bufferView": 99, "count": -5 }));
    model.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(2);
    assert_eq!(mesh_of(&model).mesh, mesh_of(&tetrahedron()).mesh);
}

#[test]
fn members_that_geometry_does_not_need_may_be_anything() {
    let mut model = tetrahedron()
        .set("/scenes/0/name", json!([]))
        .set("/nodes/0/name", json!(5))
        .set("/nodes/0/camera", json!("x"))
        .set("/nodes/0/weights", json!("x"))
        .set("/meshes/0/weights", json!({}))
        .set("/meshes/0/name", json!(null))
        .set("/meshes/0/primitives/0/material", json!(-1))
        .set("/accessors/0/min", json!("low"))
        .set("/accessors/0/name", json!(7))
        .set("/accessors/0/normalized", json!("yes"))
        .set("/bufferViews/0/target", json!("x"))
        .set("/buffers/0/name", json!(7));
    model.json["meshes"][0]["primitives"][0]["attributes"]["_OWN"] = json!("x");
    assert_eq!(mesh_of(&model).mesh, mesh_of(&tetrahedron()).mesh);
    // Numbers that JSON cannot hold, and any depth.
    let extras = format!("{}1e999{}", "[".repeat(1000), "]".repeat(1000));
    let model = model.set("/meshes/0/primitives/0/extras", json!("X")).set("/accessors/0/max", json!("X"));
    let json = model.json.to_string().replace("\"X\"", &extras);
    let asset = read(&glb(&[(b"JSON", json.as_bytes()), (b"BIN\0", &model.bin)])).expect("it is read");
    assert_eq!(asset.mesh, mesh_of(&tetrahedron()).mesh);
}

#[test]
fn whole_reals_are_integers() {
    let model = tetrahedron()
        .set("/scene", json!(0.0))
        .set("/scenes/0/nodes/0", json!(0.0))
        .set("/nodes/0/mesh", json!(0.0))
        .set("/meshes/0/primitives/0/indices", json!(1.0))
        .set("/meshes/0/primitives/0/mode", json!(4.0))
        .set("/accessors/1/componentType", json!(5123.0))
        .set("/accessors/1/count", json!(12.0))
        .set("/bufferViews/1/byteOffset", json!(48.0));
    assert_eq!(mesh_of(&model).mesh, mesh_of(&tetrahedron()).mesh);
}

#[test]
fn skins_and_morph_targets_are_told() {
    let model = tetrahedron().set("/nodes/0/skin", json!(0)).set("/meshes/0/primitives/0/targets", json!([{}]));
    let notes = mesh_of(&model).notes.join("\n");
    assert!(notes.contains("skin is not applied") && notes.contains("morph targets are not applied"), "{notes}");
}

#[test]
fn triangles_of_no_area_go_but_the_surface_stays_closed() {
    // A corner twice.
    let asset = drawn(4, &[0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3, 1, 1, 3]);
    assert_tetrahedron(&asset, 1.0 / 6.0);
    assert_eq!(asset.degenerate, 1);
    assert_eq!(asset.notes, ["1 of 5: triangles of no area are left out"]);
    // One with its corners on a line fills the gap that point 4, amid an edge, would leave.
    let mut model = tetrahedron();
    let middle: Vec<u8> = [0.5f32, 0.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let points = [&model.bin[..48], &middle].concat();
    let (points, faces) =
        (model.add_view(&points), model.add_view(&[0, 2, 4, 4, 2, 1, 0, 4, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]));
    let model = model
        .set("/accessors/0", json!({ "bufferView": points, "componentType": 5126, "count": 5, "type": "VEC3" }))
        .set("/accessors/1", json!({ "bufferView": faces, "componentType": 5121, "count": 18, "type": "SCALAR" }));
    let asset = mesh_of(&model);
    let found = inspect(&asset.mesh);
    assert!(found.is_watertight() && found.triangles == 6 && asset.degenerate == 0, "{found:?} {:?}", asset.notes);
    assert!((0..6).all(|i| {
        let [a, b, c] = asset.mesh.corners(i);
        (b - a).cross(c - a).length() > 0.1
    }));
}
