//! The committed study of the cost of accuracy (`tests/studies/accuracy/run`): its figures support the presets.

use crate::desk::Desk;
use serde_json::Value;
use std::path::Path;

const SCENES: [&str; 7] = ["sticks", "cards", "books", "bananas", "column", "overlap", "rubble"];
/// Those of them whose bodies come from a fill.
const FILLED: [&str; 4] = ["sticks", "books", "column", "rubble"];
const PRESETS: [&str; 5] = ["draft", "preview", "standard", "fine", "reference"];
const HEADLINE: [&str; 3] = ["overlap", "imbalance", "shape"];

fn study(scene: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/studies/accuracy").join(scene).join("cost.json");
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn rows(study: &Value) -> &Vec<Value> {
    study["rows"].as_array().unwrap()
}

fn row<'a>(study: &'a Value, variant: &str) -> &'a Value {
    rows(study).iter().find(|row| row["variant"] == variant).unwrap_or_else(|| panic!("{variant} was not studied"))
}

fn cost(row: &Value) -> f64 {
    row["cost"]["median"].as_f64().unwrap()
}

/// `None` where the scene has no such figure.
fn error(row: &Value, figure: &str) -> Option<f64> {
    row["errors"][figure]["median"].as_f64()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let half = values.len() / 2;
    if values.len() % 2 == 1 { values[half] } else { (values[half - 1] + values[half]) / 2.0 }
}

/// From the cheapest to the most expensive, in every scene that takes more than hundredths of a second.
#[test]
fn presets_are_ordered_by_their_price() {
    let mut spans = Vec::new();
    for scene in SCENES.iter().filter(|scene| **scene != "overlap") {
        let study = study(scene);
        let costs = PRESETS.map(|preset| cost(row(&study, preset)));
        // Seeds differ by a tenth.
        assert!(costs.windows(2).all(|pair| pair[1] > 0.9 * pair[0]), "{scene}: {costs:?}");
        assert!(costs[2] > costs[0] && costs[4] > 2.0 * costs[2], "{scene}: {costs:?}");
        spans.push(costs[4] / costs[0]);
    }
    assert!(median(spans.clone()) > 8.0, "{spans:?}");
}

/// A more expensive preset overlaps less, and delivered piles have no visible overlap.
#[test]
fn presets_are_ordered_by_what_overlaps() {
    for scene in FILLED {
        let study = study(scene);
        let overlaps = PRESETS.map(|preset| error(row(&study, preset), "overlap").unwrap());
        // Up to the difference between seeds.
        let most = PRESETS.map(|preset| row(&study, preset)["errors"]["overlap"]["high"].as_f64().unwrap());
        assert!((1..PRESETS.len()).all(|n| overlaps[n] <= most[n - 1]), "{scene}: {overlaps:?}, {most:?}");
        assert!(overlaps[0] > 30.0 * overlaps[4], "{scene}: {overlaps:?}");
        assert!(overlaps[2] <= 0.006 && overlaps[4] <= 0.001, "{scene}: {overlaps:?}");
    }
}

/// No single change of `standard` is at once a tenth cheaper than a preset and a tenth better in a headline figure on
/// five of the seven scenes.
#[test]
fn no_change_of_one_parameter_beats_a_preset() {
    let studies = SCENES.map(study);
    let knobs: Vec<&str> = rows(&studies[0])
        .iter()
        .filter(|row| row["kind"] == "knob")
        .map(|row| row["variant"].as_str().unwrap())
        .collect();
    assert!(knobs.len() >= 15, "{knobs:?}");
    for preset in PRESETS {
        for knob in &knobs {
            let beats = |study: &&Value| {
                let (preset, knob) = (row(study, preset), row(study, knob));
                let both = HEADLINE.iter().filter_map(|figure| Some((error(knob, figure)?, error(preset, figure)?)));
                let is_better = both.into_iter().any(|(ours, other): (f64, f64)| ours < 0.9 * other);
                cost(knob) < 0.9 * cost(preset) && is_better
            };
            let beaten = studies.iter().filter(beats).count();
            assert!(beaten < 5, "{knob} is better than {preset} on {beaten} scenes");
        }
    }
}

/// `cairn plan` shows the errors that the study found: the median of the scenes' overlaps, and the means of the others.
#[test]
fn a_plan_tells_what_the_study_found() {
    let desk = Desk::new();
    let plan: Value = serde_json::from_str(&desk.line("plan --control cone.glb --prop stick.glb --json").ok()).unwrap();
    let estimates = plan["estimates"].as_array().unwrap();
    let studies = SCENES.map(study);
    for (preset, estimate) in PRESETS.iter().zip(estimates) {
        for (figure, estimated) in
            [("overlap", "penetration_mean_rel"), ("imbalance", "imbalance"), ("shape", "shape_error")]
        {
            let all: Vec<f64> = studies.iter().filter_map(|study| error(row(study, preset), figure)).collect();
            let mean = all.iter().sum::<f64>() / all.len() as f64;
            let found = if figure == "overlap" { median(all) } else { mean };
            let estimated = estimate[estimated].as_f64().unwrap();
            // Two digits.
            assert!(
                (estimated - found).abs() <= 0.06 * found + 1e-6,
                "{preset}: {figure} of {estimated}, the study has {found}"
            );
        }
    }
}
