//! `cairn analyse`: piles of nodes whose answers anybody can see.

use crate::cli::desk::{Desk, box_data, box_json, glb};
use serde_json::{Value, json};

/// Boxes of 0.4 x 0.2 x 0.4 with their middles here, one node each; one more node of lines.
fn pile(places: &[(&str, [f64; 3])]) -> Vec<u8> {
    let mut document = box_json();
    let node = |(name, place): &(&str, [f64; 3])| json!({ "name": name, "mesh": 0, "translation": place });
    let mut nodes: Vec<Value> = places.iter().map(node).collect();
    nodes.push(json!({ "name": "wire", "mesh": 1 }));
    document["meshes"]
        .as_array_mut()
        .unwrap()
        .push(json!({ "primitives": [{ "attributes": { "POSITION": 0 }, "mode": 1 }] }));
    document["scenes"] = json!([{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }]);
    document["nodes"] = json!(nodes);
    glb(&document, &box_data([0.4, 0.2, 0.4]))
}

/// Each box on the one before.
const TOWER: [(&str, [f64; 3]); 3] = [("low", [0.0, 0.1, 0.0]), ("middle", [0.1, 0.3, 0.0]), ("top", [0.05, 0.5, 0.0])];

fn analysed(desk: &Desk, line: &str) -> Value {
    serde_json::from_str(&desk.line(line).ok()).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[test]
fn a_tower_of_three() {
    let desk = Desk::new();
    desk.write("tower.glb", pile(&TOWER));
    let printed = desk.line("analyse tower.glb --friction 0.5 -o colors.glb --picture a.png --graph a.dot");
    assert!(printed.stderr.contains("nodes without triangles are no bodies: wire"), "{}", printed.stderr);
    assert!(printed.ok().contains("3 bodies, 3 touches: all stand"));
    let answers = analysed(&desk, "analyse tower.glb --friction 0.5 --json");
    let bodies = answers["bodies"].as_array().unwrap();
    let weight = 0.4 * 0.2 * 0.4 * 1000.0 * 9.81;
    for (body, (name, above)) in bodies.iter().zip([("low", 2), ("middle", 1), ("top", 0)]) {
        assert_eq!((&body["name"], &body["standing"]), (&json!(name), &json!("stands")));
        assert!((number(&body["load"]) - f64::from(above) * weight).abs() < 1e-3 * weight, "{name}: {}", body["load"]);
        assert_eq!(body["rests_on_it"].as_array().unwrap().len(), above as usize);
        assert_eq!(body["removal"]["is_safe"], json!(above == 0), "{name}");
    }
    assert_eq!(bodies[0]["removal"]["moving"], json!([1]));
    assert_eq!(answers["order"], json!([2, 1, 0]));
    assert_eq!(answers["stuck"], json!([]));
    // All slide at the angle of friction, 0.4, or tip: their common centre is 0.15 from the edge, at a height of 0.3.
    let tilt = |friction: f64| {
        let answers = analysed(&desk, &format!("analyse tower.glb --friction {friction} --json"));
        let whole = &answers["whole"];
        assert!(number(&whole["tilt"][1]) - number(&whole["tilt"][0]) < 0.1, "{}", whole["tilt"]);
        (number(&whole["tilt"][1]), whole["azimuth"].clone(), whole["goes_first"].clone())
    };
    assert!((tilt(0.4).0 - 0.4f64.atan().to_degrees()).abs() < 0.1, "{:?}", tilt(0.4));
    let (tips, azimuth, first) = tilt(0.9);
    assert!((tips - 0.5f64.atan().to_degrees()).abs() < 0.1, "{tips}");
    assert_eq!((azimuth, first), (json!(90.0), json!([0, 1, 2])));
    // A push at the middle one moves two of three: their contact below slides, and bears twice its weight.
    let knock = &answers["whole"]["knock_over"];
    assert_eq!((&knock["body"], &knock["comes_down"], &knock["tried"]), (&json!(1), &json!([1, 2]), &json!(3)));
    let [stands, falls] = [0, 1].map(|k| number(&knock["push"][k]));
    assert!(stands <= falls && (stands - 1.0).abs() < 0.01 && (falls - 1.0).abs() < 0.01, "{knock}");
    assert!((number(&knock["force"]) - falls * weight).abs() < 1e-6 * weight);
    let colors = std::fs::read(desk.path("colors.glb")).unwrap();
    assert!(colors.starts_with(b"glTF"));
    desk.line("analyse colors.glb --friction 0.5").ok();
    assert!(std::fs::read(desk.path("a.png")).unwrap().starts_with(b"\x89PNG"));
    desk.line("analyse tower.glb --friction 0.5 --graph a.svg").ok();
    let drawn = std::fs::read_to_string(desk.path("a.svg")).unwrap();
    let at = |name: &str| drawn.find(&format!(">{name}</text>")).unwrap_or_else(|| panic!("{drawn}"));
    assert!(
        at("low") < at("middle") && drawn.matches("<rect").count() == 4 && drawn.matches(" N</title>").count() == 6
    );
    let graph = std::fs::read_to_string(desk.path("a.dot")).unwrap();
    assert!(graph.contains("b2 -> b1") && graph.contains("b1 -> b0") && graph.contains("b0 -> ground"), "{graph}");
}

#[test]
fn an_arm_that_only_touches_is_glued() {
    let desk = Desk::new();
    desk.write("arm.glb", pile(&[("low", [0.0, 0.1, 0.0]), ("far", [0.3, 0.3, 0.0]), ("lost", [2.0, 2.0, 0.0])]));
    let answers = analysed(&desk, "analyse arm.glb --json");
    let standing: Vec<&Value> = answers["bodies"].as_array().unwrap().iter().map(|body| &body["standing"]).collect();
    assert_eq!(standing, [&json!("stands"), &json!("falls_alone"), &json!("falls_alone")]);
    assert_eq!((&answers["stands"], &answers["beyond_glue"]), (&json!(false), &json!([2])));
    let dots = answers["glue"].as_array().unwrap();
    assert_eq!((dots.len(), &dots[0]["body"], &dots[0]["other"]), (1, &json!(0), &json!(1)));
    // What hangs over stands on scenery; what is left out is not there.
    let answers = analysed(&desk, "analyse arm.glb --json --scenery far --without lost");
    assert_eq!((answers["bodies"].as_array().unwrap().len(), &answers["stands"]), (1, &json!(true)));
    let failed = desk.line("analyse arm.glb --without 'lost' --scenery Nobody --picture a.jpg");
    failed.fails(2, &["--picture: not the name of a picture", "Use the extension .png"]);
    desk.line("analyse arm.glb -o arm.gltf").fails(2, &["--output: not the name of a .glb"]);
    desk.line("analyse arm.glb --safety 2").fails(2, &["give 0 to 1"]);
}

/// As results of Cairn have it: the children of the node `pile` are the bodies, with the friction and the gravity of
/// their scene.
#[test]
fn a_result_is_known() {
    let desk = Desk::new();
    let mut document = box_json();
    document["nodes"] = json!([
        { "name": "pile", "children": [1, 2], "extras": { "cairn": { "glue": { "dots": [{}] } } } },
        { "name": "stick.glb.0000", "mesh": 0, "translation": [0.0, 0.1, 0.0] },
        { "name": "stick.glb.0001", "mesh": 0, "translation": [0.0, 0.3, 0.0], "scale": [0.5, 1.0, 0.5] },
        { "name": "table", "mesh": 0, "translation": [5.0, 0.1, 0.0] },
    ]);
    document["scenes"] = json!([{ "nodes": [0, 3] }]);
    let prop = json!({ "path": "kit/stick.glb", "friction": 0.3, "density": 500.0 });
    document["asset"]["extras"]["cairn"]["scene"] = json!({ "gravity": 3.7, "ground_friction": 0.3, "props": [prop] });
    desk.write("pile.glb", glb(&document, &box_data([0.4, 0.2, 0.4])));
    let done = desk.line("analyse pile.glb --json");
    assert!(done.stderr.contains("the pile is glued; it is analysed as if it had no glue"), "{}", done.stderr);
    let answers: Value = serde_json::from_str(&done.ok()).unwrap();
    let bodies = answers["bodies"].as_array().unwrap();
    assert_eq!(bodies.len(), 2);
    assert!((number(&bodies[0]["load"]) - 0.2 * 0.2 * 0.2 * 500.0 * 3.7).abs() < 1e-3, "{}", bodies[0]["load"]);
    assert!(
        (number(&answers["whole"]["tilt"][1]) - 0.3f64.atan().to_degrees()).abs() < 0.1,
        "{}",
        answers["whole"]["tilt"]
    );
}

/// Of what a large pile needs, hardly anything is a cone program of the whole.
#[test]
fn a_large_pile_is_proven_by_its_forces() {
    const ROWS: usize = 24;
    const ACROSS: usize = 18;
    let desk = Desk::new();
    let mut places = Vec::new();
    for row in 0..ROWS {
        for at in 0..ACROSS - row % 2 {
            let x = 0.41 * (at as f64 + 0.5 * (row % 2) as f64);
            places.push(("brick", [x, 0.1 + 0.2 * row as f64, 0.0]));
        }
    }
    desk.write("wall.glb", pile(&places));
    let found = analysed(&desk, "analyse wall.glb --json");
    assert_eq!(found["stands"], true);
    assert!(number(&found["imbalance"]) <= 1e-5, "{}", found["imbalance"]);
    let bodies = found["bodies"].as_array().unwrap();
    let top = bodies.len() - (ACROSS - (ROWS - 1) % 2);
    // Those at its ends keep the ones below from tipping.
    assert!(bodies[top + 1..bodies.len() - 1].iter().all(|body| body["removal"]["is_safe"] == true));
    assert!([top, bodies.len() - 1].iter().all(|&at| bodies[at]["removal"]["is_safe"] == false));
    assert!(bodies[top..].iter().all(|body| number(&body["load_in_weights"]) < 0.01), "nothing lies on the top row");
    assert_eq!(found["order"].as_array().unwrap().len() + found["stuck"].as_array().unwrap().len(), bodies.len());
    // The share of its weight that a wall can bear sideways is known on both sides.
    let tilt = &found["whole"]["tilt"];
    assert!(number(&tilt[0]) <= number(&tilt[1]) && number(&tilt[1]) < 45.0, "{tilt}");
    assert!(number(&found["programs"]) < 500.0, "{}", found["programs"]);
}

/// What hangs out too far moves back with what it carries, and what floats comes down: no farther than is needed.
#[test]
fn a_nudge_makes_it_stand() {
    let desk = Desk::new();
    let places =
        [("table", [0.0, 0.1, 0.0]), ("out", [0.23, 0.3, 0.0]), ("on", [0.25, 0.5, 0.0]), ("floats", [3.0, 0.13, 0.0])];
    desk.write("near.glb", pile(&places));
    let done = desk.line("analyse near.glb");
    assert!(done.stdout.contains("or stands without glue once moved: out by ("), "{}", done.stdout);
    let found: Value = serde_json::from_str(&desk.line("analyse near.glb --json").stdout).unwrap();
    assert_eq!((&found["stands"], &found["beyond_nudges"]), (&json!(false), &json!([])));
    let nudges = found["nudges"].as_array().unwrap();
    let bodies: Vec<u64> = nudges.iter().map(|nudge| nudge["body"].as_u64().unwrap()).collect();
    assert_eq!(bodies, [1, 2, 3]);
    let by = |at: usize, axis: usize| number(&nudges[at]["by"][axis]);
    // The common middle of both is 0.24 out, and the table ends at 0.2.
    assert!((-0.08..-0.04).contains(&by(0, 0)) && by(0, 0) == by(1, 0) && by(0, 1) == 0.0, "{nudges:?}");
    assert!((by(2, 1) + 0.03).abs() < 1e-3 && by(2, 0) == 0.0, "{nudges:?}");
    let moved: Vec<(&str, [f64; 3])> = (0..4)
        .map(|at| {
            let nudge = bodies.iter().position(|&body| body == at as u64);
            let along = |axis: usize| places[at].1[axis] + nudge.map_or(0.0, |nudge| by(nudge, axis));
            (places[at].0, [0, 1, 2].map(along))
        })
        .collect();
    desk.write("moved.glb", pile(&moved));
    let found = analysed(&desk, "analyse moved.glb --json");
    assert_eq!((&found["stands"], &found["nudges"]), (&json!(true), &json!([])));
}
