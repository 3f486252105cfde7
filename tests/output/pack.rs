//! A pack: meshes, colliders, instances, skeleton and textures of a result.

use crate::output::files::{encode, no_files, pile_of, textured_cube, tumbling};
use cairn_core::report::bake::BakedPile;
use cairn_export::pack::{Manifest, PackError, PackOptions, PackedFile, pack};
use cairn_export::{ExportScene, Format, SourceModel};
use cairn_geometry::pose::Pose;
use cairn_gltf::Document;
use cairn_gltf::document::references;
use cairn_render::RenderModel;
use exr::prelude::{ReadChannels, ReadLayers, read};
use glam::{DAffine3, DMat4, DQuat, DVec3};
use serde_json::Value;

fn asset(name: &str) -> Vec<u8> {
    std::fs::read(format!("{}/examples/assets/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

fn result(prop: &[u8], pile: &BakedPile) -> Vec<u8> {
    result_as(Format::Glb, prop, pile)
}

fn result_as(format: Format, prop: &[u8], pile: &BakedPile) -> Vec<u8> {
    let prop = SourceModel { name: "prop", file: "prop", bytes: prop, node: None, resolve: &no_files, asset: None };
    encode(format, pile, &ExportScene { props: vec![prop], ..Default::default() }).unwrap()
}

fn packed(result: &[u8], options: &PackOptions) -> Result<Manifest, PackError> {
    let model = RenderModel { name: "pile.glb", bytes: result, resolve: &no_files };
    Ok(pack(&model, options, &mut || true)?.expect("nobody ends it"))
}

fn file<'a>(manifest: &'a Manifest, name: &str) -> &'a PackedFile {
    manifest.files.iter().find(|file| file.file == name).unwrap_or_else(|| panic!("{name}"))
}

fn document(file: &PackedFile) -> Document<'_> {
    Document::open(&file.content, &no_files).unwrap()
}

/// The edge of the cube of the assets, m.
fn edge(cube: &[u8]) -> f64 {
    let cube = Document::open(cube, &no_files).unwrap();
    let primitive = cube.primitives(0).unwrap().next().unwrap();
    let position = primitive["attributes"]["POSITION"].as_u64().unwrap() as usize;
    let [low, high] = cube.bounds::<3>(position).unwrap().unwrap();
    high[0] - low[0]
}

/// A cube of so many cubes along each edge, which touch.
fn block(count: usize, edge: f64) -> BakedPile {
    let at = |i: usize| DVec3::new((i % count) as f64, (i / count % count) as f64, (i / count / count) as f64) * edge;
    let pose = |i: usize| Pose { translation: at(i), rotation: DQuat::IDENTITY };
    pile_of(&vec![(0, 1.0); count.pow(3)], vec![(0..count.pow(3)).map(pose).collect()])
}

#[test]
fn what_nobody_sees_is_removed_and_the_silhouette_stays() {
    let cube = asset("cube.glb");
    let manifest = packed(&result(&cube, &block(5, edge(&cube))), &PackOptions::default()).unwrap();
    let [level] = &manifest.levels[..] else { panic!("a cube has nothing to lose: {:?}", manifest.levels) };
    // Of 125 cubes, 25 show a face on each side.
    let (seen, all) = (6 * 25 * 2, 125 * 12);
    assert_eq!((manifest.triangles, level.triangles), (all, seen));
    assert!((level.hidden_share - (1.0 - seen as f64 / all as f64)).abs() < 1e-9);
    assert!(level.silhouette.unwrap().farthest_px <= 1);
    let colliders = document(file(&manifest, "colliders.glb"));
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let mut volume = 0.0;
    for mesh in 0..colliders.array("meshes").len() {
        let primitive = colliders.primitives(mesh).unwrap().next().unwrap();
        let hull = cairn_gltf::document::Triangles::read(&colliders, mesh, primitive).unwrap();
        low = hull.points.iter().fold(low, |low, p| low.min(*p));
        high = hull.points.iter().fold(high, |high, p| high.max(*p));
        let six = |corners: &[usize; 3]| {
            let [a, b, c] = corners.map(|i| hull.points[i]);
            a.dot(b.cross(c))
        };
        volume += hull.corners.iter().map(six).sum::<f64>() / 6.0;
    }
    let block = 5.0 * edge(&cube);
    assert!((high - low - block).abs().max_element() < 0.02 * block, "{low} {high}");
    assert!((0.9..1.3).contains(&(volume / block.powi(3))), "the hulls have {volume} m^3");
}

#[test]
fn dense_props_lose_triangles_and_the_silhouette_stays() {
    // Two balls beside each other.
    let ball = asset("ball.glb");
    let poses = [0.0, 3.0].map(|x| Pose { translation: DVec3::X * x, rotation: DQuat::from_rotation_z(x) });
    let result = result(&ball, &pile_of(&[(0, 1.0), (0, 2.0)], vec![poses.to_vec()]));
    for is_compressed in [false, true] {
        let manifest = packed(&result, &PackOptions { levels: 3, is_compressed }).unwrap();
        assert!(manifest.levels.len() > 1 && manifest.levels[0].silhouette.unwrap().farthest_px <= 1);
        for pair in manifest.levels.windows(2) {
            assert!(pair[1].triangles < pair[0].triangles);
        }
        for name in ["static.lod0.glb", "instances.glb", "skinned.glb", "motion.glb"] {
            let document = document(file(&manifest, name));
            let primitive = document.primitives(0).unwrap().next().unwrap();
            let read = cairn_gltf::document::Triangles::read(&document, 0, primitive).unwrap();
            assert!(!read.corners.is_empty());
            let used = document.json().get("extensionsUsed").map_or(String::new(), Value::to_string);
            assert_eq!(used.contains("EXT_meshopt_compression"), is_compressed, "{name}");
        }
    }
}

#[test]
fn textures_and_skeleton_have_the_motion() {
    let (cube, pile) = (textured_cube(), pile_of(&[(0, 1.0), (0, 2.0), (0, 0.5)], tumbling(3, 7)));
    let manifest = packed(&result(&cube, &pile), &PackOptions::default()).unwrap();
    let texels = |name: &str| {
        let bytes = &file(&manifest, name).content;
        let pixels = |size: exr::prelude::Vec2<usize>, _: &_| (size, vec![[0.0f32; 4]; size.area()]);
        let set = |(size, all): &mut (exr::prelude::Vec2<usize>, Vec<[f32; 4]>),
                   at: exr::prelude::Vec2<usize>,
                   rgba: (f32, f32, f32, f32)| {
            all[at.y() * size.x() + at.x()] = rgba.into();
        };
        let image = read().no_deep_data().largest_resolution_level().rgba_channels(pixels, set).first_valid_layer();
        image.all_attributes().from_buffered(std::io::Cursor::new(bytes)).unwrap().layer_data.channel_data.pixels
    };
    let (size, positions) = texels("motion.positions.exr");
    let (_, rotations) = texels("motion.rotations.exr");
    let layout = manifest.motion.as_ref().unwrap();
    assert_eq!((size.x(), size.y(), layout.frames, layout.rows), (7, 3, 7, 3));
    for frame in 0..7 {
        for body in 0..3 {
            let pose = pile.frames[frame][body];
            let [x, y, z, scale] = positions[body * 7 + frame].map(f64::from);
            assert!(DVec3::new(x, y, z).distance(pose.translation) < 1e-6);
            assert_eq!(scale, pile.bodies[body].scale);
            let rotation = DQuat::from_array(rotations[body * 7 + frame].map(f64::from));
            assert!(rotation.dot(pose.rotation).abs() > 1.0 - 1e-6);
        }
    }
    // At rest, bone and inverse undo each other; and the clip moves the bones.
    let skinned = document(file(&manifest, "skinned.glb"));
    let skin = skinned.get("skins", 0).unwrap();
    assert_eq!(references(skin, "joints"), [0, 1, 2]);
    let inverse = skin["inverseBindMatrices"].as_u64().unwrap() as usize;
    for (body, inverse) in skinned.vectors::<16>(inverse).unwrap().into_iter().enumerate() {
        let Pose { translation, rotation } = pile.frames[6][body];
        let scale = DVec3::splat(pile.bodies[body].scale);
        let bone = DMat4::from(DAffine3::from_scale_rotation_translation(scale, rotation, translation));
        let both = bone * DMat4::from_cols_array(&inverse);
        assert!(both.abs_diff_eq(DMat4::IDENTITY, 1e-5), "{both}");
    }
    assert_eq!(skinned.get("animations", 0).unwrap()["channels"].as_array().unwrap().len(), 6);
    // The picture is a file beside all of them.
    let images = skinned.array("images");
    assert_eq!(images[0]["uri"], Value::from("textures/0.png"));
    assert_eq!(file(&manifest, "textures/0.png").content, crate::output::files::PNG);
}

/// A result whose JSON is changed.
fn edited(result: &[u8], change: impl FnOnce(&mut Value)) -> Vec<u8> {
    let length = u32::from_le_bytes(result[12..16].try_into().unwrap()) as usize;
    let mut json: Value = serde_json::from_slice(&result[20..20 + length]).unwrap();
    change(&mut json);
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let rest = &result[20 + length..];
    let word = |n: usize| (n as u32).to_le_bytes();
    [b"glTF", &word(2)[..], &word(20 + text.len() + rest.len()), &word(text.len()), b"JSON", &text, rest].concat()
}

#[test]
fn the_archive_has_the_files_of_the_pack() {
    let pile = pile_of(&[(0, 1.0), (0, 0.5)], tumbling(2, 3));
    let manifest = packed(&result(&textured_cube(), &pile), &PackOptions::default()).unwrap();
    let archive = result_as(Format::Pack, &textured_cube(), &pile);
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(archive)).unwrap();
    assert_eq!(archive.len(), manifest.files.len() + 1);
    let mut content = |name: &str| {
        let mut content = Vec::new();
        std::io::Read::read_to_end(&mut archive.by_name(name).unwrap(), &mut content).unwrap();
        content
    };
    assert_eq!(content("manifest.json"), manifest.text().into_bytes());
    for file in &manifest.files {
        assert_eq!(content(&file.file), file.content, "{}", file.file);
    }
}

#[test]
fn what_is_no_result_is_refused() {
    let fault = |bytes: &[u8]| packed(bytes, &PackOptions::default()).unwrap_err().to_string();
    assert!(fault(&asset("cube.glb")).contains("it is no result of a bake: it has no node \"pile\" with frames"));
    assert!(fault(b"glTF").contains("GLB"), "{}", fault(b"glTF"));
    let result = result(&asset("cube.glb"), &block(2, 1.0));
    let moved = edited(&result, |json| json["nodes"][0]["translation"] = serde_json::json!([1, 0, 0]));
    assert!(fault(&moved).contains("its node \"pile\" was moved"));
    let bare = edited(&result, |json| json["meshes"][0]["primitives"][0]["mode"] = 0.into());
    assert!(fault(&bare).contains("none of its bodies shows triangles"));
}

#[test]
fn what_a_pack_leaves_out_is_said() {
    let mut pile = block(2, 1.0);
    pile.frames.push(pile.frames[0].clone());
    pile.bodies[1].first_frame = 9;
    let result = edited(&result(&asset("cube.glb"), &pile), |json| {
        let place = json["meshes"][0]["primitives"][0]["attributes"]["POSITION"].clone();
        json["meshes"][0]["primitives"][0]["attributes"]["_DUST"] = place;
        json["nodes"][3]["scale"] = serde_json::json!([1, 2, 1]);
        json["nodes"].as_array_mut().unwrap().push(serde_json::json!({ "name": "scenery" }));
    });
    let manifest = packed(&result, &PackOptions::default()).unwrap();
    let said = manifest.left_out.join("\n");
    for sentence in [
        "1 bodies that never appear are left out",
        "_DUST of the props are left out of the pack",
        "the scenery is left out of the pack",
        "bodies that are scaled differently along their axes have the scale along X",
    ] {
        assert!(said.contains(sentence), "{sentence}: {said}");
    }
    assert_eq!(manifest.bodies, 7);
    assert_eq!(
        document(file(&manifest, "skinned.glb")).get("skins", 0).unwrap()["joints"].as_array().unwrap().len(),
        7
    );
}
