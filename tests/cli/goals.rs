//! The accuracy `auto`, in scene files and by `--budget` and `--overlap`: a goal chooses the preset.

use crate::cli::desk::{Desk, Done};
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
    for text in ["no accuracy is expected to be finished in 0.0 s: draft may take", "its goal is 0.0 s"] {
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
    for text in ["meshes overlap by up to", "the goal is 1.0 mm", "baking again with accuracy reference"] {
        assert!(done.stderr.contains(text), "{}", done.stderr);
    }
    done.ok();
    assert_eq!(accuracy(&desk), "reference");
    let done = desk.line("bake crossed.toml --frames 2 -o pile.glb --overlap 1m --set report.visible=off");
    assert!(done.stderr.contains("the overlap was not measured"), "{}", done.stderr);
    done.ok();
}

/// A scene file says the same as the flags. The result is that of the chosen preset, and can be baked again from what
/// it holds.
#[test]
fn a_result_holds_the_preset_that_was_chosen() {
    let desk = Desk::new();
    let scene = "control_mesh = 'cone.glb'\nprops = ['stick.glb']\naccuracy = 'auto'\ngoal = { overlap = 1 }\n\
                 fill = { count = 3 }\noutput = { frames = 2 }\n";
    desk.write("auto.toml", scene);
    let hashes = |name: &str| {
        let report: Value = serde_json::from_slice(&std::fs::read(desk.path(name)).unwrap()).unwrap();
        ["request_blake3", "result_blake3", "output_blake3"].map(|name| report[name].as_str().unwrap().to_owned())
    };
    desk.line("bake auto.toml -o auto.glb --report report.json --no-cache").ok();
    assert_eq!(accuracy(&desk), "draft");
    let auto = hashes("report.json");
    let report: Value = serde_json::from_slice(&std::fs::read(desk.path("report.json")).unwrap()).unwrap();
    assert_eq!(report["scene"]["goal"]["overlap"], 1.0);
    assert!(report["notes"].to_string().contains("accuracy draft, expected"), "{}", report["notes"]);
    desk.line("bake auto.glb -o again.glb --report again.json --no-cache").ok();
    assert_eq!(hashes("again.json"), auto, "the result's own scene");
    desk.line("bake auto.toml --accuracy draft -o preset.glb --report preset.json --no-cache").ok();
    assert_eq!(hashes("preset.json")[..2], auto[..2], "the same bake as with the preset");
    // A batch knows what is finished, whatever the goal chose.
    desk.line("batch auto.toml --seeds 1 -o {seed}.glb").ok();
    let listed = desk.line("batch auto.toml --seeds 1 -o {seed}.glb --dry-run").ok();
    assert!(listed.ends_with("finished\n"));
    let plan: Value = serde_json::from_str(&desk.line("plan auto.toml --json").ok()).unwrap();
    assert!(plan["notes"].to_string().contains("accuracy draft, expected"), "{}", plan["notes"]);
}

#[test]
fn goals_exclude_each_other() {
    let desk = Desk::new();
    for goal in ["--budget 1s --overlap 1mm", "--budget 1s --accuracy draft", "--overlap 1mm --accuracy draft"] {
        bake(&desk, goal).fails(2, &["cannot be used with"]);
    }
    bake(&desk, "--overlap thick").fails(2, &["give a length such as 0.1mm, 20um or 1cm"]);
}
