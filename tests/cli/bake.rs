//! Whole bakes, small enough for a test.

use crate::cli::desk::Desk;
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

const SCENE: &str = "--control cone.glb --prop stick.glb:2 --prop brick.glb#Brick --accuracy draft --set fill.count=12";

fn report(desk: &Desk, args: &str) -> Value {
    desk.line(&format!("bake {SCENE} --report report.json {args}")).ok();
    last_report(desk)
}

fn last_report(desk: &Desk) -> Value {
    serde_json::from_slice(&std::fs::read(desk.path("report.json")).unwrap()).unwrap()
}

#[test]
fn every_format_holds_the_same_result() {
    let desk = Desk::new();
    let hashes = ["glb", "json", "csv"].map(|format| {
        let report = report(&desk, &format!("-o pile.{format} --quiet"));
        assert!(desk.path(&format!("pile.{format}")).metadata().unwrap().len() > 0);
        report["result_blake3"].as_str().unwrap().to_owned()
    });
    assert_eq!(hashes[0].len(), 64);
    assert!(hashes.iter().all(|hash| *hash == hashes[0]), "{hashes:?}");
    gltf::Gltf::open(desk.path("pile.glb")).unwrap();
}

#[test]
fn the_report_tells_what_made_the_result() {
    let desk = Desk::new();
    let first = report(&desk, "-o pile.glb --seed 5");
    assert_eq!(first["seed"], 5);
    assert_eq!(first["versions"]["cairn"], env!("CARGO_PKG_VERSION"));
    assert!(first["versions"]["rapier3d"].is_string() && first["versions"]["clarabel"].is_string());
    assert!(first["measures"]["kept_shape"].is_number());
    assert!(first["seconds"]["fill"].is_number() && first["cpu_seconds"].is_number());
    assert!(first["bodies"].as_u64().unwrap() > 0);

    // Its scene is a scene file that gives the same again.
    desk.write("again.json", first["scene"].to_string());
    desk.line("bake again.json -o again.glb --report report.json").ok();
    let again = last_report(&desk);
    assert_eq!(again["result_blake3"], first["result_blake3"]);
    assert_eq!(std::fs::read(desk.path("again.glb")).unwrap(), std::fs::read(desk.path("pile.glb")).unwrap());
    assert_ne!(report(&desk, "-o pile.glb --seed 6")["result_blake3"], first["result_blake3"]);
}

/// Upside down, few props lie at the end of the container: turned over, they have far to fall before they lie on the
/// ground. Left in the air, 95 % of them reach up to 0.76 of the shape's height.
#[test]
fn a_container_that_is_not_full_leaves_no_pile_in_the_air() {
    let desk = Desk::new();
    std::fs::copy(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/assets/cone.glb"), desk.path("cone.glb")).unwrap();
    let scene = "--control cone.glb --prop stick.glb --accuracy draft --set fill.count=150 --set glue.mode=natural";
    desk.line(&format!("bake {scene} -o pile.json --report report.json")).ok();
    let report = last_report(&desk);
    let figure = |name: &str| report["measures"][name].as_f64().unwrap();
    assert_eq!(report["bodies"], 150);
    assert!(figure("height_p95_rel_start") < 0.4, "{}", figure("height_p95_rel_start"));
    assert!(figure("drift_p95_rel") < 0.5, "{}", figure("drift_p95_rel"));
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let desk = Desk::new();
    let [one, many] = ["1", "5"].map(|threads| {
        let args: Vec<String> = format!("bake {SCENE} -o pile.csv").split_whitespace().map(str::to_owned).collect();
        let mut command = desk.command(&args.iter().map(String::as_str).collect::<Vec<_>>());
        assert!(command.env("RAYON_NUM_THREADS", threads).stderr(Stdio::null()).status().unwrap().success());
        std::fs::read(desk.path("pile.csv")).unwrap()
    });
    assert_eq!(one, many);
}

#[test]
fn progress_goes_to_stderr_in_the_form_asked_for() {
    let desk = Desk::new();
    let done = desk.line(&format!("bake {SCENE} -o pile.glb --progress json"));
    let lines: Vec<Value> = done.stderr.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(lines.iter().any(|line| line["stage"] == "fill" && line["fraction"].is_number()), "{}", done.stderr);
    let result = lines.last().unwrap();
    assert!(result["result"] == "pile.glb" && result["bodies"] == 12 && result["seconds"].is_number(), "{result}");
    assert_eq!(done.ok(), "");

    // Progress for farms goes to stdout, which then carries nothing else; faults, too.
    let done = desk.line(&format!("bake {SCENE} -o pile.glb --progress openjd"));
    assert!(done.stdout.lines().all(|line| line.starts_with("openjd_")), "{}", done.stdout);
    assert!(done.ok().contains("openjd_progress: 100\n"));
    let done = desk.line(&format!("bake {SCENE} -o - --progress openjd"));
    assert_eq!(done.code, 2);
    assert!(done.stdout.starts_with("openjd_fail: --progress openjd: "), "{}", done.stdout);

    let done = desk.line(&format!("bake {SCENE} -o pile.glb --quiet"));
    assert_eq!(done.stderr, "");
    assert_eq!(done.ok(), "");
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_nothing_behind() {
    a_signal_leaves_nothing_behind("-INT", 130, "cancelled");
}

/// A farm stops a task like this, to run it again.
#[cfg(unix)]
#[test]
fn sigterm_leaves_nothing_behind() {
    a_signal_leaves_nothing_behind("-TERM", 75, "run the command again");
}

#[cfg(unix)]
fn a_signal_leaves_nothing_behind(signal: &str, code: i32, message: &str) {
    let desk = Desk::new();
    let before = desk.files();
    let mut bake =
        desk.command(&["bake", "--control", "cone.glb", "--prop", "stick.glb", "-o", "pile.glb", "--progress", "json"]);
    let mut bake = bake.stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(bake.stderr.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.any(|line| line.contains("\"fill\"")));
    let id = bake.id().to_string();
    assert!(Command::new("kill").args([signal, &id]).status().unwrap().success());
    assert_eq!(bake.wait().unwrap().code(), Some(code));
    assert!(lines.any(|line| line.contains(message)));
    assert_eq!(desk.files(), before);
}
