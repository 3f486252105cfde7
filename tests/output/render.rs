//! Pictures of results.

use crate::output::files::encode;
use crate::output::files::{kit, kit_json, no_files, pile_of, textured_cube, tumbling};
use crate::output::glue::dot;
use cairn_core::report::BakedGlue;
use cairn_export::{ExportScene, Format, SourceModel};
use cairn_geometry::pose::Pose;
use cairn_render::{Moment, RenderError, RenderModel, Settings, render, views};
use glam::{DQuat, DVec3};
use image::RgbImage;
use serde_json::{Value, json};

const SMALL: Settings = Settings {
    moment: Moment::End,
    fit: None,
    wide: 1.0,
    size: [64, 48],
    azimuth: 20.0,
    elevation: 15.0,
    samples: 4,
    glue: false,
};

fn picture(bytes: &[u8], settings: Settings) -> Result<RgbImage, RenderError> {
    render(&RenderModel { name: "file.glb", bytes, resolve: &no_files }, None, &settings)
}

fn baked(frames: Vec<Vec<Pose>>) -> Vec<u8> {
    let (cube, kit) = (textured_cube(), kit());
    let model = |bytes| SourceModel { name: "prop", file: "prop", bytes, node: None, resolve: &no_files, asset: None };
    let scene = ExportScene { props: vec![model(&cube), model(&kit)], scenery: vec![], ..Default::default() };
    encode(Format::Glb, &pile_of(&[(0, 1.0), (1, 0.2), (0, 2.0)], frames), &scene).unwrap()
}

#[test]
fn any_number_of_threads_gives_the_same_picture() {
    let file = baked(tumbling(3, 5));
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| picture(&file, SMALL).unwrap())
    };
    let one = with(1);
    assert_eq!(one, with(3));
    assert_eq!(one.dimensions(), (64, 48));
    let shown = one.pixels().filter(|p| p.0 != one.get_pixel(0, 0).0).count();
    assert!(shown > 300, "only {shown} picture elements show anything");
}

#[test]
fn a_moment_shows_the_poses_of_that_moment() {
    let frames = tumbling(3, 9);
    let still = picture(&baked(frames[8..].to_vec()), SMALL).unwrap();
    let file = baked(frames);
    for moment in [Moment::End, Moment::Frame(8), Moment::Seconds(8.0 / 24.0), Moment::Seconds(1e9)] {
        assert_eq!(picture(&file, Settings { moment, ..SMALL }).unwrap(), still, "{moment:?}");
    }
    let start = picture(&file, Settings { moment: Moment::Frame(0), ..SMALL }).unwrap();
    assert_ne!(start, still);
    let refused = picture(&file, Settings { moment: Moment::Frame(9), ..SMALL }).unwrap_err();
    assert_eq!(refused.to_string(), "file.glb: has no frame 9; the last one is 8");
    let refused = picture(&kit(), Settings { moment: Moment::Frame(0), ..SMALL }).unwrap_err();
    assert!(refused.to_string().contains("choose the moment in seconds"));
}

#[test]
fn the_camera_stands_still_or_shows_more() {
    let file = baked(tumbling(3, 9));
    let of = |moment, fit| picture(&file, Settings { moment, fit, ..SMALL }).unwrap();
    // What flies away stays in the middle of a camera that follows it, and not of one that stands still.
    let [start, end] = [0, 8].map(Moment::Frame);
    assert_eq!(of(end, None), of(end, Some(end)));
    assert_ne!(of(end, None), of(end, Some(start)));
    let cube = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/assets/cube.glb")).unwrap();
    let red = |wide: f64| {
        let shown = picture(&cube, Settings { wide, ..SMALL }).unwrap();
        shown.pixels().filter(|p| i32::from(p.0[0]) > i32::from(p.0[1]) + 60).count() as f64
    };
    let share = red(2.0) / red(1.0);
    assert!((0.15..0.4).contains(&share), "twice as wide: {share}");
    let refused = picture(&file, Settings { fit: Some(Moment::Frame(9)), ..SMALL }).unwrap_err();
    assert_eq!(refused.to_string(), "file.glb: has no frame 9; the last one is 8");
}

#[test]
fn the_camera_takes_in_the_ghost() {
    let cone = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/assets/cone.glb")).unwrap();
    let cube = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/assets/cube.glb")).unwrap();
    let model = |bytes| RenderModel { name: "file", bytes, resolve: &no_files };
    let red = |picture: &RgbImage| {
        let is_red = |p: &&image::Rgb<u8>| i32::from(p.0[0]) > i32::from(p.0[1]) + 60;
        picture.pixels().filter(is_red).count()
    };
    let bare = picture(&cube, SMALL).unwrap();
    assert!(red(&bare) > 500, "the cube fills the picture");
    let within = render(&model(&cube), Some(&model(&cone)), &SMALL).unwrap();
    assert!(red(&within) < red(&bare) / 10);
}

#[test]
fn broken_files_are_refused() {
    for (pointer, value) in [
        ("/nodes/1/mesh", json!(9)),
        ("/nodes/0/children", json!([99])),
        ("/nodes/0/scale", json!([0, 0, 1e300])),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(u64::MAX)),
        ("/meshes/0/primitives/0/attributes", json!(null)),
        ("/meshes/0/primitives/0/mode", json!(0)),
        ("/meshes", json!([])),
        ("/nodes", json!([])),
        ("/accessors/0/count", json!(1u64 << 62)),
        ("/accessors/0/byteOffset", json!(u64::MAX)),
        ("/accessors/0/componentType", json!(1)),
        ("/accessors/0/type", json!("MAT4")),
        ("/accessors/0/sparse", json!({ "count": 7 })),
        ("/accessors/2/count", json!(30)),
        ("/accessors/2/byteOffset", json!(1)),
        ("/bufferViews/0/byteLength", json!(1u64 << 62)),
        ("/bufferViews/0/byteStride", json!(u64::MAX)),
        (
            "/animations",
            json!([{
                "channels": [{ "sampler": 0, "target": { "node": 1, "path": "rotation" } }],
                "samplers": [{ "input": 0, "output": 0 }],
            }]),
        ),
    ] {
        let mut json = kit_json();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        match json.pointer_mut(parent).unwrap() {
            Value::Array(items) => items[key.parse::<usize>().unwrap()] = value,
            Value::Object(members) => drop(members.insert(key.into(), value)),
            _ => panic!("{pointer}"),
        }
        let refused = picture(json.to_string().as_bytes(), SMALL);
        assert!(matches!(refused, Err(RenderError::File { .. })), "{pointer}");
    }
    for bytes in [&b""[..], b"glTF", b"{}", b"[1]"] {
        assert!(picture(bytes, SMALL).is_err());
    }
    let size = "a picture is 1 to 16384 pixels wide and high and has at least 1 sample";
    let angles = "the camera's angles and what it shows must be numbers";
    for (settings, words) in [
        (Settings { size: [0, 9], ..SMALL }, size),
        (Settings { size: [9, 16385], ..SMALL }, size),
        (Settings { samples: 0, ..SMALL }, size),
        (Settings { azimuth: f64::NAN, ..SMALL }, angles),
        (Settings { elevation: f64::INFINITY, ..SMALL }, angles),
        (Settings { wide: f64::NAN, ..SMALL }, angles),
    ] {
        let refused = picture(&kit(), settings);
        assert!(matches!(refused, Err(RenderError::Settings(said)) if said == words), "{settings:?}");
    }
}

#[test]
fn lost_and_broken_pictures_do_not_matter() {
    let plain = {
        let mut json = kit_json();
        json["materials"][1]["pbrMetallicRoughness"] = json!({});
        picture(json.to_string().as_bytes(), SMALL).unwrap()
    };
    for image in
        [json!({ "uri": "lost.png" }), json!({ "uri": "data:,rubbish" }), json!({ "bufferView": 99 }), json!(3)]
    {
        let mut json = kit_json();
        json["images"][1] = image;
        assert_eq!(picture(json.to_string().as_bytes(), SMALL).unwrap(), plain);
    }
    assert_ne!(picture(&kit(), SMALL).unwrap(), plain, "a good picture shows");
}

#[test]
fn size_and_place_of_the_world_do_not_matter() {
    let cube = |scale: f64, offset: f64| {
        let mut json = kit_json();
        json["nodes"] = json!([{ "mesh": 0, "scale": [scale, scale, scale], "translation": [offset, offset, 0] }]);
        picture(json.to_string().as_bytes(), Settings { samples: 16, ..SMALL }).unwrap()
    };
    let near = cube(1.0, 0.0);
    for (scale, offset) in [(1e-6, 0.0), (1e9, 0.0), (0.125, 4096.0)] {
        let far = cube(scale, offset);
        let differences =
            near.pixels().zip(far.pixels()).filter(|(a, b)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 24));
        assert!(differences.count() < 10, "scale {scale}, offset {offset}");
    }
}

/// Two of three cubes side by side, glued to each other.
fn glued(moves: f64) -> Vec<u8> {
    let cube = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/assets/cube.glb")).unwrap();
    let prop = SourceModel { name: "cube", file: "cube", bytes: &cube, node: None, resolve: &no_files, asset: None };
    let at = |x: f64| Pose { translation: DVec3::X * x, rotation: DQuat::IDENTITY };
    let frames = [moves, 0.0].map(|by| [-4.0, 0.0, 4.0].map(|x| at(x + by)).to_vec()).to_vec();
    let mut pile = pile_of(&[(0, 1.0); 3], frames);
    pile.glue = Some(BakedGlue {
        dots: vec![dot(0, Some(1), [-2.0, 0.0, 0.0], 1.0, false)],
        clusters: vec![vec![0, 1]],
        anchored: vec![],
    });
    encode(Format::Glb, &pile, &ExportScene { props: vec![prop], scenery: vec![], ..Default::default() }).unwrap()
}

const SHOWN: Settings = Settings { glue: true, size: [480, 180], azimuth: 0.0, elevation: 5.0, ..SMALL };

#[test]
fn dots_are_shown() {
    // The only dot carries most: it is bright red, in a picture where glued bodies are grey and others pale.
    let red = |picture: &RgbImage| -> Vec<(u32, u32)> {
        let is_red = |p: &image::Rgb<u8>| p.0[0] > 150 && p.0[0] / 2 > p.0[1].max(p.0[2]);
        picture.enumerate_pixels().filter(|(_, _, p)| is_red(p)).map(|(x, y, _)| (x, y)).collect()
    };
    let file = glued(0.0);
    let shown = picture(&file, SHOWN).unwrap();
    let seen = red(&shown);
    assert!((8..100).contains(&seen.len()), "{seen:?}");
    let middle = seen.iter().map(|at| at.0).sum::<u32>() / seen.len() as u32;
    assert!((105..225).contains(&middle), "between the first and the second of three: {middle}");

    // It goes with its bodies.
    let moved = picture(&glued(-2.0), Settings { moment: Moment::Frame(0), ..SHOWN }).unwrap();
    let differences =
        shown.pixels().zip(moved.pixels()).filter(|(a, b)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 24));
    assert!(differences.count() < 200);
}

#[test]
fn a_pile_without_glue_is_refused() {
    let cube = textured_cube();
    let prop = SourceModel { name: "cube", file: "cube", bytes: &cube, node: None, resolve: &no_files, asset: None };
    let scene = ExportScene { props: vec![prop], scenery: vec![], ..Default::default() };
    let plain = encode(Format::Glb, &pile_of(&[(0, 1.0)], tumbling(1, 2)), &scene).unwrap();
    for bytes in [&plain, &kit()] {
        let refused = picture(bytes, SHOWN).unwrap_err().to_string();
        assert!(refused.contains("has no glue") && refused.contains("--set glue=as_modelled"), "{refused}");
    }
    let good = json!({ "bodies": [0, null], "point": [0, 0, 0], "force": [0, 0, 0], "moment": [0, 0, 0] });
    let file = |dots: Value| {
        let mut json = kit_json();
        json["nodes"][0]["name"] = json!("pile");
        json["nodes"][0]["extras"] = json!({ "cairn": { "glue": { "dots": dots, "clusters": [], "anchored": [0] } } });
        json.to_string().into_bytes()
    };
    picture(&file(json!([good])), SHOWN).unwrap();
    for (key, value) in
        [("bodies", json!([99, null])), ("bodies", json!(3)), ("point", json!([1])), ("force", json!(null))]
    {
        let mut dot = good.clone();
        dot[key] = value;
        let refused = picture(&file(json!([dot])), SHOWN).unwrap_err().to_string();
        assert!(refused.contains("cannot be read"), "{refused}");
    }
    for dots in [json!(null), json!({}), json!([1])] {
        assert!(picture(&file(dots), SHOWN).is_err());
    }
}

#[test]
fn a_view_says_which_body_is_where() {
    let frames = tumbling(3, 5);
    let file = baked(frames.clone());
    let model = RenderModel { name: "file.glb", bytes: &file, resolve: &no_files };
    let moments = [Moment::Frame(4), Moment::Frame(0)];
    let settings = Settings { fit: Some(Moment::Frame(4)), wide: 2.0, ..SMALL };
    let seen = views(&model, &moments, &settings).unwrap();
    let [width, height] = seen.size.map(|side| side as usize);
    assert_eq!((seen.bodies.len(), seen.depths.len()), (2 * width * height, 2 * width * height));
    for (state, &frame) in [4, 0].iter().enumerate() {
        let of = state * width * height;
        for (body, pose) in frames[frame].iter().enumerate() {
            // The world's point in the camera's frame: its axes are orthonormal.
            let column = |k: usize| DVec3::new(seen.camera[k], seen.camera[4 + k], seen.camera[8 + k]);
            let from = pose.translation - column(3);
            let (x, y, depth) = (from.dot(column(0)), -from.dot(column(1)), -from.dot(column(2)));
            let [fx, _, cx, _, fy, cy, ..] = seen.intrinsics;
            let at = (fy * y / depth + cy) as usize * width + (fx * x / depth + cx) as usize;
            // Some props have no matter in the middle of their frame, and a body may hide another.
            if seen.bodies[of + at] == body as i32 {
                let behind = depth - f64::from(seen.depths[of + at]);
                assert!((-0.1..2.0).contains(&behind), "body {body} of frame {frame}: {behind}");
            }
        }
        let shown = &seen.bodies[of..of + width * height];
        assert!((0..3).all(|body| shown.contains(&body)), "frame {frame}");
        let is_told = |(body, depth): (&i32, &f32)| (*body == -1) == depth.is_infinite();
        assert!(shown.iter().zip(&seen.depths[of..]).all(is_told), "frame {frame}: depth where a body is");
    }
}
