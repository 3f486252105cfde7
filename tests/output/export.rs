//! Bakes written as `.glb` and read back by an independent, validating reader.

use crate::output::files::encode;
use crate::output::files::{self, FAR, far_from_its_origin, no_files, pile_of, textured_cube, tumbling};
use crate::output::reader::{drawn_matrix, json_of, pose_error, read_valid, world_matrix, world_matrix_of_path};
use cairn_export::Format::{Csv, Glb, Json};
use cairn_export::{ExportError, ExportScene, SourceModel, write};
use glam::{DMat4, DVec3};
use serde_json::{Value, json};
use std::path::Path;

fn prop<'a>(name: &'a str, bytes: &'a [u8], node: Option<&'a str>) -> SourceModel<'a> {
    SourceModel { name, file: "file.gltf", bytes, node, resolve: &no_files, asset: None }
}

#[test]
fn world_matrices_follow_the_poses() {
    let cube = textured_cube();
    let scene = ExportScene { props: vec![prop("cube", &cube, None)], scenery: vec![], ..Default::default() };
    let pile = pile_of(&[(0, 1.0), (0, 0.5), (0, 2.0)], tumbling(3, 50));
    let file = read_valid(&encode(Glb, &pile, &scene).unwrap());
    for frame in [0, 1, 17, 48, 49] {
        for body in 0..3 {
            let found = world_matrix(&file, &format!("cube.{body:04}"), frame as f64 / pile.fps);
            assert!(pose_error(&found, &pile, frame, body) < 1e-6, "frame {frame}, body {body}");
        }
    }
    let pile = file.document.nodes().find(|n| n.name() == Some("pile")).unwrap();
    assert_eq!(pile.children().len(), 3);
    assert_eq!(file.document.default_scene().unwrap().nodes().count(), 1, "no scenery");
    assert_eq!(file.document.meshes().count(), 1, "bodies share their mesh");
}

#[test]
fn a_body_far_from_its_origin_turns_about_its_center() {
    let cube = textured_cube();
    let scene = ExportScene { props: vec![prop("cube", &cube, None)], scenery: vec![], ..Default::default() };
    let pile = far_from_its_origin(4);
    let file = read_valid(&encode(Glb, &pile, &scene).unwrap());
    for moment in [0.0, 1.0, 1.5, 2.25, 3.0] {
        let offset = world_matrix(&file, "cube.0000.offset", moment / pile.fps);
        let center = offset.transform_point3(FAR);
        assert!(center.distance(DVec3::X * moment) < 1e-4, "at frame {moment}: {center}");
    }
    let offset = world_matrix(&file, "cube.0000.offset", 2.0 / pile.fps);
    assert!(pose_error(&offset, &pile, 2, 0) < 1e-4, "at a frame, it is where it was baked");
}

#[test]
fn constant_tracks_are_absent_and_waiting_is_cheap() {
    let cube = textured_cube();
    let scene = ExportScene { props: vec![prop("cube", &cube, None)], scenery: vec![], ..Default::default() };
    let mut frames = tumbling(3, 40);
    for frame in 0..40 {
        frames[frame][0] = frames[0][0]; // never moves
        frames[frame][1].rotation = frames[0][1].rotation; // only slides
        if frame < 30 {
            frames[frame][2] = frames[0][2]; // waits, then falls
        }
    }
    let pile = pile_of(&[(0, 1.0); 3], frames);
    let file = read_valid(&encode(Glb, &pile, &scene).unwrap());
    let animation = file.document.animations().next().unwrap();
    let counts: Vec<(String, usize)> = animation
        .channels()
        .map(|c| (c.target().node().name().unwrap().to_string(), c.sampler().input().count()))
        .collect();
    let expected = [("cube.0001", 40), ("cube.0002", 12), ("cube.0002", 12)];
    assert_eq!(counts, expected.map(|(name, count)| (name.to_string(), count)));
    for frame in [0, 5, 28, 29, 30, 39] {
        for body in 0..3 {
            let found = world_matrix(&file, &format!("cube.{body:04}"), frame as f64 / pile.fps);
            assert!(pose_error(&found, &pile, frame, body) < 1e-6, "frame {frame}, body {body}");
        }
    }
}

#[test]
fn no_frame_and_one_frame_make_a_still() {
    let cube = textured_cube();
    let scene = ExportScene { props: vec![prop("cube", &cube, None)], scenery: vec![], ..Default::default() };
    for frames in [0, 1] {
        let pile = pile_of(&[(0, 1.0), (0, 3.0)], tumbling(2, frames));
        let file = read_valid(&encode(Glb, &pile, &scene).unwrap());
        assert_eq!(file.document.animations().count(), 0);
        assert!(file.document.nodes().any(|n| n.name() == Some("cube.0001")));
        for format in [Json, Csv] {
            encode(format, &pile, &scene).unwrap();
        }
    }
    let empty = pile_of(&[], vec![vec![]; 3]);
    assert_eq!(read_valid(&encode(Glb, &empty, &scene).unwrap()).document.nodes().count(), 1);
}

#[test]
fn embedded_textures_and_material_extensions_survive() {
    let cube = textured_cube();
    let scene = ExportScene { props: vec![prop("cube", &cube, None)], scenery: vec![], ..Default::default() };
    let bytes = encode(Glb, &pile_of(&[(0, 1.0)], tumbling(1, 2)), &scene).unwrap();
    let file = read_valid(&bytes);
    let image = file.document.images().next().unwrap();
    let gltf::image::Source::View { view, mime_type } = image.source() else { panic!("not embedded") };
    assert_eq!(mime_type, "image/png");
    let blob = file.blob.as_ref().unwrap();
    assert_eq!(&blob[view.offset()..view.offset() + view.length()], files::PNG);
    let material = file.document.materials().next().unwrap();
    assert_eq!(material.name(), Some("paint"));
    let json = json_of(&bytes);
    let extension = &json["materials"][0]["extensions"]["KHR_materials_clearcoat"];
    assert_eq!(extension["clearcoatTexture"]["index"], 0);
    assert_eq!(json["extensionsUsed"], json!(["KHR_materials_clearcoat"]));
    assert_eq!(json.get("extensionsRequired"), None);
    assert_eq!(json["asset"]["generator"], concat!("cairn ", env!("CARGO_PKG_VERSION")));
}

#[test]
fn hierarchies_are_rebuilt_below_each_body() {
    let kit = files::kit();
    let scene = ExportScene { props: vec![prop("kit", &kit, None)], scenery: vec![], ..Default::default() };
    let pile = pile_of(&[(0, 1.5), (0, 1.0)], tumbling(2, 3));
    let file = read_valid(&encode(Glb, &pile, &scene).unwrap());
    assert_eq!(file.document.meshes().count(), 1);
    for body in 0..2 {
        let name = format!("kit.{body:04}");
        let place = world_matrix(&file, &name, 0.0);
        for (path, expected) in files::kit_nodes() {
            let found = world_matrix_of_path(&file, &name, path, 0.0);
            assert!((found - place * expected).abs_diff_eq(DMat4::ZERO, 2e-6), "{path:?}");
        }
    }
    assert!(!file.document.nodes().any(|n| n.name() == Some("lamp")), "what carries no mesh is left out");
}

#[test]
fn a_chosen_node_keeps_its_rotation_and_scale_and_loses_its_place() {
    let kit = files::kit();
    let props = vec![prop("mirrored", &kit, Some("Mirrored")), prop("wheel", &kit, Some("Wheel"))];
    let scene = ExportScene { props, scenery: vec![], ..Default::default() };
    let pile = pile_of(&[(0, 1.0), (1, 2.0)], tumbling(2, 3));
    let file = read_valid(&encode(Glb, &pile, &scene).unwrap());
    assert_eq!(file.document.meshes().count(), 1, "two props of one file share what they share");
    for (body, (name, node)) in [("mirrored.0000", "Mirrored"), ("wheel.0001", "Wheel")].iter().enumerate() {
        let mut expected = files::kit_nodes().into_iter().find(|(p, _)| p.last() == Some(node)).unwrap().1;
        expected.w_axis = DVec3::ZERO.extend(1.0);
        let found = drawn_matrix(&file, name, node, 0.0);
        let place = world_matrix(&file, name, 0.0);
        assert!(pose_error(&place, &pile, 0, body) < 1e-6);
        assert!((found - place * expected).abs_diff_eq(DMat4::ZERO, 2e-6), "{node}");
    }
}

#[test]
fn scenery_keeps_its_hierarchy_and_place() {
    let (cube, kit) = (textured_cube(), files::kit());
    let scenery = vec![prop("yard", &kit, None), prop("wheel", &kit, Some("Wheel"))];
    let scene = ExportScene { props: vec![prop("cube", &cube, None)], scenery, ..Default::default() };
    let file = read_valid(&encode(Glb, &pile_of(&[(0, 1.0)], tumbling(1, 3)), &scene).unwrap());
    let tops: Vec<_> = file.document.default_scene().unwrap().nodes().map(|n| n.name().unwrap().to_string()).collect();
    assert_eq!(tops, ["pile", "scenery"]);
    for (path, expected) in files::kit_nodes() {
        let found = world_matrix_of_path(&file, "yard", path, 0.0);
        assert!((found - expected).abs_diff_eq(DMat4::ZERO, 1e-6), "{path:?}");
    }
    let wheel = files::kit_nodes().into_iter().find(|(p, _)| p.last() == Some(&"Wheel")).unwrap().1;
    let found = drawn_matrix(&file, "wheel", "Wheel", 0.0);
    assert!((found - wheel).abs_diff_eq(DMat4::ZERO, 1e-6));
}

#[test]
fn the_same_file_twice_is_stored_once() {
    let cube = textured_cube();
    let copy = cube.clone();
    let single = ExportScene { props: vec![prop("cube", &cube, None)], scenery: vec![], ..Default::default() };
    let double = ExportScene {
        props: vec![prop("cube", &cube, None), prop("copy", &copy, None)],
        scenery: vec![],
        ..Default::default()
    };
    let frames = tumbling(2, 2);
    let one = read_valid(&encode(Glb, &pile_of(&[(0, 1.0), (0, 1.0)], frames.clone()), &single).unwrap());
    let two = read_valid(&encode(Glb, &pile_of(&[(0, 1.0), (1, 1.0)], frames), &double).unwrap());
    assert_eq!(one.blob, two.blob);
    assert!(two.document.nodes().any(|n| n.name() == Some("copy.0001")));
}

#[test]
fn external_buffers_are_embedded_and_missing_images_stay() {
    let (gltf, bin) = files::separate();
    let resolve = |uri: &str| if uri == "cube.bin" { Ok(bin.clone()) } else { Err(format!("{uri} is missing")) };
    let model =
        SourceModel { name: "cube", file: "cube.gltf", bytes: &gltf, node: None, resolve: &resolve, asset: None };
    let scene = ExportScene { props: vec![model], scenery: vec![], ..Default::default() };
    let bytes = encode(Glb, &pile_of(&[(0, 1.0)], tumbling(1, 2)), &scene).unwrap();
    let json = json_of(&bytes);
    assert_eq!(json["buffers"].as_array().unwrap().len(), 1);
    assert_eq!(json["buffers"][0].get("uri"), None);
    assert_eq!(json["images"][0]["uri"], "lost.png");
    read_valid(&bytes);

    let reachable = |uri: &str| Ok(if uri == "cube.bin" { bin.clone() } else { files::PNG.to_vec() });
    let model = SourceModel { resolve: &reachable, ..model };
    let scene = ExportScene { props: vec![model], scenery: vec![], ..Default::default() };
    let bytes = encode(Glb, &pile_of(&[(0, 1.0)], tumbling(1, 2)), &scene).unwrap();
    assert_eq!(json_of(&bytes)["images"][0]["mimeType"], "image/png");
    read_valid(&bytes);
}

/// One of the props that other programs are shown.
fn viewed(name: &str) -> Vec<u8> {
    std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/viewers/props").join(name)).unwrap()
}

#[test]
fn compressed_sources_become_plain() {
    let pile = pile_of(&[(0, 1.0)], tumbling(1, 2));
    let written = |bytes: &[u8]| {
        encode(Glb, &pile, &ExportScene { props: vec![prop("it", bytes, None)], scenery: vec![], ..Default::default() })
    };
    for name in ["draco.gltf", "meshopt.gltf"] {
        let source = viewed(name);
        let result = written(&source).unwrap();
        let file = read_valid(&result);
        let primitive = file.document.meshes().next().unwrap().primitives().next().unwrap();
        let reader = primitive.reader(|_| file.blob.as_deref());
        let mut points: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
        points.sort_by(|a, b| a.partial_cmp(b).unwrap());
        assert_eq!(points, [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]], "{name}");
        assert_eq!(reader.read_indices().unwrap().into_u32().count(), 12);
        assert!(json_of(&result).get("extensionsUsed").is_none(), "{name}");

        let mut broken: Value = serde_json::from_slice(&source).unwrap();
        broken["buffers"][0]["uri"] = json!("data:application/octet-stream;base64,RFJBQ08=");
        assert!(written(broken.to_string().as_bytes()).is_err(), "{name}");
    }
}

#[test]
fn a_scene_can_be_chosen_by_name() {
    let mut source: Value = serde_json::from_slice(&viewed("barrow.gltf")).unwrap();
    let nodes = source["scenes"][0]["nodes"].clone();
    source["scenes"] = json!([{ "nodes": [] }, { "name": "Shelf", "nodes": nodes }]);
    let (source, pile) = (source.to_string(), pile_of(&[(0, 1.0)], tumbling(1, 2)));
    let scene =
        |name| ExportScene { props: vec![prop("it", source.as_bytes(), name)], scenery: vec![], ..Default::default() };
    assert!(encode(Glb, &pile, &scene(Some("Shelf"))).is_ok());
    assert!(encode(Glb, &pile, &scene(Some("Shelves"))).is_err());
    assert!(encode(Glb, &pile, &scene(None)).is_err(), "the default scene is empty");
}

#[test]
fn tables_hold_every_pose() {
    let cube = textured_cube();
    let scene = ExportScene { props: vec![prop("cube", &cube, None)], scenery: vec![], ..Default::default() };
    let pile = pile_of(&[(0, 1.0), (0, 0.5)], tumbling(2, 4));
    let table: Value = serde_json::from_slice(&encode(Json, &pile, &scene).unwrap()).unwrap();
    assert_eq!(table["fps"], 24.0);
    assert_eq!(table["bodies"][1], json!({ "name": "cube.0001", "prop": 0, "scale": 0.5 }));
    assert_eq!(table["frames"][3][1][0].as_f64().unwrap(), pile.frames[3][1].translation.x);

    let bytes = encode(Csv, &pile, &scene).unwrap();
    let mut csv = csv::Reader::from_reader(&bytes[..]);
    let head = "frame,time_s,body,prop,scale,x_m,y_m,z_m,qx,qy,qz,qw";
    assert_eq!(csv.headers().unwrap().iter().collect::<Vec<_>>().join(","), head);
    let rows: Vec<csv::StringRecord> = csv.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 8);
    let last = &rows[7];
    assert_eq!((&last[0], &last[1], &last[2], &last[3], &last[4]), ("3", "0.125", "1", "cube", "0.5"));
    assert_eq!(last[6].parse::<f64>().unwrap(), pile.frames[3][1].translation.y);
}

#[test]
fn writing_is_all_or_nothing() {
    let cube = textured_cube();
    let scene = ExportScene { props: vec![prop("cube", &cube, None)], scenery: vec![], ..Default::default() };
    let pile = pile_of(&[(0, 1.0)], tumbling(1, 2));
    let folder = tempfile::tempdir().unwrap();
    let entries = || std::fs::read_dir(folder.path()).unwrap().count();

    let path = folder.path().join("pile.GLB");
    std::fs::write(&path, "old").unwrap();
    write(&path, &pile, &scene).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), encode(Glb, &pile, &scene).unwrap());
    assert_eq!(entries(), 1);

    let broken =
        ExportScene { props: vec![prop("cube", &cube[..cube.len() - 1], None)], scenery: vec![], ..Default::default() };
    assert!(matches!(write(&path, &pile, &broken), Err(ExportError::Source { .. })));
    assert_eq!(std::fs::read(&path).unwrap(), encode(Glb, &pile, &scene).unwrap(), "the old result stays");
    assert_eq!(entries(), 1);

    assert!(matches!(write(folder.path(), &pile, &scene), Err(ExportError::UnknownFormat(_))));
    std::fs::create_dir(folder.path().join("d.glb")).unwrap();
    assert!(matches!(write(&folder.path().join("d.glb"), &pile, &scene), Err(ExportError::IsDirectory(_))));
    assert!(matches!(write(&folder.path().join("no/pile.glb"), &pile, &scene), Err(ExportError::NoFolder(_))));
    assert!(matches!(write(&folder.path().join("pile"), &pile, &scene), Err(ExportError::UnknownFormat(_))));
    assert_eq!(entries(), 2);
}

#[test]
fn hostile_sources_are_errors() {
    let pile = pile_of(&[(0, 1.0)], tumbling(1, 2));
    let good = files::kit_json();
    let refuse = |json: Value| {
        let bytes = json.to_string().into_bytes();
        let scene = ExportScene { props: vec![prop("bad", &bytes, None)], scenery: vec![], ..Default::default() };
        assert!(matches!(encode(Glb, &pile, &scene), Err(ExportError::Source { .. })), "{json}");
    };
    for (pointer, value) in [
        ("/nodes/0/children", json!([0])),
        ("/nodes/0/children", json!([1, 1])),
        ("/nodes/1/mesh", json!(9)),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(u64::MAX)),
        ("/meshes/0/primitives/0", json!(1)),
        ("/meshes/0/primitives", json!(null)),
        ("/accessors/0/bufferView", json!(77)),
        ("/bufferViews/0/buffer", json!(3)),
        ("/bufferViews/1/byteOffset", json!(u64::MAX)),
        ("/bufferViews/0/byteLength", json!(1u64 << 62)),
        ("/buffers/0/uri", json!("data:;base64,A*")),
        ("/buffers/0/uri", json!("away.bin")),
    ] {
        let mut json = good.clone();
        *json.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer}")) = value;
        refuse(json);
    }
    for bytes in [&b""[..], b"glTF", b"glTF\x02\0\0\0\xff\xff\xff\xff", b"[]", b"{\"nodes\": 3"] {
        let scene = ExportScene { props: vec![prop("bad", bytes, None)], scenery: vec![], ..Default::default() };
        assert!(matches!(encode(Glb, &pile, &scene), Err(ExportError::Source { .. })), "{bytes:?}");
    }
}
