//! Layouts of `cairn clutter`.

use crate::cli::desk::{Desk, Done};
use serde_json::Value;
use std::path::Path;

const CATALOGUE: &str = "count = [3, 5]\narrangement = [\"scattered\", \"stacked\"]\n\
                         [[props]]\npath = \"brick.glb\"\nlabel = \"block\"\nscale_min = 0.4\nscale_max = 0.5\n\
                         [[props]]\npath = \"book.glb\"\n\
                         [[places]]\npath = \"bin.glb\"\n";

fn desk() -> Desk {
    let desk = Desk::new();
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/assets");
    for name in ["bin.glb", "book.glb"] {
        std::fs::copy(assets.join(name), desk.path(name)).unwrap();
    }
    desk.write("catalogue.toml", CATALOGUE);
    desk
}

fn run(desk: &Desk, args: &str, faults: &str) -> Done {
    let line = format!("clutter catalogue.toml {args} --sheet 0 --progress none");
    let mut command = desk.command(&line.split_whitespace().collect::<Vec<_>>());
    Done::of(command.env("FAILPOINTS", faults).output().unwrap())
}

fn text(desk: &Desk, name: &str) -> String {
    std::fs::read_to_string(desk.path(name)).unwrap()
}

fn lines(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Each layout rests in its place; the same bytes come from any number of workers, from parts, and from a run that was
/// cut off and goes on.
#[test]
fn a_layout_is_the_same_whatever_else_is_made() {
    let desk = desk();
    assert!(run(&desk, "-n 6 -o one --jobs 1", "").ok().starts_with("one: 6 layouts, "));
    let whole = text(&desk, "one/layouts.jsonl");
    let all = lines(&whole);
    assert_eq!(all.len(), 6);
    for (number, line) in all.iter().enumerate() {
        assert_eq!(line["layout"], number);
        assert_eq!((&line["failed"], &line["proof"]["at_rest"]), (&Value::Null, &Value::Bool(true)));
        assert!(line["proof"]["push"].as_f64().unwrap() >= 0.06, "{line}");
        assert!(line["proof"]["drift"].as_f64().unwrap() <= 0.002, "{line}");
        assert!(line["proof"]["overlap"].as_f64().unwrap() <= 0.001, "{line}");
        let bodies = line["bodies"].as_array().unwrap();
        assert!((3..=5).contains(&bodies.len()), "{line}");
        for body in bodies {
            let position: Vec<f64> = body["position"].as_array().unwrap().iter().map(|p| p.as_f64().unwrap()).collect();
            assert!(position[0].abs() < 0.6 && position[1] > 0.0 && position[2].abs() < 0.4, "{body}");
            assert!(!body["rests_on"].as_array().unwrap().is_empty(), "{body}");
        }
    }
    run(&desk, "-n 6 -o two --jobs 2", "").ok();
    assert_eq!(text(&desk, "two/layouts.jsonl"), whole);
    run(&desk, "-n 6 -o part --range 2-3", "").ok();
    assert_eq!(lines(&text(&desk, "part/layouts-000002-000003.jsonl")), all[2..4]);
    run(&desk, "-n 6 -o part --range 6-7", "").fails(2, &["there are 6 layouts, counted from 0"]);
    // Cut off within a line.
    let cut = whole.lines().take(3).map(str::len).sum::<usize>() + 3 + 20;
    desk.write("two/layouts.jsonl", &whole[..cut]);
    assert!(run(&desk, "-n 6 -o two", "").ok().contains("3 finished before"));
    assert_eq!(text(&desk, "two/layouts.jsonl"), whole);
    assert!(run(&desk, "-n 6 -o two", "").ok().contains("6 finished before"));
    let card = text(&desk, "two/README.md");
    assert!(
        card.contains("6 layouts") && card.contains("| block |") && card.contains("| bin.glb | not stated |"),
        "{card}"
    );
}

/// A collision shape is made once: not again by the processes that make layouts, by later runs, or for another place.
#[test]
fn shapes_are_made_once() {
    let desk = desk();
    let new = |args: &str, has_cache: bool| {
        let line = format!("clutter catalogue.toml -n 4 --jobs 2 {args} --sheet 0 --progress none");
        let mut command = desk.command(&line.split_whitespace().collect::<Vec<_>>());
        if has_cache {
            command.env_remove("CAIRN_NO_CACHE").env("CAIRN_CACHE", desk.path("cache"));
        }
        Done::of(command.output().unwrap()).ok();
        let folder = args.split_whitespace().last().unwrap();
        let card = text(&desk, &format!("{folder}/README.md"));
        let (_, rest) = card.split_once("Collision shapes that were new: ").unwrap();
        rest.split_once(" of 2.").unwrap().0.parse::<u32>().unwrap()
    };
    assert_eq!(new("-o none", false), 2, "without a cache, one of this run");
    assert_eq!(new("-o first", true), 2);
    assert_eq!(new("-o again", true), 0);
    for folder in ["first", "again"] {
        assert_eq!(text(&desk, &format!("{folder}/layouts.jsonl")), text(&desk, "none/layouts.jsonl"));
    }
    let other = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/assets/desk.glb");
    std::fs::copy(other, desk.path("desk.glb")).unwrap();
    desk.write("catalogue.toml", CATALOGUE.replace("bin.glb", "desk.glb").replace("label", "weight = 2\nlabel"));
    assert_eq!(new("-o desk", true), 0);
}

/// A table without walls loses bodies: they are counted, the others stay, and there are as many as the catalogue asks
/// for. Figures of the camera stand in the lines, in the card, and only where they are asked for.
#[test]
fn what_leaves_a_table_goes_alone_and_what_is_seen_is_told() {
    let desk = desk();
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/assets");
    for name in ["desk.glb", "banana.glb"] {
        std::fs::copy(assets.join(name), desk.path(name)).unwrap();
    }
    let props = "[[props]]\npath = \"banana.glb\"\n[[props]]\npath = \"book.glb\"\n";
    let text = format!("count = [12, 16]\narrangement = \"heaped\"\n{props}[[places]]\npath = \"desk.glb\"\n");
    desk.write("catalogue.toml", &text);
    run(&desk, "-n 3 -o plain", "").ok();
    let plain = lines(&self::text(&desk, "plain/layouts.jsonl"));
    let away = |line: &Value| -> u64 {
        line["taken_away"].as_object().unwrap().values().map(|count| count.as_u64().unwrap()).sum()
    };
    assert!(plain.iter().map(away).sum::<u64>() > 0, "bananas roll off");
    for line in &plain {
        assert_eq!((&line["failed"], &line["view"]), (&Value::Null, &Value::Null));
        assert!((12..=16).contains(&line["bodies"].as_array().unwrap().len()), "{line}");
    }
    desk.write("catalogue.toml", format!("target = {{ label = \"book\", visible = [0.3, 1] }}\ncamera = {{}}\n{text}"));
    run(&desk, "-n 2 -o seen", "").ok();
    for line in lines(&self::text(&desk, "seen/layouts.jsonl")) {
        let target = &line["bodies"][line["target"].as_u64().unwrap() as usize];
        assert_eq!(target["visible"], line["view"]["target"]);
        assert!(
            target["visible"].as_f64().unwrap() >= 0.3 && line["view"]["overlap"].as_f64().unwrap() > 0.0,
            "{line}"
        );
    }
    assert!(self::text(&desk, "seen/README.md").contains("share of the target that is seen"));
    assert!(!self::text(&desk, "plain/README.md").contains("as the camera sees it"));
}

/// A process that is killed costs the layout that it made; its line says why.
#[test]
fn a_crash_costs_one_layout() {
    let desk = desk();
    let done = run(&desk, "-n 4 -o out --jobs 1", "clutter-layout=2*off->1*return(KILL)");
    assert_eq!(done.code, 75);
    assert!(done.stderr.contains("layout 2: its process ended (signal: 9"), "{}", done.stderr);
    let all = lines(&text(&desk, "out/layouts.jsonl"));
    let failed: Vec<bool> = all.iter().map(|line| line["failed"].is_string()).collect();
    assert_eq!(failed, [false, false, true, false]);
    run(&desk, "-n 4 -o whole", "").ok();
    assert_eq!(lines(&text(&desk, "whole/layouts.jsonl"))[3], all[3]);
}

/// What cannot be written, started or read is said; what was made stays.
#[test]
fn faults_of_the_system_leave_whole_lines() {
    let desk = desk();
    run(&desk, "-n 4 -o out", "clutter-folder=return(ENOSPC)").fails(75, &["cannot be written"]);
    run(&desk, "-n 4 -o out", "clutter-shapes=return(ENOSPC)").fails(75, &["cannot be written"]);
    run(&desk, "-n 4 -o out", "clutter-open=return(EACCES)").fails(65, &["cannot be written"]);
    run(&desk, "-n 4 -o out", "clutter-spawn=return(ENOMEM)").fails(75, &["no process could be started"]);
    run(&desk, "-n 4 -o out --jobs 1", "clutter-write=2*off->1*return(ENOSPC)").fails(75, &["cannot be written"]);
    run(&desk, "-n 4 -o out", "").ok();
    run(&desk, "-n 4 -o whole", "").ok();
    assert_eq!(text(&desk, "out/layouts.jsonl"), text(&desk, "whole/layouts.jsonl"));
    run(&desk, "-n 4 -o out --stands none", "").fails(65, &["the folder has layouts of another catalogue"]);
    let python = "-n 4 -o other --stands mujoco --python";
    run(&desk, &format!("{python} no-python"), "").fails(2, &["it cannot be started"]);
    run(&desk, &format!("{python} true"), "clutter-python=return(EIO)").fails(2, &["it cannot be started"]);
    run(&desk, &format!("{python} false"), "").fails(2, &["this Python has no package mujoco"]);
    let done = run(&desk, &format!("{python} true"), "clutter-mujoco=return(EIO)");
    assert_eq!(done.code, 75, "{}", done.stderr);
}

/// The problems of catalogue and models come at once, before any work.
#[test]
fn problems_come_at_once() {
    let desk = desk();
    desk.write(
        "catalogue.toml",
        CATALOGUE.replace("book.glb", "gone.glb").replace("[3, 5]", "[5, 3]") + "wieght = 1\n",
    );
    run(&desk, "-n 4 -o out", "").fails(
        65,
        &["count: 5 comes after 3. Give the smaller number first.", "places.0.wieght: a catalogue has no such field"],
    );
    desk.write("catalogue.toml", CATALOGUE.replace("book.glb", "gone.glb").replace("bin.glb", "lost.glb"));
    run(&desk, "-n 4 -o out", "").fails(65, &["gone.glb: no such file (props.1)", "lost.glb: no such file (places.0)"]);
    assert!(!desk.path("out").exists());
    let camera = "camera = { position = [0, 1, 0], look_at = [0, 1, 0], field_of_view = 0 }\noverlap = [0.5, 0.2]\n";
    let far = "camera = { position = [0, 1e9, 0] }\n";
    desk.write("catalogue.toml", format!("{camera}{CATALOGUE}{far}"));
    run(&desk, "-n 4 -o out", "").fails(
        65,
        &[
            "camera.position: the camera looks at its own place",
            "camera.field_of_view: 0 is out of range",
            "overlap: 0.5 comes after 0.2",
            "places.0.camera.position: it is too far away",
        ],
    );
    // A target that must be covered, and a level of the bin.
    let asks = CATALOGUE.replace("bin.glb\"", "bin.glb\"\nlevel = 0.01");
    desk.write("catalogue.toml", format!("target = {{ label = \"book\", covered_by = [0, 1] }}\n{asks}"));
    run(&desk, "-n 2 -o out", "").ok();
    for line in lines(&text(&desk, "out/layouts.jsonl")) {
        let target = &line["bodies"][line["target"].as_u64().unwrap() as usize];
        assert_eq!(target["label"], "book");
        assert!(target["carries"].as_array().unwrap().len() <= 1, "{target}");
    }
}
