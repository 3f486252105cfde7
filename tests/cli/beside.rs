//! Piles beside each other: several in one bake, and around earlier results.

use crate::cli::desk::{Desk, box_data, box_json, glb};
use serde_json::{Value, json};

/// A desk with `left.glb` and `right.glb`, boxes of 0.6 x 0.4 x 0.6 m on the ground that overlap by a third, and the
/// prop `crumb.glb`.
fn desk() -> Desk {
    let desk = Desk::new();
    for (name, x) in [("left.glb", -0.2), ("right.glb", 0.2)] {
        let mut document = box_json();
        document["nodes"][0]["translation"] = json!([x, 0.2, 0.0]);
        desk.write(name, glb(&document, &box_data([0.6, 0.4, 0.6])));
    }
    desk.write("crumb.glb", glb(&box_json(), &box_data([0.14, 0.08, 0.1])));
    desk
}

/// The prop and the place of each body at the end.
fn bodies(desk: &Desk, result: &str) -> Vec<(u64, [f64; 3])> {
    let pile: Value = serde_json::from_slice(&std::fs::read(desk.path(result)).unwrap()).unwrap();
    let last = pile["frames"].as_array().unwrap().last().unwrap().as_array().unwrap().clone();
    let number = |value: &Value| value.as_f64().unwrap();
    let all = pile["bodies"].as_array().unwrap().iter().zip(&last);
    all.map(|(body, pose)| (body["prop"].as_u64().unwrap(), [0, 1, 2].map(|axis| number(&pose[axis])))).collect()
}

const HOW: &str = "--prop crumb.glb --accuracy draft --seed 3";

/// The second pile is built around the first one as it lies in the end; it is no part of the new result, which can be
/// baked again.
#[test]
fn a_pile_is_baked_around_an_earlier_one() {
    let desk = desk();
    for (shape, more, result) in [
        ("left", "", "left-pile.glb"),
        ("left", "", "left-pile.json"),
        ("right", "", "void.json"),
        ("right", "--around left-pile.glb", "right-pile.json"),
        ("right", "--around left-pile.glb", "right-pile.glb"),
    ] {
        desk.line(&format!("bake --control {shape}.glb {HOW} {more} -o {result} --report report.json")).ok();
    }
    let report: Value = serde_json::from_slice(&std::fs::read(desk.path("report.json")).unwrap()).unwrap();
    let depth = report["measures"]["scenery_penetration_max_rel"].as_f64().unwrap();
    assert!(depth < 0.1, "bodies reach into the earlier pile by {depth} of their thickness");

    let [left, void, right] = ["left-pile.json", "void.json", "right-pile.json"].map(|name| bodies(&desk, name));
    assert!(right.len() < void.len() * 9 / 10, "{} beside the other pile, {} without", right.len(), void.len());
    assert!(right.len() > void.len() / 3, "{} beside the other pile, {} without", right.len(), void.len());
    for (_, place) in &right {
        let distance = |other: &[f64; 3]| (0..3).map(|axis| (place[axis] - other[axis]).powi(2)).sum::<f64>().sqrt();
        let nearest = left.iter().map(|(_, other)| distance(other)).fold(f64::INFINITY, f64::min);
        assert!(nearest > 0.06, "two bodies are {nearest} m apart, less than the thickness of one");
    }
    // The same bytes, from the result and its files.
    desk.line("verify right-pile.glb").ok();
}

/// Each of several shapes is filled; what overlaps is filled once.
#[test]
fn several_piles_are_baked_at_once() {
    let desk = desk();
    desk.line(&format!("bake --control left.glb --control right.glb {HOW} -o both.json")).ok();
    let both = bodies(&desk, "both.json");
    let out = |side: f64| both.iter().filter(|(_, place)| side * place[0] > 0.2).count();
    assert!(out(-1.0) > 10 && out(1.0) > 10, "{} left, {} right", out(-1.0), out(1.0));
    // Each its own prop, by a scene file.
    desk.write(
        "scene.toml",
        r#"
accuracy = "draft"
[[props]]
path = "crumb.glb"
[[props]]
path = "brick.glb"
scale_min = 0.3
scale_max = 0.4
[[piles]]
path = "left.glb"
props = ["crumb"]
[[piles]]
path = "right.glb"
props = ["brick"]
seed = 5
"#,
    );
    desk.line("bake scene.toml -o own.json").ok();
    let own = bodies(&desk, "own.json");
    let middle = |prop: u64| {
        let places: Vec<f64> = own.iter().filter(|(of, _)| *of == prop).map(|(_, place)| place[0]).collect();
        places.iter().sum::<f64>() / places.len() as f64
    };
    assert!(middle(0) < -0.1 && middle(1) > 0.2, "{} and {}", middle(0), middle(1));
    let done = desk.line("check scene.toml --set piles.1.props.0=stone");
    done.fails(65, &["piles.1.props.0", "no prop is called `stone`"]);
    desk.line("check scene.toml --set piles.1.seed=-4").fails(65, &["piles.1.seed"]);
}
