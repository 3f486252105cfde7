//! Batches of bakes of one scene, and results that are baked again.

use crate::cli::desk::{Desk, Done};
use serde_json::Value;
use std::process::Command;

const SCENE: &str = "--control cone.glb --prop stick.glb --accuracy draft --set fill.count=8";

/// A batch with a cache of its own, which only tests of the cache have.
fn batch(desk: &Desk, args: &str) -> Command {
    let line = format!("batch {SCENE} {args}");
    let mut command = desk.command(&line.split_whitespace().collect::<Vec<_>>());
    command.env_remove("CAIRN_NO_CACHE").env("CAIRN_CACHE", desk.path("cache"));
    command
}

fn run(desk: &Desk, args: &str) -> Done {
    Done::of(batch(desk, args).output().unwrap())
}

fn report(desk: &Desk, name: &str) -> Value {
    serde_json::from_slice(&std::fs::read(desk.path(name)).unwrap()).unwrap()
}

fn hash(desk: &Desk, name: &str) -> blake3::Hash {
    blake3::hash(&std::fs::read(desk.path(name)).unwrap())
}

#[test]
fn a_matrix_is_baked_once() {
    let desk = Desk::new();
    let args = "--seeds 3..4 --vary control=hold,off -o out/{seed}-{control}.glb";
    let table = run(&desk, args).ok();
    assert!(table.ends_with("4 baked\n"), "{table}");
    let names = ["3-hold", "3-off", "4-hold", "4-off"].map(|name| format!("out/{name}.glb"));
    let hashes = names.each_ref().map(|name| hash(&desk, name));
    // The fill does not depend on the control: one bake simulates it, and the other reuses it.
    for seed in [3, 4] {
        let recalled = ["hold", "off"].map(|control| {
            report(&desk, &format!("out/{seed}-{control}.report.json"))["counts"]["fill_steps_recalled"]
                .as_u64()
                .unwrap()
        });
        assert_eq!(recalled.iter().filter(|steps| **steps > 0).count(), 1, "{recalled:?}");
    }
    // A single bake of the same variant gives the same result.
    desk.line(&format!("bake {SCENE} --seed 3 --set control=off -o single.glb -q")).ok();
    assert_eq!(hash(&desk, "single.glb"), hashes[1]);

    assert!(run(&desk, args).ok().ends_with("4 finished before\n"));
    // Only changed results, missing ones and ones without a report are baked again.
    desk.write(&names[0], "of before");
    std::fs::remove_file(desk.path(&names[1])).unwrap();
    std::fs::remove_file(desk.path("out/4-hold.report.json")).unwrap();
    assert!(run(&desk, args).ok().ends_with("3 baked, 1 finished before\n"));
    assert_eq!(names.each_ref().map(|name| hash(&desk, name)), hashes);
    // Another scene under the same names is another request.
    assert!(run(&desk, &format!("{args} --set fill.count=7")).ok().ends_with("4 baked\n"));
}

#[test]
fn parts_make_the_whole() {
    let desk = Desk::new();
    let args = "--seeds 0..3 -o {index}.csv";
    assert!(run(&desk, &format!("{args} --range 0-1")).ok().ends_with("2 baked\n"));
    assert!(run(&desk, &format!("{args} --range 2-9")).ok().ends_with("2 baked\n"));
    assert!(run(&desk, args).ok().ends_with("4 finished before\n"));
    run(&desk, &format!("{args} --range 4-5")).fails(2, &["there are 4 variants"]);
    let listing = run(&desk, &format!("{args} --dry-run --set fill.count=6")).ok();
    assert_eq!(listing.lines().filter(|line| line.ends_with("missing")).count(), 4, "{listing}");
}

#[test]
fn a_failure_does_not_end_the_others() {
    let desk = Desk::new();
    let mut command = batch(&desk, "--seeds 0..2 -o out/{seed}.glb --jobs 1 --progress none");
    let done = Done::of(command.env("FAILPOINTS", "batch-spawn=1*return(ENOMEM)").output().unwrap());
    assert!(done.stdout.ends_with("2 baked, 1 failed\n"), "{}", done.stdout);
    done.fails(75, &["out/0.glb: its process could not be started"]);
    assert!(run(&desk, "--seeds 0..2 -o out/{seed}.glb").ok().ends_with("1 baked, 2 finished before\n"));
}

#[test]
fn what_is_wrong_is_told_before_any_work() {
    let desk = Desk::new();
    let before = desk.files();
    let args = "--seeds 0..2 --vary fill.count=-1,4 --vary props.0.weight=1,0 -o {seed}-{count}-{weight}.glb";
    run(&desk, args).fails(65, &["fill.count", "is negative"]);
    run(&desk, "--vary props.0.density=1000,-1 -o {density}.glb").fails(65, &["density"]);
    run(&desk, "--seeds 0..2 -o pile.glb").fails(2, &["two variants", "{seed}"]);
    run(&desk, "--vary acuracy=draft -o pile.glb").fails(2, &["--vary acuracy", "Did you mean `accuracy`?"]);
    assert_eq!(desk.files(), before);
}

/// The bake and the batch are killed at each place where they change a file. No result is half written, and the same
/// command completes the batch.
#[cfg(unix)]
#[test]
fn a_batch_that_is_killed() {
    let args = "--seeds 0..1 -o out/{seed}.glb --jobs 1 --progress none";
    let whole = Desk::new();
    run(&whole, args).ok();
    let expected = ["out/0.glb", "out/1.glb"].map(|name| hash(&whole, name));
    let places = ["files-create", "files-write", "files-sync", "files-rename", "files-sync-folder", "cache-write"];
    let faults = places.iter().flat_map(|place| ["", "1*off->"].map(|before| format!("{place}={before}return(KILL)")));
    for fault in faults.chain(["batch-folder=return(KILL)".into(), "batch-spawn=1*off->return(KILL)".into()]) {
        let desk = Desk::new();
        batch(&desk, args).env("FAILPOINTS", &fault).output().unwrap();
        for (name, expected) in ["out/0.glb", "out/1.glb"].iter().zip(expected) {
            assert!(!desk.path(name).exists() || hash(&desk, name) == expected, "{fault}: {name}");
        }
        run(&desk, args).ok();
        assert_eq!(["out/0.glb", "out/1.glb"].map(|name| hash(&desk, name)), expected, "{fault}");
    }
}

#[test]
fn a_result_is_its_scene() {
    let desk = Desk::new();
    std::fs::create_dir_all(desk.path("shot/models")).unwrap();
    for name in ["cone.glb", "stick.glb"] {
        std::fs::copy(desk.path(name), desk.path(&format!("shot/models/{name}"))).unwrap();
    }
    let scene =
        "control_mesh = 'models/cone.glb'\naccuracy = 'draft'\nfill.count = 8\n[[props]]\npath = 'models/stick.glb'\n";
    desk.write("shot/scene.toml", scene);
    std::fs::remove_file(desk.path("cone.glb")).unwrap();
    desk.line("bake shot/scene.toml -o pile.glb -q").ok();
    // The bytes do not depend on the scene's location and reveal nothing of the machine.
    let absolute = desk.path("shot/scene.toml");
    desk.line(&format!("bake {} -o other.glb -q", absolute.display())).ok();
    assert_eq!(hash(&desk, "other.glb"), hash(&desk, "pile.glb"));
    let bytes = std::fs::read(desk.path("pile.glb")).unwrap();
    let folder = absolute.parent().unwrap().parent().unwrap().to_str().unwrap().to_owned();
    assert!(!String::from_utf8_lossy(&bytes).contains(&folder));

    desk.line("bake pile.glb -o again.glb -q").ok();
    assert_eq!(hash(&desk, "again.glb"), hash(&desk, "pile.glb"));
    assert_eq!(desk.line("verify pile.glb again.glb other.glb --sample 2").ok().lines().count(), 2);

    let mut changed = bytes.clone();
    *changed.last_mut().unwrap() ^= 1;
    desk.write("changed.glb", changed);
    let done = desk.line("verify changed.glb");
    assert_eq!((done.code, done.stdout.contains("changed.glb: DIFFERS")), (1, true), "{}", done.stdout);
    // A changed file is not accepted.
    std::fs::copy(desk.path("stick.glb"), desk.path("shot/models/cone.glb")).unwrap();
    desk.line("bake pile.glb -o again.glb -q")
        .fails(65, &["models/cone.glb is not here with the content that was baked", "--assets"]);
    desk.line("verify stick.glb").fails(65, &["a mesh, not a scene file"]);
}
