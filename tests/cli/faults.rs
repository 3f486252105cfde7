//! A fault at each place where the command line writes: a message, the exit code to try again, and nothing half
//! written.

use crate::cli::desk::{Desk, Done};

const SCENE: &str = "--control cone.glb --prop stick.glb --accuracy draft --set fill.count=12";

fn with_faults(desk: &Desk, faults: &str, line: &str) -> Done {
    let args: Vec<&str> = line.split_whitespace().collect();
    Done::of(desk.command(&args).env("FAILPOINTS", faults).output().unwrap())
}

/// An old result stays until the whole new one is on the disk. The result is written before its report, and no report
/// of another result is left beside it.
#[test]
fn a_result_and_its_report() {
    let desk = Desk::new();
    let line = format!("bake {SCENE} -o pile.json --report report.json -q");
    for is_there in [false, true] {
        let nothing = desk.files();
        for place in ["files-create", "files-write", "files-sync", "files-rename"] {
            let reset = || {
                for name in ["pile.json", "report.json"] {
                    let _ = std::fs::remove_file(desk.path(name));
                    if is_there {
                        desk.write(name, "of before");
                    }
                }
            };
            reset();
            let before = desk.files();
            with_faults(&desk, &format!("{place}=return(ENOSPC)"), &line)
                .fails(75, &["pile.json: cannot be written", "No space"]);
            assert_eq!(desk.files(), before, "{place}");
            if is_there {
                for name in ["pile.json", "report.json"] {
                    assert_eq!(std::fs::read_to_string(desk.path(name)).unwrap(), "of before", "{place}");
                }
            }
            with_faults(&desk, &format!("{place}=1*off->return(ENOSPC)"), &line)
                .fails(75, &["report.json: cannot be written", "No space"]);
            let result = std::fs::read(desk.path("pile.json")).unwrap();
            serde_json::from_slice::<serde_json::Value>(&result).unwrap();
            std::fs::remove_file(desk.path("pile.json")).unwrap();
            assert_eq!(desk.files(), nothing, "{place}");
        }
        // They have their names, but a power cut might undo that.
        with_faults(&desk, "files-sync-folder=return(EIO)", &line).fails(75, &["cannot be written"]);
        assert!(desk.files().iter().all(|name| !name.ends_with(".part")));
        desk.line(&line).ok();
        for name in ["pile.json", "report.json"] {
            serde_json::from_slice::<serde_json::Value>(&std::fs::read(desk.path(name)).unwrap()).unwrap();
            std::fs::remove_file(desk.path(name)).unwrap();
        }
    }
}

/// A fault in the measures does not remove the result.
#[test]
fn a_result_does_not_wait_for_its_figures() {
    let desk = Desk::new();
    let line = format!("bake {SCENE} -o pile.json --report report.json -q");
    with_faults(&desk, "measure=panic", &line).fails(70, &["This is a fault in Cairn"]);
    let result = std::fs::read(desk.path("pile.json")).unwrap();
    serde_json::from_slice::<serde_json::Value>(&result).unwrap();
    assert!(!desk.path("report.json").exists());
}

/// A disk may be full after all: the pile is kept in the cache, and the same command takes it from there.
#[test]
fn a_pile_that_cannot_be_written_is_not_lost() {
    let desk = Desk::new();
    // The first is written before its figures, the second after them.
    for output in ["pile.json", "pile.usdz"] {
        let run = |faults: &str| {
            let line = format!("bake {SCENE} --progress none --report report.json -o {output}");
            let mut command = desk.command(&line.split_whitespace().collect::<Vec<_>>());
            let cache = desk.path(&format!("cache of {output}"));
            Done::of(
                command
                    .env_remove("CAIRN_NO_CACHE")
                    .env("CAIRN_CACHE", cache)
                    .env("FAILPOINTS", faults)
                    .output()
                    .unwrap(),
            )
        };
        let kept = "Make room on the disk, and run the command again. The cache keeps the pile until then.";
        run("files-write=return(ENOSPC)").fails(75, &[output, "No space", kept]);
        assert!(!desk.path(output).exists() && !desk.path("report.json").exists());
        let done = run("");
        assert!(done.code == 0 && done.stderr.contains("comes from the cache"), "{output}: {}", done.stderr);
        // A cache that is full, too, promises nothing.
        std::fs::remove_dir_all(desk.path(&format!("cache of {output}"))).unwrap();
        std::fs::remove_file(desk.path("report.json")).unwrap();
        let lost = run("files-write=return(ENOSPC);cache-write=return(ENOSPC)");
        assert!(lost.code == 75 && !lost.stderr.contains("The cache keeps"), "{}", lost.stderr);
    }
}

/// Output to a stream cannot be undone, but the fault is reported, and the report does not appear.
#[test]
fn streams() {
    let desk = Desk::new();
    let before = desk.files();
    let line = format!("bake {SCENE} -o - --format json --report report.json -q");
    for what in ["ENOSPC", "EPIPE"] {
        with_faults(&desk, &format!("stdout-write=return({what})"), &line).fails(75, &["-: cannot be written"]);
        assert_eq!(desk.files(), before);
    }
    with_faults(&desk, "stream-write=return(EIO)", &format!("bake {SCENE} -o /dev/null --format json -q"))
        .fails(75, &["/dev/null: cannot be written"]);
    desk.line(&line).ok();
    let scene = "scene --control cone.glb --prop stick.glb";
    with_faults(&desk, "stdout-write=return(ENOSPC)", scene).fails(75, &["the standard output", "No space"]);
    assert_eq!(with_faults(&desk, "stdout-write=return(EPIPE)", scene).code, 0, "a reader that goes away is no fault");
}

/// Pictures also appear complete or not at all. A fault in the cache does not fail the bake.
#[test]
fn pictures_and_caches() {
    let desk = Desk::new();
    let bake = format!("bake {SCENE} -o pile.glb -q");
    let args: Vec<&str> = bake.split_whitespace().collect();
    let mut command = desk.command(&args);
    command
        .env_remove("CAIRN_NO_CACHE")
        .env("CAIRN_CACHE", desk.path("cache"))
        .env("FAILPOINTS", "cache-write=return(EIO)");
    Done::of(command.output().unwrap()).ok();
    let before = desk.files();
    let render = "render pile.glb -o pile.png --size 64x48 --samples 1";
    for place in ["files-create", "files-write", "files-sync", "files-rename"] {
        with_faults(&desk, &format!("{place}=return(EIO)"), render).fails(75, &["pile.png: cannot be written"]);
        assert_eq!(desk.files(), before, "{place}");
    }
    desk.line(render).ok();
}

/// A truncated line of a study's ledger is skipped, and the study continues after it.
#[test]
fn a_ledger_that_is_cut_off() {
    let desk = Desk::new();
    let line = "cost --control cone.glb --prop stick.glb -o study --bodies 40 --seeds 1";
    let lines = || std::fs::read_to_string(desk.path("study/runs.jsonl")).unwrap();
    let is_record = |line: &&str| serde_json::from_str::<serde_json::Value>(line).is_ok();
    with_faults(&desk, "ledger-write=return(ENOSPC)", line).fails(75, &["runs.jsonl: cannot be written", "No space"]);
    assert!(!lines().is_empty() && lines().lines().filter(is_record).count() == 0, "half a line is there");
    with_faults(&desk, "ledger-write=1*off->return(ENOSPC)", line).fails(75, &["runs.jsonl: cannot be written"]);
    assert_eq!(lines().lines().filter(is_record).count(), 1);
}

/// The ledger is opened before anything is baked.
#[test]
fn a_ledger_that_cannot_be_opened() {
    let desk = Desk::new();
    let before = desk.files();
    let line = "cost --control cone.glb --prop stick.glb -o study --bodies 40 --seeds 1";
    with_faults(&desk, "ledger-open=return(ENOSPC)", line).fails(75, &["runs.jsonl: cannot be written", "No space"]);
    assert_eq!(desk.files(), before);
}

/// With a memory limit, a child process does the work. If none can be started, the scene is not at fault.
#[test]
fn a_process_that_cannot_be_started() {
    let desk = Desk::new();
    let before = desk.files();
    let line = format!("bake {SCENE} -o pile.json -q --max-memory-mib 8192");
    with_faults(&desk, "bounded-spawn=return(ENOMEM)", &line).fails(75, &["no process could be started"]);
    assert_eq!(desk.files(), before);
    desk.line(&line).ok();
}

/// Under a limit of memory or processes, threads may not start: the scene is not at fault.
#[test]
fn threads_that_cannot_be_started() {
    let desk = Desk::new();
    let before = desk.files();
    let line = format!("bake {SCENE} -o pile.json -q");
    with_faults(&desk, "threads-start=return(EAGAIN)", &line).fails(75, &["no thread could be started"]);
    assert_eq!(desk.files(), before);
}

/// A killed command leaves no incomplete result, and the next one removes its temporary files.
#[cfg(unix)]
#[test]
fn a_command_that_is_killed() {
    use std::os::unix::process::ExitStatusExt;
    let line = format!("bake {SCENE} -o pile.json --report report.json -q");
    let args: Vec<&str> = line.split_whitespace().collect();
    // At the first written file, and at the second, when the result is complete.
    for (before, has_result) in [("", false), ("1*off->", true)] {
        for place in ["files-create", "files-write", "files-sync", "files-rename"] {
            let desk = Desk::new();
            let clean = desk.files();
            let faults = format!("{place}={before}return(KILL)");
            let done = desk.command(&args).env("FAILPOINTS", &faults).output().unwrap();
            assert_eq!(done.status.signal(), Some(9), "{faults}");
            let left = desk.files();
            assert_eq!(left.contains(&"pile.json".to_owned()), has_result, "{faults}: {left:?}");
            assert!(!left.contains(&"report.json".to_owned()), "{faults}: {left:?}");
            let parts: Vec<_> = left.iter().filter(|name| name.ends_with(".part")).collect();
            assert_eq!(parts.len(), usize::from(place != "files-create"), "{faults}: {left:?}");
            // A new temporary file may belong to another command.
            let hour_ago = std::time::SystemTime::now() - std::time::Duration::from_secs(3600);
            for part in parts {
                std::fs::File::options().append(true).open(desk.path(part)).unwrap().set_modified(hour_ago).unwrap();
            }
            desk.line(&line).ok();
            let mut expected = [clean, vec!["pile.json".into(), "report.json".into()]].concat();
            expected.sort();
            assert_eq!(desk.files(), expected, "{faults}");
            for name in ["pile.json", "report.json"] {
                serde_json::from_slice::<serde_json::Value>(&std::fs::read(desk.path(name)).unwrap()).unwrap();
            }
        }
    }
}
