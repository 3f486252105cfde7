//! `cairn bake --budget` and `--overlap`: a goal chooses the accuracy.

use crate::desk::{Desk, Done};
use serde_json::Value;

/// Two sticks that are built into each other: kept bodies stay as they are, at every accuracy.
const CROSSED: &str = "
[[props]]
path = 'stick.glb'
[[bodies]]
prop = 'stick'
position = [0, 1, 0]
kept = true
[[bodies]]
prop = 'stick'
position = [0, 1, 0]
rotation = [0, 0.7071068, 0, 0.7071068]
kept = true
[[bodies]]
prop = 'stick'
position = [2, 0.1, 0]
";

fn accuracy(desk: &Desk) -> String {
    let report: Value = serde_json::from_slice(&std::fs::read(desk.path("report.json")).unwrap()).unwrap();
    report["scene"]["accuracy"].as_str().unwrap().to_owned()
}

fn bake(desk: &Desk, goal: &str) -> Done {
    let scene = "--control cone.glb --prop stick.glb --set fill.count=3 --frames 2";
    desk.line(&format!("bake {scene} -o pile.glb --report report.json {goal}"))
}

#[test]
fn a_time_chooses_the_accuracy() {
    let desk = Desk::new();
    let done = bake(&desk, "--budget 1h");
    assert!(done.stderr.contains("accuracy reference, expected to take up to"), "{}", done.stderr);
    done.ok();
    assert_eq!(accuracy(&desk), "reference");
    // Nothing is that quick: the quickest is baked, and both are said.
    let done = bake(&desk, "--budget 1us");
    for text in ["no accuracy is expected to be finished in 0.0 s: draft may take", "its budget is 0.0 s"] {
        assert!(done.stderr.contains(text), "{}", done.stderr);
    }
    done.ok();
    assert_eq!(accuracy(&desk), "draft");
}

#[test]
fn an_overlap_chooses_the_accuracy() {
    let desk = Desk::new();
    let done = bake(&desk, "--overlap 1m");
    assert!(done.stderr.contains("accuracy draft, expected"), "{}", done.stderr);
    done.ok();
    assert_eq!(accuracy(&desk), "draft");
}

/// What a bake leaves decides, not what was expected of it.
#[test]
fn an_overlap_that_is_not_kept_is_baked_again() {
    let desk = Desk::new();
    desk.write("crossed.toml", CROSSED);
    let done = desk.line("bake crossed.toml --frames 2 -o pile.glb --report report.json --overlap 1mm");
    for text in ["meshes overlap by up to", "accuracy reference, expected", "more than 1.0 mm, at the highest accuracy"]
    {
        assert!(done.stderr.contains(text), "{}", done.stderr);
    }
    done.ok();
    assert_eq!(accuracy(&desk), "reference");
    let done = desk.line("bake crossed.toml --frames 2 -o pile.glb --overlap 1m --set report.visible=off");
    assert!(done.stderr.contains("the overlap was not measured"), "{}", done.stderr);
    done.ok();
}

#[test]
fn goals_exclude_each_other() {
    let desk = Desk::new();
    for goal in ["--budget 1s --overlap 1mm", "--budget 1s --accuracy draft", "--overlap 1mm --accuracy draft"] {
        bake(&desk, goal).fails(2, &["cannot be used with"]);
    }
    bake(&desk, "--overlap thick").fails(2, &["give a length such as 0.1mm, 20um or 1cm"]);
}
