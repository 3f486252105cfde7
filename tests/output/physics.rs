//! A `.glb` for engines, and one of collision shapes.

use crate::output::files::{encode, far_from_its_origin, no_files, pile_of, textured_cube, tumbling};
use cairn_core::report::BakedGlue;
use cairn_core::report::bake::BakedPile;
use cairn_engine::shape::Solid;
use cairn_export::{ExportScene, Format, SourceModel};
use cairn_geometry::mesh::TriMesh;
use cairn_input::scene::{Model, StaticModel};
use glam::DVec3;
use serde_json::{Value, json};

/// The JSON of a pile of cubes beside a triangle.
fn json_of(format: Format, pile: &BakedPile) -> Value {
    let cube = textured_cube();
    let prop = SourceModel { name: "cube", file: "cube", bytes: &cube, node: None, resolve: &no_files, asset: None };
    let mesh = TriMesh { points: vec![DVec3::ZERO, DVec3::X, DVec3::Y], triangles: vec![[0, 1, 2]] };
    let model = Model { name: "slope".into(), mesh, is_skinned: false };
    let colliders = [StaticModel { model, friction: 0.25, keys: vec![] }];
    let scene = ExportScene { props: vec![prop], colliders: &colliders, ..Default::default() };
    let bytes = encode(format, pile, &scene).unwrap();
    gltf::Gltf::from_slice(&bytes).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&bytes[20..20 + length]).unwrap()
}

fn node<'a>(json: &'a Value, name: &str) -> &'a Value {
    json["nodes"].as_array().unwrap().iter().find(|node| node["name"] == name).unwrap_or_else(|| panic!("{name}"))
}

fn children<'a>(json: &'a Value, node: &Value) -> Vec<&'a str> {
    let all = node["children"].as_array().unwrap();
    all.iter().map(|child| json["nodes"][child.as_u64().unwrap() as usize]["name"].as_str().unwrap()).collect()
}

/// The physics of a node.
fn physics<'a>(json: &'a Value, name: &str) -> &'a Value {
    &node(json, name)["extensions"]["KHR_physics_rigid_bodies"]
}

#[test]
fn bodies_move_and_what_stands_does_not() {
    let mut pile = pile_of(&[(0, 1.0), (0, 2.0), (0, 1.0), (0, 1.0)], tumbling(4, 3));
    pile.bodies[3].is_pinned = true;
    pile.solids[0].restitution = 0.6;
    pile.glue = Some(BakedGlue { dots: vec![], clusters: vec![vec![0, 1]], anchored: vec![] });
    let json = json_of(Format::GlbPhysics, &pile);
    assert!(json.get("animations").is_none(), "an animation would come before the simulation");
    for used in ["KHR_implicit_shapes", "KHR_physics_rigid_bodies"] {
        assert!(json["extensionsUsed"].as_array().unwrap().contains(&json!(used)), "{used}");
    }
    assert_eq!(children(&json, node(&json, "pile")), ["cluster.0", "cube.0002", "cube.0003"]);
    assert_eq!(children(&json, node(&json, "cluster.0")), ["cube.0000", "cube.0001"]);
    assert_eq!(children(&json, node(&json, "cube.0002")), ["cube.0002.look", "cube.0002.0"]);
    assert_eq!(physics(&json, "cluster.0")["motion"]["mass"], 9.0);
    assert_eq!(physics(&json, "cube.0002")["motion"]["inertiaDiagonal"], json!([1.0, 1.0, 1.0]));
    assert!(physics(&json, "cube.0003").is_null() && physics(&json, "cube.0000").is_null());
    let collider = &physics(&json, "cube.0001.0")["collider"];
    let shape =
        &json["extensions"]["KHR_implicit_shapes"]["shapes"][collider["geometry"]["shape"].as_u64().unwrap() as usize];
    assert_eq!(*shape, json!({ "type": "sphere", "sphere": { "radius": 0.5 } }));
    assert_eq!(node(&json, "cube.0001.0")["scale"], json!([2.0, 2.0, 2.0]));
    // The top of the ground is at its height.
    assert_eq!(node(&json, "ground")["translation"][1], -50.0);
    let of_material = |name: &str, what: &str| {
        let material = physics(&json, name)["collider"]["physicsMaterial"].as_u64().unwrap() as usize;
        json["extensions"]["KHR_physics_rigid_bodies"]["physicsMaterials"][material][what].as_f64().unwrap()
    };
    let friction = |name: &str| of_material(name, "dynamicFriction");
    let restitution = |name: &str| of_material(name, "restitution");
    assert_eq!([restitution("cube.0001.0"), restitution("ground"), restitution("scenery.0")], [0.6, 0.0, 0.0]);
    assert_eq!([friction("cube.0001.0"), friction("ground"), friction("scenery.0")], [0.7, 0.7, 0.25]);
}

#[test]
fn hulls_move_as_the_bodies() {
    let part = |x: f64| -> Vec<DVec3> {
        (0..8).map(|i| DVec3::new(x + f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2))).collect()
    };
    let mut pile = far_from_its_origin(3);
    pile.solids[0].center = pile.solids[0].pivot;
    pile.solids[0].solid = Solid::Convex(vec![part(0.0), part(2.0)]);
    let (hulls, looks) = (json_of(Format::GlbHulls, &pile), json_of(Format::Glb, &pile));
    let moved = |json: &Value| -> Vec<Value> {
        let channels = json["animations"][0]["channels"].as_array().unwrap();
        channels.iter().map(|channel| channel["target"].clone()).collect()
    };
    assert_eq!(moved(&hulls), moved(&looks));
    assert_eq!(node(&hulls, "cube.0000")["translation"], node(&looks, "cube.0000")["translation"]);
    assert_eq!(children(&hulls, node(&hulls, "cube.0000")), ["cube.0000.0", "cube.0000.1"]);
    let mesh = node(&hulls, "cube.0000.1")["mesh"].as_u64().unwrap() as usize;
    let primitive = &hulls["meshes"][mesh]["primitives"][0];
    let positions = &hulls["accessors"][primitive["attributes"]["POSITION"].as_u64().unwrap() as usize];
    assert_eq!((&positions["min"], &positions["max"]), (&json!([2.0, 0.0, 0.0]), &json!([3.0, 1.0, 1.0])));
    assert_eq!(positions["count"], 8);
    assert_eq!(children(&hulls, node(&hulls, "scenery")), ["around"]);
    assert!(hulls.get("images").is_none() && looks.get("images").is_some());
}
