//! Effects that a scene needs are on, others are off and cost nothing, and the user's setting overrides. Cached
//! simulations are not repeated.

use crate::cli::desk::{Desk, Done};
use serde_json::Value;
use std::collections::BTreeSet;

/// A small pile of boxes in which nothing bounces, rolls, flies or is split.
const PILE: &str = "--control cone.glb --prop stick.glb --accuracy draft --set fill.count=12 \
                    --set glue=natural --set control.stand=false";

/// A small pile in which all of it happens: balls roll and bounce, bananas are split, sticks are a hundred times as
/// heavy as wood, and a thrown ball flies into what is held.
const LIVELY: &str = r#"
control_mesh = "mound.glb"
accuracy = "draft"
glue = "natural"
[fill]
count = 20
[output]
frames = 60
[[props]]
path = "banana.glb"
[[props]]
path = "ball.glb"
scale_min = 0.1
scale_max = 0.1
restitution = 0.6
[[props]]
path = "stick.glb"
scale_min = 0.2
scale_max = 0.2
density = 100000
[[bodies]]
prop = "ball"
scale = 0.12
position = [-2, 0.05, 0]
velocity = [25, 1, 0]
mass = 1000
start_seconds = 1
"#;

/// Every effect that `effects` forces, and the counts that only it increases.
const FORCIBLE: [(&str, &[&str]); 12] = [
    ("primitives", &["props_as_primitives"]),
    ("decomposition", &["props_split"]),
    ("continuous_collision", &["speculative_body_steps", "ccd_body_steps"]),
    ("stiff_contacts", &["steps_with_stiff_contacts"]),
    ("rolling_resistance", &["rolling_body_steps"]),
    ("restitution", &["bouncing_bodies"]),
    ("guard", &["guard_steps", "guard_retries", "guard_braked", "guard_stiffened", "guard_calmed"]),
    ("impact", &["impact_looks", "shaken"]),
    ("breaking", &["break_checks", "holds_broken", "nails_broken"]),
    ("region", &["region_tests"]),
    ("kept_verdicts", &["verdicts_kept"]),
    ("frames", &["frames"]),
];

/// Bakes, and returns the report.
fn bake(desk: &Desk, args: &str) -> Value {
    desk.line(&format!("bake {args} -o pile.json --report report.json --quiet")).ok();
    serde_json::from_slice(&std::fs::read(desk.path("report.json")).unwrap()).unwrap()
}

fn count(report: &Value, name: &str) -> u64 {
    report["counts"][name].as_u64().unwrap_or_else(|| panic!("there is no count {name}"))
}

/// Whether the plan of a report has an effect on.
fn is_on(report: &Value, effect: &str) -> bool {
    let effects = report["plan"]["effects"].as_array().unwrap();
    effects.iter().find(|e| e["name"] == effect).unwrap_or_else(|| panic!("there is no effect {effect}"))["on"] == true
}

/// Effects that change the lively pile.
const DECISIVE: [&str; 6] =
    ["primitives", "decomposition", "stiff_contacts", "rolling_resistance", "restitution", "impact"];

#[test]
fn what_is_off_leaves_no_trace() {
    let desk = Desk::new();
    let auto = bake(&desk, PILE);
    let off = auto["plan"]["effects"].as_array().unwrap().iter().filter(|effect| effect["on"] == false);
    let mut looked_at = 0;
    for effect in off {
        for counter in effect["counters"].as_array().unwrap() {
            assert_eq!(count(&auto, counter.as_str().unwrap()), 0, "{effect}");
            looked_at += 1;
        }
        let name = effect["name"].as_str().unwrap();
        if FORCIBLE.iter().any(|(forcible, _)| *forcible == name) {
            let forced = bake(&desk, &format!("{PILE} --set effects.{name}=off"));
            assert_eq!(forced["result_blake3"], auto["result_blake3"], "{name} was off already");
        }
    }
    assert!(looked_at > 5, "{looked_at} counters");
}

#[test]
fn every_effect_is_seen_on_and_off() {
    let desk = Desk::new();
    let assets = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/assets");
    for model in ["mound.glb", "banana.glb", "ball.glb"] {
        std::fs::copy(assets.join(model), desk.path(model)).unwrap();
    }
    desk.write("lively.toml", LIVELY);
    let auto = bake(&desk, "lively.toml");
    let effects = auto["plan"]["effects"].as_array().unwrap();
    let is_forcible = |effect: &&Value| effect["switch"].as_str().is_some_and(|field| field.starts_with("effects."));
    let forcible: BTreeSet<&str> = effects.iter().filter(is_forcible).map(|e| e["name"].as_str().unwrap()).collect();
    assert_eq!(BTreeSet::from(FORCIBLE.map(|(name, _)| name)), forcible, "every effect with a switch is tried");
    assert!(count(&auto, "shaken") > 0, "the ball hits what is held");
    for (effect, counters) in FORCIBLE {
        assert!(is_on(&auto, effect), "{effect} comes on by itself");
        assert!(counters.iter().any(|counter| count(&auto, counter) > 0), "{effect} is on and does nothing");
        let off = bake(&desk, &format!("lively.toml --set effects.{effect}=off"));
        assert!(!is_on(&off, effect), "{effect}");
        for counter in counters {
            assert_eq!(count(&off, counter), 0, "{counter} while {effect} is off");
        }
        if DECISIVE.contains(&effect) {
            assert_ne!(off["result_blake3"], auto["result_blake3"], "the pile is the same without {effect}");
        }
    }
}

#[test]
fn what_is_forced_on_is_at_work() {
    let desk = Desk::new();
    for (effect, counter) in [
        ("continuous_collision", "ccd_body_steps"),
        ("stiff_contacts", "steps_with_stiff_contacts"),
        ("rolling_resistance", "rolling_body_steps"),
        ("impact", "impact_looks"),
    ] {
        let on = bake(&desk, &format!("{PILE} --set effects.{effect}=on"));
        assert!(is_on(&on, effect));
        assert!(count(&on, counter) > 0, "{effect}");
    }
}

#[test]
fn a_kept_verdict_is_the_verdict_of_a_new_look() {
    let desk = Desk::new();
    let (kept, fresh) = (bake(&desk, PILE), bake(&desk, &format!("{PILE} --set effects.kept_verdicts=off")));
    assert_eq!(kept["result_blake3"], fresh["result_blake3"]);
    assert!(count(&kept, "analyses") < count(&fresh, "analyses"));
}

#[test]
fn the_final_pose_alone() {
    let desk = Desk::new();
    let last = |desk: &Desk| {
        let pile: Value = serde_json::from_slice(&std::fs::read(desk.path("pile.json")).unwrap()).unwrap();
        let frames = pile["frames"].as_array().unwrap();
        (frames.len(), frames.last().unwrap().clone())
    };
    let all = bake(&desk, PILE);
    let (count, pose) = last(&desk);
    assert!(count > 1);
    let still = bake(&desk, &format!("{PILE} --set effects.frames=off"));
    assert_eq!(last(&desk), (1, pose));
    for measure in ["kept_shape", "hanging", "penetration_mean_rel", "resting_speed_max", "drift_p95_rel"] {
        assert_eq!(still["measures"][measure], all["measures"][measure], "{measure}");
    }
    assert!(still["measures"]["creep_max_rel"].is_null(), "it takes frames");

    // Ends while it falls.
    bake(&desk, &format!("{PILE} --frames 3"));
    let (_, pose) = last(&desk);
    bake(&desk, &format!("{PILE} --frames 3 --set effects.frames=off"));
    assert_eq!(last(&desk), (1, pose));
}

#[test]
fn the_bill_has_every_effect() {
    let desk = Desk::new();
    let report = bake(&desk, PILE);
    let (effects, bill) = (report["plan"]["effects"].as_array().unwrap(), report["bill"].as_array().unwrap());
    assert!(effects.iter().zip(bill).all(|(e, b)| e["name"] == b["name"] && e["on"] == b["on"]));
    assert_eq!(effects.len(), bill.len());
    let fill = bill.iter().find(|charge| charge["name"] == "fill").unwrap();
    assert!(fill["seconds"].as_f64().unwrap() > 0.0 && fill["share"].as_f64().unwrap() < 1.0);
    assert!(fill["counts"]["fill_steps"].as_u64().unwrap() > 0);
}

#[test]
fn a_misspelt_effect_names_the_nearest() {
    let desk = Desk::new();
    desk.line(&format!("bake {PILE} --set effects.gaurd=off -o pile.json")).fails(2, &["gaurd", "guard"]);
    desk.line(&format!("bake {PILE} --set effects=off -o pile.json")).fails(2, &["effects"]);
}

#[test]
fn a_table_of_effects() {
    let desk = Desk::new();
    let table = desk.line(&format!("cost {PILE} -o study --seeds 1 --effects")).ok();
    for row in ["| as it is |", "| control off |", "| guard off |", "| primitives off |", "| rolling_resistance on |"] {
        assert!(table.contains(row), "{row} is missing in\n{table}");
    }
    assert_eq!(std::fs::read_to_string(desk.path("study/effects.md")).unwrap(), table);
}

/// The same with a cache in the desk's folder.
fn bake_with_cache(desk: &Desk, args: &str) -> (Value, Done) {
    let line = format!("bake {args} --report report.json --cache cache");
    let mut command = desk.command(&line.split_whitespace().collect::<Vec<_>>());
    let done = Done::of(command.env_remove("CAIRN_NO_CACHE").output().unwrap());
    let report = serde_json::from_slice(&std::fs::read(desk.path("report.json")).unwrap()).unwrap();
    (report, done)
}

#[test]
fn a_stage_is_not_simulated_twice() {
    let desk = Desk::new();
    let fresh = bake(&desk, &format!("{PILE} --set release.layer=2"));

    let (first, _) = bake_with_cache(&desk, &format!("{PILE} -o pile.glb"));
    assert!(count(&first, "fill_steps") > 0 && count(&first, "fill_steps_recalled") == 0);

    // Another release: the fill is the same.
    let (second, done) = bake_with_cache(&desk, &format!("{PILE} --set release.layer=2 -o pile.glb"));
    assert_eq!((count(&second, "fill_steps"), count(&second, "fill_steps_recalled")), (0, count(&first, "fill_steps")));
    assert!(count(&second, "steps") > 0);
    assert_eq!(second["result_blake3"], fresh["result_blake3"], "a cache changes no result");
    assert!(done.stderr.contains("the fill comes from the cache"), "{}", done.stderr);

    // Another output: all is the same.
    let (third, done) = bake_with_cache(&desk, &format!("{PILE} --set release.layer=2 -o pile.csv"));
    assert_eq!((count(&third, "fill_steps"), count(&third, "steps")), (0, 0));
    assert_eq!(third["result_blake3"], fresh["result_blake3"]);
    assert!(done.stderr.contains("this pile was baked before and comes from the cache"), "{}", done.stderr);

    // Another seed, or another fill: nothing is.
    for change in ["--seed 9", "--set fill.friction=0.1"] {
        let (other, _) = bake_with_cache(&desk, &format!("{PILE} {change} -o pile.glb"));
        assert_eq!(count(&other, "fill_steps_recalled"), 0, "{change}");
    }
}

#[test]
fn a_cache_that_cannot_be_written_is_reported() {
    let desk = Desk::new();
    desk.write("cache", "a file");
    let (report, done) = bake_with_cache(&desk, &format!("{PILE} -o pile.glb"));
    assert!(done.stderr.contains("the cache cannot be written there"), "{}", done.stderr);
    assert!(count(&report, "fill_steps") > 0);
}

#[test]
fn a_broken_cache_is_replaced() {
    let desk = Desk::new();
    let (first, _) = bake_with_cache(&desk, &format!("{PILE} -o pile.glb"));
    let mut broken = 0;
    for entry in walk(&desk.path("cache")) {
        std::fs::write(&entry, b"not what was written").unwrap();
        broken += 1;
    }
    assert!(broken > 0);
    let (second, _) = bake_with_cache(&desk, &format!("{PILE} -o pile.glb"));
    assert_eq!(second["result_blake3"], first["result_blake3"]);
    assert!(count(&second, "fill_steps") > 0);
}

fn walk(folder: &std::path::Path) -> Vec<std::path::PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { walk(&path) } else { vec![path] }).collect()
}
