//! The glue in results.

use crate::output::files::encode;
use crate::output::files::{kit, kit_json, no_files, pile_of, textured_cube, tumbling};
use crate::output::reader::{json_of, read_valid, world_matrix};
use cairn_core::report::bake::{Bake, BakedPile};
use cairn_core::report::{BakedGlue, BakedGlueDot};
use cairn_export::{ExportScene, Format, SourceModel};
use cairn_input::observer::{Frame, Observer, Progress};
use cairn_job::Job;
use cairn_job::reuse::BakeCache;
use cairn_wire::scene_file::SceneTree;
use glam::DVec3;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::ops::ControlFlow;

/// A node's extras, as the reader gives them.
fn extras(node: &gltf::Node) -> Option<Value> {
    node.extras().as_ref().map(|extras| serde_json::from_str(extras.get()).unwrap())
}

/// The expected extras of the node `pile`.
fn entries(glue: &BakedGlue) -> Value {
    let dots: Vec<Value> = (glue.dots.iter())
        .map(|dot| {
            json!({
                "bodies": [dot.body, dot.other], "point": dot.point, "normal": dot.normal, "force": dot.force,
                "moment": dot.moment, "broken": dot.is_broken,
            })
        })
        .collect();
    json!({ "dots": dots, "clusters": glue.clusters, "anchored": glue.anchored })
}

/// Nodes and tables agree with the report.
fn tells_its_glue(pile: &BakedPile, bytes: &[u8]) {
    let glue = pile.glue.as_ref().unwrap();
    let file = read_valid(bytes);
    let node = file.document.nodes().find(|node| node.name() == Some("pile")).unwrap();
    let mut all = extras(&node).unwrap();
    // What a later bake needs, beside the glue.
    let state = all["cairn"].as_object_mut().unwrap().remove("state");
    assert_eq!(state.is_some(), pile.filled > 0);
    assert_eq!(all, json!({ "fps": pile.fps, "frames": pile.frames.len(), "cairn": { "glue": entries(glue) } }));
    for (body, node) in node.children().enumerate() {
        let cluster = glue.clusters.iter().position(|members| members.contains(&body));
        let anchored = glue.anchored.contains(&body);
        let expected = json!({ "cluster": cluster, "anchored": anchored });
        let found = extras(&node).and_then(|extras| extras.get("cairn").cloned());
        assert_eq!(found, (cluster.is_some() || anchored).then_some(expected), "body {body}");
    }
}

pub fn dot(body: usize, other: Option<usize>, point: [f64; 3], force: f64, is_broken: bool) -> BakedGlueDot {
    BakedGlueDot {
        body,
        other,
        point,
        normal: [0.0, 1.0, 0.0],
        force: [0.0, force, 0.0],
        moment: [0.0; 3],
        limit: [f64::INFINITY; 2],
        is_broken,
    }
}

#[test]
fn extras_are_merged() {
    let mut with_extras = kit_json();
    with_extras["nodes"] = json!([{ "mesh": 0, "extras": { "mine": 7, "cairn": { "cluster": 3, "anchored": true } } }]);
    let with_extras = with_extras.to_string().into_bytes();
    let mut with_text = kit_json();
    with_text["nodes"] = json!([{ "mesh": 0, "extras": "mine" }]);
    let (cube, kit, with_text) = (textured_cube(), kit(), with_text.to_string().into_bytes());
    let prop = |bytes| SourceModel { name: "prop", file: "prop", bytes, node: None, resolve: &no_files, asset: None };
    let props = [&cube, &kit, &with_extras, &with_text].map(|bytes| prop(bytes)).to_vec();
    let scene = ExportScene { props, scenery: vec![], ..Default::default() };
    let bodies = [0, 1, 2, 2, 3, 3, 0].map(|prop| (prop, 1.0));
    let mut pile = pile_of(&bodies, tumbling(bodies.len(), 3));
    let plain = json_of(&encode(Format::Glb, &pile, &scene).unwrap());
    assert_eq!(plain["nodes"][0]["extras"], json!({ "fps": 24.0, "frames": 3 }));
    assert_eq!(
        plain["nodes"][3]["extras"],
        json!({ "mine": 7 }),
        "an earlier bake's word on its own bodies is left out"
    );
    let table = encode(Format::Json, &pile, &scene).unwrap();
    assert_eq!(serde_json::from_slice::<Value>(&table).unwrap().get("glue"), None);

    pile.glue = Some(BakedGlue {
        dots: vec![
            dot(0, Some(1), [1.0, 2.0, 3.0], 2.5, false),
            dot(2, Some(1), [0.5; 3], 1.0, false),
            dot(4, None, [0.0; 3], 0.125, false),
            dot(5, Some(6), [0.0; 3], 3.0, true),
        ],
        clusters: vec![vec![0, 1, 2]],
        anchored: vec![4],
    });
    let bytes = encode(Format::Glb, &pile, &scene).unwrap();
    tells_its_glue(&pile, &bytes);
    let nodes = &json_of(&bytes)["nodes"];
    assert_eq!(nodes[3]["extras"], json!({ "mine": 7, "cairn": { "cluster": 0, "anchored": false } }));
    assert_eq!(nodes[4]["extras"], json!({ "mine": 7 }));
    assert_eq!(nodes[5]["extras"], json!({ "value": "mine", "cairn": { "cluster": null, "anchored": true } }));
    assert_eq!(nodes[6]["extras"], json!("mine"));
    assert_eq!(nodes[7].get("extras"), None, "its only dot broke");
    let table: Value = serde_json::from_slice(&encode(Format::Json, &pile, &scene).unwrap()).unwrap();
    assert_eq!(table["glue"], entries(pile.glue.as_ref().unwrap()));
}

/// Wants nothing but the result.
struct Patient;

impl Observer for Patient {
    fn progress(&mut self, _: &Progress) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn frame(&mut self, _: &Frame) {}

    fn cpu_seconds(&mut self) -> f64 {
        0.0
    }
}

/// A letter T of long sticks: its arms hang on glue, and so does its foot.
fn letter() -> (Bake, Vec<u8>) {
    let assets = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/assets");
    let mut tree = SceneTree::default();
    tree.put("control_mesh", json!({ "path": format!("{assets}/letter-t.glb") }));
    tree.put("props", json!([{ "path": format!("{assets}/stick.glb"), "scale_min": 1.8, "scale_max": 1.8 }]));
    tree.put("accuracy", json!("ACCURACY_DRAFT"));
    let job = Job::read(&tree.to_message()).unwrap();
    let done = job.run(Format::Glb, "pile.glb", &mut BakeCache::none(), &mut Patient).unwrap();
    (done.bake, done.result.bytes)
}

#[test]
fn a_baked_letter_tells_its_glue() {
    let (bake, bytes) = letter();
    tells_its_glue(&bake.pile, &bytes);
    let glue = bake.pile.glue.as_ref().unwrap();
    assert!(glue.dots.len() > 10 && !glue.clusters.is_empty(), "{glue:?}");
    assert_eq!(glue.dots.len() as u64, bake.report.counts["glue_dots"]);
    assert_eq!(glue.clusters.len() as u64, bake.report.counts["glue_clusters"]);

    // Each dot lies between its two bodies. A stick is a box: as long as its mesh's bounds say.
    let file = read_valid(&bytes);
    let bounds = file.document.meshes().next().unwrap().primitives().next().unwrap().bounding_box();
    let [low, high] = [bounds.min, bounds.max].map(|corner| DVec3::from(corner.map(f64::from)));
    let thickness = (high - low).min_element() * bake.pile.bodies[0].scale;
    let pile = file.document.nodes().find(|node| node.name() == Some("pile")).unwrap();
    let names: Vec<String> = pile.children().map(|node| node.name().unwrap().to_owned()).collect();
    let end = (bake.pile.frames.len() - 1) as f64 / bake.pile.fps;
    let from_surface = |body: usize, point: DVec3| {
        let world = world_matrix(&file, &names[body], end);
        let inside = world.inverse().transform_point3(point);
        let out = (inside - (low + high) / 2.0).abs() - (high - low) / 2.0;
        (out.max(DVec3::ZERO).length() + out.max_element().min(0.0)) * bake.pile.bodies[body].scale
    };
    // A peg joins what is up to half a thickness from the ground: its dot lies in the middle of the gap.
    const REACH: f64 = 0.26;
    let mut joined = BTreeSet::new();
    for dot in &glue.dots {
        let point = DVec3::from(dot.point);
        for body in [Some(dot.body), dot.other].into_iter().flatten() {
            let distance = from_surface(body, point);
            assert!(distance.abs() < REACH * thickness, "{distance} m from body {body} of thickness {thickness}");
            joined.insert(body);
        }
        assert!(dot.other.is_some() || point.y.abs() < REACH * thickness, "on the ground");
        assert!((DVec3::from(dot.normal).length() - 1.0).abs() < 1e-9);
    }
    let held: BTreeSet<usize> = glue.clusters.iter().flatten().chain(&glue.anchored).copied().collect();
    assert_eq!(held, joined, "nothing broke: every body with a dot is held by it");
}
