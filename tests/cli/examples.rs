//! The example scenes show what they promise: baked as they are if that is fast, or else reduced. Column, cone, books
//! and ball are claims (`tests/evidence`).

use crate::cli::desk::Desk;
use serde_json::Value;
use std::path::Path;

/// The figures of an example scene; NaN for one that it does not have.
struct Figures(Value);

impl Figures {
    fn of(scene: &str, settings: &str) -> Figures {
        let desk = Desk::new();
        let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples").join(scene);
        let mut args = vec!["bake", scene.to_str().unwrap(), "-o", "pile.glb", "--report", "report.json", "--quiet"];
        for setting in settings.split_whitespace() {
            args.extend(["--set", setting]);
        }
        desk.run(&args).ok();
        Figures(serde_json::from_str(&std::fs::read_to_string(desk.path("report.json")).unwrap()).unwrap())
    }

    fn get(&self, name: &str) -> f64 {
        self.0["measures"][name].as_f64().unwrap_or(f64::NAN)
    }

    fn bodies(&self) -> u64 {
        self.0["bodies"].as_u64().unwrap()
    }
}

#[test]
fn cards_stand_until_they_are_hit() {
    let held = Figures::of("cards.toml", "");
    assert!(held.get("stack_drift_rel") < 0.02);
    assert!(held.get("fallen_fraction") >= 0.5);
    let free = Figures::of("cards.toml", "control=off");
    assert!(free.get("stack_drift_rel") > 0.5, "without control the house falls before");
    let rough = Figures::of("cards.toml", "control=off props.0.friction=0.7 ground_friction=0.7");
    assert!(rough.get("stack_drift_rel") < 0.02, "more friction lets it stand as well");
}

#[test]
fn contacts_are_selected() {
    // Six bodies: the light plank and its weight fall.
    let conservative = Figures::of("contacts.toml", "");
    assert!((conservative.get("fallen_fraction") - 1.0 / 3.0).abs() < 0.01);
    let all = Figures::of("contacts.toml", "control.selection=all");
    assert_eq!(all.get("fallen_fraction"), 0.0);
    let off = Figures::of("contacts.toml", "control=off");
    assert!((off.get("fallen_fraction") - 1.0 / 3.0).abs() < 0.01, "as physics has it");
}

#[test]
fn overlaps_settle() {
    let stack = Figures::of("overlap.toml", "");
    assert!(stack.get("penetration_max_rel") < 0.1, "{}", stack.get("penetration_max_rel"));
    assert!(stack.get("resting_speed_max_rel") < 0.01);
    assert_eq!(stack.get("hanging"), 0.0);
}

#[test]
fn bananas_are_heaped_above_the_rim() {
    const FEW: &str = "accuracy=draft report.pictures=on props.0.scale_min=1.6 props.0.scale_max=1.6 \
                       emitters.0.count=250 emitters.0.rate=40";
    let heap = Figures::of("bananas.toml", FEW);
    assert!(heap.get("silhouette_iou") > 0.8, "{}", heap.get("silhouette_iou"));
    assert!(heap.get("resting_speed_max_rel") < 0.01);
    assert_eq!(heap.get("hanging"), 0.0);
}

#[test]
fn a_library_is_stacked_and_stands() {
    let books = Figures::of("library.toml", "");
    assert!(books.bodies() >= 150, "{}", books.bodies());
    assert!(books.get("flat_share") > 0.9, "{}", books.get("flat_share"));
    assert!(books.get("kept_shape") >= 0.95, "{}", books.get("kept_shape"));
    let fallen = Figures::of("library.toml", "fill.order=0");
    assert!(fallen.get("flat_share") < books.get("flat_share") - 0.3, "{}", fallen.get("flat_share"));
}

#[test]
fn a_brick_wall_is_bonded_and_stands() {
    let wall = Figures::of("brick-wall.toml", "accuracy=draft");
    assert!(wall.bodies() >= 400, "{}", wall.bodies());
    assert!(wall.get("flat_share") > 0.95, "{}", wall.get("flat_share"));
    assert!(wall.get("bonded_share") > 0.85, "{}", wall.get("bonded_share"));
    assert!(wall.get("kept_shape") >= 0.95, "{}", wall.get("kept_shape"));
}

#[test]
fn planks_crosswise_make_a_tower() {
    let tower = Figures::of("woodpile.toml", "accuracy=draft props.1.weight=0 fill.order=1");
    assert!(tower.bodies() >= 300, "{}", tower.bodies());
    assert!(tower.get("bonded_share") > 0.9, "{}", tower.get("bonded_share"));
    assert!(tower.get("kept_shape") >= 0.95, "{}", tower.get("kept_shape"));
}

#[test]
fn crockery_and_scrap_come_to_rest() {
    let crockery = Figures::of("crockery.toml", "accuracy=draft");
    assert!(crockery.bodies() >= 15, "{}", crockery.bodies());
    let scrap = Figures::of("scrap.toml", "accuracy=draft");
    assert!(scrap.bodies() >= 100, "{}", scrap.bodies());
    assert!(scrap.get("flat_share") < 0.5, "{}", scrap.get("flat_share"));
    for pile in [crockery, scrap] {
        assert!(pile.get("resting_speed_max_rel") < 0.02, "{}", pile.get("resting_speed_max_rel"));
    }
}
