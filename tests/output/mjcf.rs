//! Models for MuJoCo. `tests/elsewhere/` opens them there.

use crate::output::files::{encode, no_files, pile_of, textured_cube, tumbling};
use cairn_core::report::BakedGlue;
use cairn_engine::shape::Solid;
use cairn_export::{ExportScene, Format, SourceModel};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::scene::{Model, StaticModel};
use glam::DVec3;
use std::collections::BTreeMap;

/// The attributes of all elements of a kind.
fn elements(text: &str, kind: &str) -> Vec<BTreeMap<String, String>> {
    let mut reader = quick_xml::Reader::from_str(text);
    let mut found = Vec::new();
    loop {
        let element = match reader.read_event().unwrap() {
            quick_xml::events::Event::Eof => return found,
            quick_xml::events::Event::Start(element) | quick_xml::events::Event::Empty(element) => element,
            _ => continue,
        };
        if element.name().as_ref() == kind {
            let attributes = element.attributes().map(|attribute| {
                let attribute = attribute.unwrap();
                let value = attribute.normalized_value(quick_xml::XmlVersion::default()).unwrap().into_owned();
                (attribute.key.as_ref().to_owned(), value)
            });
            found.push(attributes.collect());
        }
    }
}

#[test]
fn glued_bodies_are_one_body_of_the_model() {
    let cube = textured_cube();
    let prop =
        SourceModel { name: "a <\"b\"> & c", file: "prop", bytes: &cube, node: None, resolve: &no_files, asset: None };
    let scene = ExportScene { props: vec![prop], scenery: vec![], ..Default::default() };
    let mut pile = pile_of(&[(0, 1.0), (0, 2.0), (0, 1.0), (0, 1.0)], tumbling(4, 3));
    pile.glue = Some(BakedGlue { dots: vec![], clusters: vec![vec![0, 1]], anchored: vec![3] });
    let text = String::from_utf8(encode(Format::Mjcf, &pile, &scene).unwrap()).unwrap();
    let named = |kind: &str, key: &str| -> Vec<String> {
        elements(&text, kind).into_iter().filter_map(|mut element| element.remove(key)).collect()
    };
    let (bodies, geoms) = (named("body", "name"), named("geom", "name"));
    let joints = elements(&text, "freejoint").len();
    let masses: Vec<f64> = named("inertial", "mass").iter().map(|mass| mass.parse().unwrap()).collect();
    assert_eq!(bodies, ["cluster.0", "a <\"b\"> & c.0002", "a <\"b\"> & c.0003"]);
    assert_eq!(joints, 2, "one is glued to the ground");
    assert_eq!(geoms.len(), 1 + 4, "the ground, and a part of each body");
    assert_eq!(masses, [1.0 + 8.0, 1.0, 1.0], "mass grows with the cube of the scale");
}

#[test]
fn what_the_scene_keeps_and_scenery_stand_still() {
    let cube = textured_cube();
    let prop = SourceModel { name: "cube", file: "cube", bytes: &cube, node: None, resolve: &no_files, asset: None };
    // A slope of two triangles, one of them far away; it stands 1 m to the side in the last frame.
    let corner = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    let near = [corner(-1.0, 0.0, -1.0), corner(-1.0, 0.0, 1.0), corner(1.0, 1.0, 0.0)];
    let points = near.iter().copied().chain(near.iter().map(|p| *p + DVec3::X * 1000.0)).collect();
    let mesh = TriMesh { points, triangles: vec![[0, 1, 2], [3, 4, 5]] };
    let model = Model { name: "slope".into(), mesh, is_skinned: false };
    let colliders = [StaticModel { model, friction: 0.25, keys: vec![] }];
    let scene = ExportScene { props: vec![prop], colliders: &colliders, ..Default::default() };
    let mut pile = pile_of(&[(0, 1.0), (0, 1.0)], tumbling(2, 3));
    pile.bodies[1].is_pinned = true;
    pile.bodies[0].mass_factor = 3.0;
    pile.scenery = vec![vec![Pose::IDENTITY, Pose { translation: DVec3::Y, ..Pose::IDENTITY }]];
    let encoded = cairn_export::encode(Format::Mjcf, &pile, &scene).unwrap();
    let [left_out] = &encoded.left_out[..] else { panic!("{:?}", encoded.left_out) };
    assert!(left_out.starts_with("scenery: 1 of its 2 triangles are not in the MuJoCo model"), "{left_out}");
    let text = String::from_utf8(encoded.bytes).unwrap();
    assert_eq!(elements(&text, "freejoint").len(), 1);
    let masses: Vec<f64> = elements(&text, "inertial").iter().map(|body| body["mass"].parse().unwrap()).collect();
    assert_eq!(masses, [3.0, 1.0]);
    let geoms = elements(&text, "geom");
    let geom = geoms.iter().find(|geom| geom.get("name").is_some_and(|name| name == "scenery.0.0")).unwrap();
    assert_eq!(geom["friction"].split(' ').next().unwrap().parse::<f64>().unwrap(), 0.25);
    let meshes = elements(&text, "mesh");
    let corners: Vec<f64> = meshes[0]["vertex"].split(' ').map(|number| number.parse().unwrap()).collect();
    // Z up: the lowest corner of the thin plate is where the slope begins, in the last frame.
    let lowest = corners.chunks(3).map(|corner| corner[2]).fold(f64::INFINITY, f64::min);
    assert!((lowest - 1.0).abs() < 0.05, "{lowest}");
}

/// A grain of 0.4 mm, and the same as a stone of 0.4 m.
#[test]
fn grains_that_mujoco_would_refuse_are_in_smaller_units() {
    const GRAIN: f64 = 4e-4;
    let cube = textured_cube();
    let prop = SourceModel { name: "grain", file: "grain", bytes: &cube, node: None, resolve: &no_files, asset: None };
    let mesh = TriMesh { points: vec![DVec3::ZERO, DVec3::X, DVec3::Z], triangles: vec![[0, 2, 1]] };
    let model = Model { name: "floor".into(), mesh, is_skinned: false };
    let model_of = |size: f64| {
        let floor = model.mesh.scaled(size);
        let colliders = [StaticModel { model: Model { mesh: floor, ..model.clone() }, friction: 0.5, keys: vec![] }];
        let scene = ExportScene { props: vec![prop], colliders: &colliders, ..Default::default() };
        let mut pile = pile_of(&[(0, 1.0)], tumbling(1, 2));
        pile.frames.iter_mut().flatten().for_each(|pose| pose.translation *= size);
        pile.world.diameter = size;
        let corner =
            |i: u32| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)) - DVec3::splat(0.5);
        let solid = &mut pile.solids[0];
        solid.solid = Solid::Convex(vec![(0..8).map(|i| corner(i) * size).collect()]);
        solid.mass = 1000.0 * size.powi(3);
        solid.inertia.0 = DVec3::splat(solid.mass * size * size / 6.0);
        let encoded = cairn_export::encode(Format::Mjcf, &pile, &scene).unwrap();
        (String::from_utf8(encoded.bytes).unwrap(), encoded.left_out)
    };
    let numbers = |text: &str, kind: &str, key: &str| -> Vec<f64> {
        let all = elements(text, kind).into_iter().filter_map(|mut element| element.remove(key));
        all.flat_map(|list| list.split(' ').map(|number| number.parse().unwrap()).collect::<Vec<f64>>()).collect()
    };
    let ((grain, notes), (stone, nothing)) = (model_of(GRAIN), model_of(1e3 * GRAIN));
    let [note] = &notes[..] else { panic!("{notes:?}") };
    assert!(note.starts_with("the MuJoCo model is in millimeters and grams"), "{note}");
    assert!(nothing.is_empty() && elements(&stone, "numeric").is_empty(), "{nothing:?}");
    assert_eq!(numbers(&grain, "numeric", "data"), [1e-3, 1e-3]);
    // In its own units it is as large as the stone, a millionth as heavy, and falls a thousand times as fast.
    let is_near = |kind: &str, key: &str, factor: f64| {
        let (small, large) = (numbers(&grain, kind, key), numbers(&stone, kind, key));
        assert!(!small.is_empty() && small.len() == large.len(), "{kind} {key}");
        for (a, b) in small.iter().zip(large) {
            assert!((a - factor * b).abs() <= 1e-6 * (factor * b).abs() + 1e-9 * factor, "{kind} {key}: {a} {b}");
        }
    };
    for (kind, key) in [("mesh", "vertex"), ("body", "pos"), ("geom", "pos"), ("geom", "friction")] {
        is_near(kind, key, 1.0);
    }
    is_near("inertial", "mass", 1e-6);
    is_near("inertial", "fullinertia", 1e-6);
    is_near("option", "gravity", 1e3);
    let least = numbers(&grain, "inertial", "fullinertia").into_iter().take(3).fold(f64::INFINITY, f64::min);
    assert!(least > 1e-13, "{least}");
}
