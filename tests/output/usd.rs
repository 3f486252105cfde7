//! Bakes written as USD. Long: one helper reads all. That USD's own library reads the same is tested in `tests/usd`.

use crate::output::files::{self, PNG, far_from_its_origin, kit, no_files, pile_of, textured_cube, tumbling};
use cairn_core::report::bake::BakedPile;
use cairn_core::report::{BakedGlue, BakedGlueDot};
use cairn_export::Format::{Glb, Usda, Usdc, Usdz};
use cairn_export::{ExportScene, Layout, PartPrim, SourceModel, UsdAsset, as_gltf, convert_usd, encode, origin, write};
use cairn_render::{Moment, RenderModel, Settings, render};
use cairn_wire::proto::UsdMotion;
use glam::DVec3;
use image::RgbImage;
use serde_json::{Value, json};
use std::collections::BTreeMap;

fn prop<'a>(name: &'a str, bytes: &'a [u8]) -> SourceModel<'a> {
    SourceModel { name, file: "file.gltf", bytes, node: None, resolve: &no_files, asset: None }
}

/// The text that a bake is written as.
fn text(pile: &BakedPile, scene: &ExportScene) -> String {
    String::from_utf8(files::encode(Usda, pile, scene).unwrap()).unwrap()
}

fn lines<'a>(text: &'a str, with: &'a str) -> Vec<&'a str> {
    text.lines().map(str::trim).filter(|line| line.contains(with)).collect()
}

#[test]
fn bodies_are_instances_of_their_props() {
    let (cube, kit) = (textured_cube(), kit());
    let props = vec![prop("unused.glb", &cube), prop("kit/cube.glb", &cube), prop("kit.gltf", &kit)];
    let scene = ExportScene { props, ..Default::default() };
    let text = text(&pile_of(&[(2, 1.0), (1, 0.5), (2, 2.0)], tumbling(3, 4)), &scene);
    assert_eq!(lines(&text, "int[] protoIndices"), ["int[] protoIndices = [1, 0, 1]"]);
    assert_eq!(lines(&text, "int64[] ids"), ["int64[] ids = [0, 1, 2]"]);
    let prototypes = "</Pile/Bodies/Prototypes/cube>, </Pile/Bodies/Prototypes/kit>";
    assert_eq!(lines(&text, "rel prototypes"), [format!("rel prototypes = [{prototypes}]")]);
    assert_eq!(
        lines(&text, "float3[] scales"),
        ["float3[] scales = [(1.0, 1.0, 1.0), (0.5, 0.5, 0.5), (2.0, 2.0, 2.0)]"]
    );
    // One mesh of the cube, two of the kit, each with its materials beside it.
    assert_eq!(lines(&text, "def Mesh ").len(), 3);
    assert_eq!(lines(&text, "def Material ").len(), 2);
    for animated in ["positions", "orientations", "orientationsf", "velocities", "angularVelocities", "extent"] {
        assert_eq!(lines(&text, &format!(" {animated}.timeSamples")).len(), 1, "{animated}");
    }
    assert_eq!(lines(&text, "displayName = \"kit/cube.glb\"").len(), 1);
    assert!(!text.contains("Scenery") && !text.contains("Glue"));
}

/// An archive is of USD by the name of its first file: documents of offices are archives, too.
#[test]
fn archives_of_others_are_no_usd() {
    let archive = |name: &str| {
        let head = [&b"PK\x03\x04"[..], &[0; 22], &u16::try_from(name.len()).unwrap().to_le_bytes(), &[0; 2]].concat();
        [&head[..], name.as_bytes(), b"content"].concat()
    };
    for (name, is_usd) in [("pile.usdc", true), ("a/b.USDA", true), ("word/document.xml", false), ("", false)] {
        assert_eq!(cairn_export::is_usd_content(&archive(name)), is_usd, "{name}");
    }
    assert!(!cairn_export::is_usd_content(b"PK\x03\x04") && !cairn_export::is_usd_content(&archive("a.usda")[..31]));
    assert!(cairn_export::is_usd_content(b"#usda 1.0") && cairn_export::is_usd_content(b"PXR-USDC"));
}

/// The prim of the pile says how large it is, and what: programs do so without opening it.
#[test]
fn the_pile_is_described_as_a_model() {
    let cube = textured_cube();
    let origin = json!({ "scene": {}, "assets": [], "versions": {}, "result_blake3": "0123abcd" });
    let scene = |layout: Layout| ExportScene {
        props: vec![prop("cube.glb", &cube)],
        origin: Some(&origin),
        layout,
        ..Default::default()
    };
    let pile = far_from_its_origin(3);
    let plain = text(&pile, &scene(Layout::default()));
    assert_eq!(lines(&plain, "prepend apiSchemas")[0], "prepend apiSchemas = [\"GeomModelAPI\"]");
    let numbers = |line: &str| -> Vec<f64> {
        let list = line.split_once('=').unwrap().1;
        let words = list.split(|c: char| !(c.is_ascii_digit() || "-.e+".contains(c))).filter(|word| !word.is_empty());
        words.map(|word| word.parse().unwrap()).collect()
    };
    let hint = |text: &str| numbers(lines(text, "float3[] extentsHint")[0]);
    let all = hint(&plain);
    assert_eq!(all.len(), 6, "{all:?}");
    // The boxes of all frames together are in it, and no room beside them.
    let at = plain.find("extent.timeSamples").unwrap();
    let boxes: Vec<Vec<f64>> = plain[at..]
        .lines()
        .skip(1)
        .take_while(|line| line.contains(": ["))
        .map(|line| numbers(&line.replacen(':', "=", 1)))
        .collect();
    assert!(boxes.len() == 3 && boxes.iter().all(|sides| sides.len() == 6), "{boxes:?}");
    for axis in 0..3 {
        let low = boxes.iter().map(|sides| sides[axis]).fold(f64::INFINITY, f64::min);
        let high = boxes.iter().map(|sides| sides[axis + 3]).fold(f64::NEG_INFINITY, f64::max);
        assert!((all[axis] - low).abs() < 1e-6 && (all[axis + 3] - high).abs() < 1e-6, "{all:?}, {boxes:?}");
    }
    let at = plain.find("assetInfo = {").unwrap();
    let info: Vec<&str> = plain[at..].lines().map(str::trim).take(4).collect();
    for line in ["string name = \"Pile\"", "string version = \"0123abcd\""] {
        assert!(info.contains(&line), "{info:?}");
    }
    // The third of four boxes is that of proxies; the others are empty.
    let proxy = text(&pile, &scene(Layout { purpose: Some("proxy"), ..Layout::default() }));
    let boxes = hint(&proxy);
    assert!(boxes.len() == 18 && boxes[12..] == all[..] && boxes[0] > boxes[3] && boxes[6] > boxes[9], "{boxes:?}");
}

#[test]
fn a_prop_far_from_its_origin_is_moved_to_its_center() {
    let cube = textured_cube();
    let scene = ExportScene { props: vec![prop("cube.glb", &cube)], ..Default::default() };
    let text = text(&far_from_its_origin(3), &scene);
    assert_eq!(lines(&text, "double3 xformOp:translate"), ["double3 xformOp:translate = (-100.0, 0.0, 0.0)"]);
    let at = text.find("positions.timeSamples").unwrap();
    // A frame before the motion, the bodies are where it begins.
    assert!(text[at..].lines().nth(1).unwrap().trim().starts_with("-1.0: [(0.0"), "{text}");
    let positions: Vec<&str> = text[at..].lines().skip(2).take(3).map(str::trim).collect();
    for (frame, line) in positions.iter().enumerate() {
        assert!(line.starts_with(&format!("{frame}.0: [({frame}.0")), "{line}");
    }
}

#[test]
fn what_does_not_change_has_no_samples() {
    let cube = textured_cube();
    let scene = ExportScene { props: vec![prop("cube.glb", &cube)], ..Default::default() };
    let mut frames = tumbling(1, 3);
    let still = frames[2].clone();
    frames.extend(vec![still; 40]);
    let moving = text(&pile_of(&[(0, 1.0)], frames), &scene);
    let at = moving.find("positions.timeSamples").unwrap();
    let samples = moving[at..].lines().skip(1).take_while(|line| line.trim() != "}").count();
    // The beginning, a frame before the first one; the first three frames; and the last.
    assert_eq!(samples, 5, "{}", &moving[at..at + 600]);
    let still = text(&pile_of(&[(0, 1.0)], tumbling(1, 1)), &scene);
    assert!(!still.contains("timeSamples") && !still.contains("velocities"));
}

#[test]
fn bodies_that_appear_later_are_hidden_until_then() {
    let cube = textured_cube();
    let scene = ExportScene { props: vec![prop("cube.glb", &cube)], ..Default::default() };
    let mut pile = pile_of(&[(0, 1.0), (0, 1.0)], tumbling(2, 6));
    pile.bodies[1].first_frame = 3;
    let text = text(&pile, &scene);
    let samples = |name: &str| -> Vec<String> {
        let rest = &text[text.find(&format!("{name}.timeSamples")).unwrap()..];
        rest.lines().skip(1).take_while(|line| line.trim() != "}").map(|line| line.trim().to_owned()).collect()
    };
    let hidden = vec!["1"; 16].join(", ");
    assert_eq!(samples("invisibleIds"), [format!("0.0: [{hidden}],"), "3.0: [],".into()]);
    let [none, all] = ["[(1.0, 1.0, 1.0), (0.0, 0.0, 0.0)],", "[(1.0, 1.0, 1.0), (1.0, 1.0, 1.0)],"];
    assert_eq!(samples("scales"), [format!("0.0: {none}"), format!("2.0: {none}"), format!("3.0: {all}")]);
}

#[test]
fn scenery_stands_below_a_prim_of_its_own() {
    let (cube, kit) = (textured_cube(), kit());
    let scene = ExportScene {
        props: vec![prop("cube.glb", &cube)],
        scenery: vec![prop("a b/7 walls.gltf", &kit), prop("door.glb", &cube)],
        ..Default::default()
    };
    let mut pile = pile_of(&[(0, 1.0)], tumbling(1, 5));
    let moving: Vec<_> = tumbling(1, 5).into_iter().map(|poses| poses[0]).collect();
    pile.scenery = vec![Vec::new(), moving];
    let text = text(&pile, &scene);
    let at = |what: &str| text.find(what).unwrap_or_else(|| panic!("{what}"));
    assert!(at("def Xform \"Scenery\"") < at("def Xform \"_7_walls\"") && at("_7_walls") < at("def Xform \"door\""));
    assert!(at("xformOp:translate.timeSamples") > at("def Xform \"door\""));
    assert!(text.contains("displayName = \"a b/7 walls.gltf\""));
}

#[test]
fn the_same_bake_gives_the_same_bytes_and_tells_its_origin() {
    let (cube, kit) = (textured_cube(), kit());
    let stated = json!({
        "scene": { "name": "it's a \"\\path\"\n'''and\"\"\"", "fill": { "count": 3 } },
        "assets": [{ "uri": "a'b.glb", "sha256": "0" }],
        "versions": { "cairn": "0" }, "request_blake3": "1", "result_blake3": "2",
    });
    let measures = BTreeMap::from([("kept_shape".into(), Some(0.5)), ("control_overhead".into(), Some(1.0))]);
    let scene = ExportScene {
        props: vec![prop("cube.glb", &cube)],
        scenery: vec![prop("kit.gltf", &kit)],
        origin: Some(&stated),
        measures: Some(&measures),
        ..Default::default()
    };
    let pile = pile_of(&[(0, 1.0); 20], tumbling(20, 30));
    for format in [Usda, Usdc, Usdz] {
        let [one, two] = [0; 2].map(|_| encode(format, &pile, &scene).unwrap());
        assert_eq!((&one.bytes, &one.sidecars), (&two.bytes, &two.sidecars), "{format:?}");
        assert_eq!(origin(&one.bytes), Some(stated.clone()), "{format:?}");
        assert_eq!(one.sidecars.len(), usize::from(format != Usdz), "{format:?}");
    }
    let text = text(&pile, &scene);
    assert!(text.contains("double kept_shape = 0.5") && !text.contains("control_overhead"));
    assert!(origin(b"#usda 1.0\n").is_none() && origin(b"PXR-USDC").is_none() && origin(b"PK\x03\x04").is_none());
}

#[test]
fn damaged_files_tell_nothing_and_break_nothing() {
    let cube = textured_cube();
    let stated = json!({ "scene": {}, "assets": [], "versions": {}, "request_blake3": "1", "result_blake3": "2" });
    let scene = ExportScene { props: vec![prop("cube.glb", &cube)], origin: Some(&stated), ..Default::default() };
    let pile = pile_of(&[(0, 1.0); 3], tumbling(3, 3));
    for format in [Glb, Usda, Usdc, Usdz] {
        let whole = files::encode(format, &pile, &scene).unwrap();
        for cut in (0..whole.len()).step_by(97) {
            origin(&whole[..cut]);
            let _ = as_gltf(&whole[..cut], &no_files);
        }
        // A crate's tables are at its end.
        let tables = whole.len() - whole.len().min(4000);
        for at in (tables..whole.len()).step_by(3) {
            let mut damaged = whole.clone();
            damaged[at] ^= 0xff;
            origin(&damaged);
            let _ = as_gltf(&damaged, &no_files);
        }
    }
}

/// A stage that is read back shows what the `.glb` shows, at any moment.
#[test]
fn stages_show_what_a_glb_shows() {
    let (cube, kit) = (textured_cube(), kit());
    let stated = json!({ "scene": {}, "assets": [], "versions": {}, "request_blake3": "1", "result_blake3": "2" });
    let scene = ExportScene {
        props: vec![prop("cube.glb", &cube), prop("kit.gltf", &kit)],
        scenery: vec![prop("door.glb", &cube)],
        origin: Some(&stated),
        ..Default::default()
    };
    let mut pile = pile_of(&[(0, 1.0), (1, 0.3), (0, 0.5), (1, 0.2)], tumbling(4, 6));
    pile.bodies[2].first_frame = 3;
    pile.scenery = vec![tumbling(1, 6).into_iter().map(|poses| poses[0]).collect()];
    pile.solids[0].pivot = DVec3::new(0.3, 0.0, 0.0);
    let pictures = |format| -> Vec<RgbImage> {
        let encoded = encode(format, &pile, &scene).unwrap();
        let beside = |name: &str| encoded.sidecars.get(name).cloned().ok_or_else(|| format!("there is no {name}"));
        let bytes = as_gltf(&encoded.bytes, &beside).unwrap_or_else(|what| panic!("{format:?}: {what}"));
        let file = RenderModel { name: "pile", bytes: &bytes, resolve: &no_files };
        let moments = [Moment::Frame(0), Moment::Frame(2), Moment::Frame(4), Moment::Seconds(0.07), Moment::End];
        let settings = |moment| Settings { moment, size: [120, 90], samples: 16, ..Settings::default() };
        moments.map(|moment| render(&file, None, &settings(moment)).unwrap()).into()
    };
    let expected = pictures(Glb);
    assert_ne!(expected[0], expected[1], "it moves");
    for format in [Usda, Usdc, Usdz] {
        for (number, (found, expected)) in pictures(format).iter().zip(&expected).enumerate() {
            let differs = |(a, b): &(&image::Rgb<u8>, &image::Rgb<u8>)| (0..3).any(|c| a[c].abs_diff(b[c]) > 16);
            let different = found.pixels().zip(expected.pixels()).filter(differs).count();
            assert!(different * 100 < 120 * 90, "{format:?}, picture {number}: {different} pixels differ");
        }
    }
}

/// What is wrong with a stage is said with the prim at fault.
#[test]
fn stages_that_cannot_be_shown_say_why() {
    let triangle = "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]";
    let mesh = |faces: &str| format!("def Mesh \"M\"\n{{\n{triangle}\n{faces}\n}}\n");
    let prototype = "def Mesh \"P\"\n{\n}\n";
    let copies = |lists: &str| format!("{prototype}def PointInstancer \"I\"\n{{\nrel prototypes = </P>\n{lists}\n}}\n");
    let deep = "def Xform \"X\"\n{\n".repeat(210) + &"}\n".repeat(210);
    for (prims, words) in [
        (String::new(), "it shows no meshes"),
        (deep, "prims are nested too deeply"),
        (mesh(""), "/M: it has no faces"),
        (mesh("int[] faceVertexCounts = [-1]\nint[] faceVertexIndices = [0]"), "/M: a face has less than no corners"),
        (
            mesh("int[] faceVertexCounts = [4]\nint[] faceVertexIndices = [0, 1, 2]"),
            "/M: its faces have more corners than faceVertexIndices",
        ),
        (
            mesh("int[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 7]"),
            "/M: a corner is none of its points",
        ),
        (
            mesh(
                "int[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 2]\n\
                 uniform token[] xformOpOrder = [\"xformOp:shear\"]",
            ),
            "/M: its transform has xformOp:shear, which is none of USD's steps, or has no such value",
        ),
        (copies(""), "/I: it has no protoIndices"),
        (copies("int[] protoIndices = [0]"), "/I: it has no positions"),
        (
            copies("int[] protoIndices = [0]\npoint3f[] positions = [(0, 0, 0), (1, 0, 0)]"),
            "/I: its lists are of different lengths",
        ),
        (
            copies("int[] protoIndices = [3]\npoint3f[] positions = [(0, 0, 0)]"),
            "/I: protoIndices name a prototype that it does not have",
        ),
    ] {
        let text = format!("#usda 1.0\n{prims}");
        let refused = as_gltf(text.as_bytes(), &no_files).expect_err(words);
        assert!(refused.contains(words), "{refused}, not {words}");
    }
    let turning = "uniform token[] xformOpOrder = [\"xformOp:transform\"]\nmatrix4d xformOp:transform.timeSamples = \
                   { 0: ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)), \
                   2: ((1, 0, 0, 0), (1, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)) }";
    let faces = "int[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 2]\n";
    let coming = "int[] protoIndices = [0]\npoint3f[] positions.timeSamples = { 0: [(0, 0, 0)], 1: [] }";
    for (prims, words) in [
        (
            mesh(&format!("{faces}{turning}")),
            "the motion of prims that shear, or of very many prims, is left out: they stand as at the start",
        ),
        (
            format!("{}{}", mesh(faces), copies(coming)),
            "its instances come and go, which is left out: those of the start are shown",
        ),
    ] {
        let shown = convert_usd(format!("#usda 1.0\n{prims}").as_bytes(), &no_files, &[]).unwrap();
        assert!(shown.notes.iter().any(|note| note.contains(words)), "{:?}", shown.notes);
    }
    assert_eq!(as_gltf(b"PXR-USDC", &no_files).unwrap_err(), "it is damaged, or no USD");
    assert_eq!(*as_gltf(b"{}", &no_files).unwrap(), *b"{}", "what is no USD stays");
}

#[test]
fn pictures_are_beside_the_layer_or_in_the_package() {
    let cube = textured_cube();
    let scene = ExportScene { props: vec![prop("cube.glb", &cube)], ..Default::default() };
    let pile = pile_of(&[(0, 1.0)], tumbling(1, 2));
    let folder = tempfile::tempdir().unwrap();
    for name in ["one.usda", "two.usdc", "three.usdz"] {
        write(&folder.path().join(name), &pile, &scene).unwrap();
    }
    let pictures: Vec<_> = folder.path().join("textures").read_dir().unwrap().map(|entry| entry.unwrap()).collect();
    assert_eq!(pictures.len(), 1, "results in one folder share their pictures");
    assert_eq!(std::fs::read(pictures[0].path()).unwrap(), PNG);
    let text = std::fs::read_to_string(folder.path().join("one.usda")).unwrap();
    let name = pictures[0].file_name().into_string().unwrap();
    assert_eq!(lines(&text, "inputs:file"), [format!("asset inputs:file = @./textures/{name}@")]);
    // Each file of a package begins at a multiple of 64 bytes, as it is.
    let package = std::fs::read(folder.path().join("three.usdz")).unwrap();
    let find = |what: &[u8]| package.windows(what.len()).position(|window| window == what).unwrap();
    assert_eq!((find(PNG) % 64, find(b"PXR-USDC") % 64), (0, 0));
}

#[test]
fn glue_is_told_as_guides() {
    let cube = textured_cube();
    let scene = ExportScene { props: vec![prop("cube.glb", &cube)], ..Default::default() };
    let mut pile = pile_of(&[(0, 1.0); 3], tumbling(3, 2));
    let dot = |other| BakedGlueDot {
        body: 1,
        other,
        point: [1.0, 2.0, 3.0],
        normal: [0.0, 1.0, 0.0],
        force: [0.0, 5.0, 0.0],
        moment: [0.0; 3],
        limit: [8.0, 0.5],
        is_broken: other.is_none(),
    };
    let dots = vec![dot(Some(2)), dot(None)];
    pile.glue = Some(BakedGlue { dots, clusters: vec![vec![1, 2]], anchored: vec![1] });
    let text = text(&pile, &scene);
    assert_eq!(lines(&text, "purpose"), ["uniform token purpose = \"guide\""]);
    for stated in [
        "int2[] primvars:cairn:bodies = [(1, 2), (1, -1)] (",
        "bool[] primvars:cairn:broken = [false, true] (",
        "int[] primvars:cairn:cluster = [-1, 0, 0] (",
        "bool[] primvars:cairn:anchored = [false, true, false] (",
    ] {
        assert_eq!(lines(&text, stated).len(), 1, "{stated}");
    }
}

/// What USD's preview surface does not have is not lost in silence.
#[test]
fn what_usd_leaves_out_is_reported() {
    let mut kit: Value = serde_json::from_slice(&kit()).unwrap();
    let plain = kit.to_string();
    kit["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": 0 }]);
    kit["materials"][1]["extensions"]["KHR_materials_sheen"] = json!({});
    let webp = "data:image/webp,RIFF%00%00%00%00WEBP";
    kit["images"][1] = json!({ "uri": webp });
    let rich = kit.to_string();
    let pile = pile_of(&[(0, 1.0)], tumbling(1, 2));
    let left_out = |bytes: &str| {
        let scene = ExportScene { props: vec![prop("kit.gltf", bytes.as_bytes())], ..Default::default() };
        [Usda, Usdc, Usdz].map(|format| encode(format, &pile, &scene).unwrap().left_out)
    };
    for sentences in left_out(&rich) {
        let all = sentences.join("\n");
        for what in
            ["no morph targets", "no material extension KHR_materials_sheen", "no pictures of the type image/webp"]
        {
            assert!(all.contains(&format!("kit.gltf: a USD result has {what}")), "{all}");
        }
    }
    assert!(left_out(&plain).iter().all(Vec::is_empty), "{:?}", left_out(&plain));
}

/// What a show stores of a pile whose props are assets.
#[test]
fn a_result_of_references_is_small() {
    /// The pile that a studio asked for, and three seconds of it.
    const BODIES: usize = 2000;
    const FRAMES: usize = 72;
    let cube = textured_cube();
    let prims = [PartPrim { path: "/rock".into(), place: glam::DMat4::IDENTITY, off: Vec::new() }];
    let asset = Some(UsdAsset { path: "./rock.usd", prims: &prims, is_default: true });
    let pile = pile_of(&[(0, 1.0); BODIES], tumbling(BODIES, FRAMES));
    let size = |motion| {
        let layout = Layout { motion, ..Layout::default() };
        let props = vec![SourceModel { asset, ..prop("rock.usd", &cube) }];
        let result = encode(Usdc, &pile, &ExportScene { props, layout, ..Default::default() }).unwrap();
        assert!(result.sidecars.is_empty(), "its pictures are those of the asset");
        result.bytes.len()
    };
    let (full, lean, none) = (size(UsdMotion::Full), size(UsdMotion::Lean), size(UsdMotion::None));
    assert!(none < 200_000 && lean <= 3_000_000, "{none} bytes at rest, {lean} in motion");
    assert!(2 * lean < full, "{lean} of {full} bytes");
}

/// Two glued bodies and one that the scene keeps, in centimetres with Z up.
#[test]
fn a_stage_for_simulators_has_every_body_once_more() {
    let cube = textured_cube();
    let layout = Layout { is_z_up: true, meters_per_unit: 0.01, has_physics: true, ..Layout::default() };
    let scene = ExportScene { props: vec![prop("cube.glb", &cube)], layout, ..Default::default() };
    let mut pile = pile_of(&[(0, 1.0), (0, 2.0), (0, 1.0)], tumbling(3, 2));
    pile.bodies[2].is_pinned = true;
    let dot = |other, force| BakedGlueDot {
        body: 1,
        other,
        point: [1.0, 0.01, 3.0],
        normal: [0.0, 1.0, 0.0],
        force: [0.0, 5.0, 0.0],
        moment: [0.0; 3],
        limit: [force, 0.5],
        is_broken: false,
    };
    let dots = vec![dot(Some(0), 8.0), dot(None, f64::INFINITY)];
    pile.glue = Some(BakedGlue { dots, clusters: vec![vec![0, 1]], anchored: vec![0, 1] });
    let text = text(&pile, &scene);
    for stated in [
        "kilogramsPerUnit = 1.0",
        "token visibility = \"invisible\"",
        "vector3f physics:gravityDirection = (0.0, 0.0, -1.0)",
        "float physics:gravityMagnitude = 981.0",
        "float physics:mass = 8.0",
        // 1 kg m^2 of the prop, times 2^5, in kg cm^2.
        "float3 physics:diagonalInertia = (320000.0, 320000.0, 320000.0)",
        "float physics:breakForce = 8000.0",
        "rel physics:body1 = </Pile/Physics/Ground>",
        "uniform token axis = \"Z\"",
        "class Scope \"Hulls\"",
    ] {
        assert_eq!(lines(&text, stated).len(), 1, "{stated}");
    }
    assert_eq!(lines(&text, "PhysicsRigidBodyAPI").len(), 2, "one is kept");
    assert_eq!(lines(&text, "def PhysicsFixedJoint").len(), 2);
    assert_eq!(lines(&text, "breakTorque").len(), 1);
    // The picture is that of a stage without physics, and Cairn itself reads it as such.
    let plain = ExportScene {
        props: vec![prop("cube.glb", &cube)],
        layout: Layout { has_physics: false, ..scene.layout.clone() },
        ..Default::default()
    };
    let seen =
        |scene: &ExportScene| as_gltf(&files::encode(Usdc, &pile, scene).unwrap(), &no_files).unwrap().into_owned();
    assert_eq!(seen(&scene), seen(&plain));
}
