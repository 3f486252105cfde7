//! `cairn cost`: every preset and a changed parameter, a table and a plot, and no run twice.

use crate::cli::desk::Desk;
use serde_json::Value;

const PRESETS: [&str; 5] = ["draft", "preview", "standard", "fine", "reference"];

#[test]
fn a_study_of_a_small_pile() {
    let desk = Desk::new();
    let line = "cost --control cone.glb --prop stick.glb -o study --bodies 40 --seeds 1 --knob physics.substeps=2";
    let table = desk.line(line).ok();
    let runs = || std::fs::read_to_string(desk.path("study/runs.jsonl")).unwrap();
    let made = runs();
    assert_eq!(made.lines().count(), 6);

    let study: Value = serde_json::from_slice(&std::fs::read(desk.path("study/cost.json")).unwrap()).unwrap();
    let rows = study["rows"].as_array().unwrap();
    let names: Vec<&str> = rows.iter().map(|row| row["variant"].as_str().unwrap()).collect();
    assert_eq!(names[..5], PRESETS);
    assert_eq!(names[5], "physics.substeps=2");
    // Counted work, not time. Neighboring presets may swap: such a small pile comes to rest sooner or later by chance.
    let work = [0, 2, 4].map(|row: usize| rows[row]["substeps"]["median"].as_f64().unwrap());
    assert!(work.is_sorted_by(|a, b| a < b), "{work:?}");
    let sunk = |row: usize| rows[row]["errors"]["overlap"]["median"].as_f64().unwrap();
    assert!(sunk(0) > sunk(2), "draft {} sinks in less than standard {}", sunk(0), sunk(2));
    // With one seed, an error is the run's measured value, or its distance from the reference's.
    let runs_made: Vec<Value> = made.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let measured = |row: usize, figure: &str| {
        let run = runs_made.iter().find(|run| run["variant"] == rows[row]["variant"]).unwrap();
        run["measures"][figure].as_f64().unwrap_or_else(|| panic!("{figure} is missing in {run}"))
    };
    for (k, row) in rows.iter().enumerate() {
        let bodies = row["bodies"]["median"].as_f64().unwrap();
        assert!((20.0..=80.0).contains(&bodies), "the shape was not scaled down: {bodies} bodies");
        let error = |figure: &str| row["errors"][figure]["median"].as_f64().unwrap();
        for (figure, of) in [
            ("overlap", "visible_depth_p95_rel"),
            ("penetration_p95_rel", "penetration_p95_rel"),
            ("equilibrium_residual_p95", "equilibrium_residual_p95"),
            ("friction_violation_mean", "friction_violation_mean"),
            ("energy_gain_rel", "energy_gain_rel"),
        ] {
            assert_eq!(error(figure), measured(k, of), "{figure} of row {k}");
        }
        assert_eq!(error("imbalance"), 1.0 - measured(k, "free_standing_fraction"), "row {k}");
        // It stands on compliant contacts, which the engine balances to a fraction of a weight.
        // What is seen at the reference was moved apart.
        let is_seen = (1e-7..0.2).contains(&error("overlap"));
        assert!(if k == 4 { error("overlap") == 0.0 } else { is_seen }, "{}", error("overlap"));
        assert!((1e-9..1.0).contains(&error("equilibrium_residual_p95")), "{}", error("equilibrium_residual_p95"));
        for (figure, of) in [("shape", "shape_iou"), ("kept_shape", "kept_shape"), ("silhouette_iou", "silhouette_iou")]
        {
            assert_eq!(error(figure), (measured(k, of) - measured(4, of)).abs(), "{figure} of row {k}");
        }
    }
    assert_eq!(rows[4]["errors"]["kept_shape"]["median"], 0.0, "the reference is its own measure");
    assert!(rows[..4].iter().any(|row| row["errors"]["kept_shape"]["median"] != 0.0), "all are the reference");
    assert!(PRESETS.iter().all(|name| table.contains(&format!("| {name} |"))), "{table}");
    let plot = std::fs::read_to_string(desk.path("study/cost.svg")).unwrap();
    assert!(plot.contains("overlap: 95 of 100 pairs of touching meshes") && plot.contains("CPU time, s"));
    // The recommendation is in the table and above the plot; each preset has one label in each of the three panels.
    assert!(table.contains("Choose `") && plot.contains("Choose "), "{table}");
    assert!(plot.contains("1 seed,"));
    // One seed ranks nothing.
    assert!(table.contains("too few seeds to rank the presets by overlap"), "{table}");
    assert!(plot.contains("too few seeds to rank\n"));
    assert_eq!(plot.matches("\nreference\n").count(), 3);
    assert!(std::fs::read(desk.path("study/cost.png")).unwrap().starts_with(b"\x89PNG"));

    // Run again, it has nothing to bake; without a budget for more, it lists the missing runs.
    assert_eq!(desk.line(line).ok(), table);
    assert_eq!(runs(), made);
    // The plots are written after two tables, and appear complete or not at all.
    let plot = std::fs::read(desk.path("study/cost.svg")).unwrap();
    let mut command = desk.command(&line.split_whitespace().collect::<Vec<_>>());
    let full = command.env("FAILPOINTS", "files-write=2*off->return(ENOSPC)").output().unwrap();
    crate::cli::desk::Done::of(full).fails(75, &["the plot cannot be written", "No space"]);
    assert_eq!(std::fs::read(desk.path("study/cost.svg")).unwrap(), plot);
    let more = line.replace("--seeds 1", "--seeds 2 --budget 0s");
    assert!(desk.line(&more).ok().contains("Not baked within the budget: draft (seed 2)"));
    assert_eq!(runs(), made);
}

#[test]
fn a_misspelt_knob_is_an_error_before_any_bake() {
    let desk = Desk::new();
    let line = "cost --control cone.glb --prop stick.glb -o study --knob physics.substep=2";
    desk.line(line).fails(2, &["substep", "substeps"]);
    assert!(!desk.path("study").exists());
}
