//! Outputs: checked before any work, written complete or not at all.

use crate::cli::desk::{Desk, Done, box_data, box_json, glb};
use serde_json::{Value, json};

const SCENE: &str = "--control cone.glb --prop stick.glb --accuracy draft --set fill.count=12";

#[test]
fn places_where_no_file_can_be() {
    let desk = Desk::new();
    std::fs::create_dir(desk.path("folder.glb")).unwrap();
    let before = desk.files();
    let long = format!("{}.glb", "x".repeat(300));
    for (code, output, message) in [
        (2, "pile.fbx", ".glb, .usdc, .usda, .usdz, .json, .csv, .xml, .physics.glb, .hulls.glb or .pack.zip"),
        (2, "pile", ".hulls.glb or .pack.zip"),
        (65, "folder.glb", "folder.glb"),
        (65, "gone/pile.glb", "gone"),
        (65, &long, "no file can have this name"),
        (65, "stick.glb", "the scene reads this file"),
    ] {
        desk.line(&format!("bake {SCENE} -o {output}")).fails(code, &[message]);
        assert_eq!(desk.files(), before);
    }
    let long = format!("{}.json", "x".repeat(300));
    for (code, report, message) in [
        (65, "gone/report.json", "gone"),
        (65, ".", "folder"),
        (65, &long, "Choose a shorter, plain name"),
        (2, "pile.json", "replace"),
    ] {
        desk.line(&format!("bake {SCENE} -o pile.json --report {report}")).fails(code, &[message]);
        assert_eq!(desk.files(), before);
    }
}

/// What can be known of the disk is known before the bake: it takes no time, and nothing is lost.
#[test]
fn disks_without_room_are_known_before_the_bake() {
    let desk = Desk::new();
    let before = desk.files();
    for (faults, line, words) in [
        (
            "output-room=return(ENOSPC)",
            "bake -o pile.glb",
            &["pile.glb: up to 1 MiB are expected", "0 MiB left", "Make room there"][..],
        ),
        (
            "output-room=return(ENOSPC)",
            "batch --seeds 0..19 -o {seed}.glb",
            &["0.glb: up to ", " MiB are expected", "0 MiB left", "Make room there"],
        ),
        (
            "output-folder=return(EROFS)",
            "bake -o pile.glb",
            &["nothing can be written in .: ", "Choose another folder"],
        ),
    ] {
        let mut command = desk.command(&line.split_whitespace().collect::<Vec<_>>());
        command.args(SCENE.split_whitespace()).args(["--progress", "json"]).env("FAILPOINTS", faults);
        let done = Done::of(command.output().unwrap());
        assert_eq!(done.code, 65, "{}", done.stderr);
        assert!(words.iter().all(|word| done.stderr.contains(word)), "{}", done.stderr);
        // No stage had begun.
        assert!(!done.stderr.contains("\"fill\""), "{}", done.stderr);
        assert_eq!(desk.files(), before);
    }
    // With room, nothing is said.
    let done = desk.line(&format!("bake {SCENE} -o pile.glb"));
    assert!(done.code == 0 && !done.stderr.contains("MiB"), "{}", done.stderr);
}

/// What may pass is to be tried again, what does not is to be changed; the remedy is that of the cause.
#[test]
fn faults_of_writing_have_their_own_remedies() {
    let desk = Desk::new();
    for (fault, code, remedy) in [
        ("ENOSPC", 75, "Make room on the disk, and run the command again"),
        ("ENOENT", 75, "Make sure that the folder exists"),
        ("EIO", 75, "Check the disk, and run the command again"),
        ("ENAMETOOLONG", 65, "Choose a shorter name"),
        ("EACCES", 65, "Change its permissions, or choose another folder"),
    ] {
        let mut command = desk.command(&["bake", "-o", "pile.glb"]);
        command.args(SCENE.split_whitespace()).env("FAILPOINTS", format!("files-rename=return({fault})"));
        let done = Done::of(command.output().unwrap());
        assert!(done.code == code && done.stderr.contains(remedy), "{fault}: {}", done.stderr);
        assert!(done.stderr.contains("pile.glb: cannot be written: ") && !desk.path("pile.glb").exists());
    }
}

#[test]
fn commands_that_say_too_little() {
    let desk = Desk::new();
    desk.line("bake -o pile.glb").fails(2, &["no scene is given", "--control and --prop"]);
    desk.line("bake --control cone.glb --prop stick.glb").fails(2, &["--output <FILE>"]);
    desk.line("bake --acuracy draft").fails(2, &["--accuracy"]);
    desk.line("back").fails(2, &["bake"]);
    desk.line("check --accuracy standart").fails(2, &["standart", "standard"]);
}

#[test]
fn help_and_version() {
    let desk = Desk::new();
    assert_eq!(desk.line("--version").ok(), format!("cairn {}\n", env!("CARGO_PKG_VERSION")));
    for command in [
        "",
        "analyse",
        "bake",
        "cancel",
        "check",
        "completions",
        "doctor",
        "man",
        "pack",
        "plan",
        "render",
        "scene",
        "schema",
        "serve",
        "watch",
    ] {
        let help = desk.line(&format!("{command} --help")).ok();
        assert!(help.contains("Examples:"), "{help}");
    }
}

#[test]
fn a_reader_that_goes_away_is_no_fault() {
    let desk = Desk::new();
    let mut command = desk.command(&["scene", "--full", "--control", "cone.glb", "--prop", "stick.glb"]);
    let mut child = command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let done = child.wait_with_output().unwrap();
    assert!(done.status.success() && done.stderr.is_empty(), "{done:?}");
}

/// The size of files is limited to 30 or 60 kilobytes, enough for the report, as on a disk that holds no larger ones.
#[cfg(unix)]
#[test]
fn a_result_that_is_too_large_for_the_disk_leaves_nothing() {
    let desk = Desk::new();
    let before = desk.files();
    let program = env!("CARGO_BIN_EXE_cairn");
    let script = format!(
        "trap '' XFSZ; ulimit -f 60; exec {program} bake --no-cache {SCENE} --frames 200 --report report.json \
         -o pile.json"
    );
    let done = std::process::Command::new("sh").args(["-c", &script]).current_dir(desk.path("")).output().unwrap();
    let message = String::from_utf8(done.stderr).unwrap();
    assert_eq!(done.status.code(), Some(65), "{message}");
    assert!(message.contains("pile.json: cannot be written") && message.contains("Bake fewer frames"), "{message}");
    assert_eq!(desk.files(), before);
}

/// Links are followed, FIFOs and the standard output receive results, and read-only files stay.
#[cfg(unix)]
#[test]
fn results_go_where_a_path_leads() {
    use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
    let desk = Desk::new();
    desk.line(&format!("bake {SCENE} -o plain.json -q")).ok();
    let plain = std::fs::read_to_string(desk.path("plain.json")).unwrap();

    std::fs::create_dir(desk.path("results")).unwrap();
    for (link, target) in [("there.json", "results/there.json"), ("dangling.json", "results/new.json")] {
        if link == "there.json" {
            desk.write(target, "of before");
        }
        symlink(target, desk.path(link)).unwrap();
        desk.line(&format!("bake {SCENE} -o {link} -q")).ok();
        assert!(desk.path(link).is_symlink());
        assert_eq!(std::fs::read_to_string(desk.path(target)).unwrap(), plain);
    }

    assert!(std::process::Command::new("mkfifo").arg(desk.path("fifo.json")).status().unwrap().success());
    let fifo = desk.path("fifo.json");
    let reader = std::thread::spawn(move || std::fs::read_to_string(fifo).unwrap());
    desk.line(&format!("bake {SCENE} -o fifo.json -q")).ok();
    assert_eq!(reader.join().unwrap(), plain);
    assert!(std::fs::metadata(desk.path("fifo.json")).unwrap().file_type().is_fifo());

    assert_eq!(desk.line(&format!("bake {SCENE} -o - --format json -q")).ok(), plain);

    desk.write("kept.json", "kept");
    std::fs::set_permissions(desk.path("kept.json"), std::fs::Permissions::from_mode(0o444)).unwrap();
    desk.line(&format!("bake {SCENE} -o kept.json")).fails(65, &["kept.json", "read-only"]);
    assert_eq!(std::fs::read_to_string(desk.path("kept.json")).unwrap(), "kept");
}

#[test]
fn a_view_is_written_as_arrays() {
    let desk = Desk::new();
    desk.write("box.glb", glb(&box_json(), &box_data([0.2, 0.2, 0.2])));
    desk.line("render box.glb -o view.npz --size 16x12").ok();
    let bytes = std::fs::read(desk.path("view.npz")).unwrap();
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(bytes)).unwrap();
    let names: Vec<String> = archive.file_names().map(String::from).collect();
    assert_eq!(names, ["bodies.npy", "depth.npy", "camera.npy", "intrinsics.npy"]);
    let mut bodies = Vec::new();
    std::io::copy(&mut archive.by_name("bodies.npy").unwrap(), &mut bodies).unwrap();
    assert!(bodies.starts_with(b"\x93NUMPY\x01\x00"));
    assert_eq!(bodies.len() % 64, 0);
    let header = String::from_utf8_lossy(&bodies[10..128]);
    assert!(header.contains("'descr': '<i4', 'fortran_order': False, 'shape': (12, 16, ), "), "{header}");
    let numbers: Vec<i32> =
        bodies[bodies.len() - 4 * 12 * 16..].chunks(4).map(|b| i32::from_le_bytes(b.try_into().unwrap())).collect();
    assert_eq!((numbers[0], numbers[6 * 16 + 8]), (-1, 0));
    let removals = |list: Value| {
        desk.write("report.json", json!({ "removals": list }).to_string());
        desk.line("render box.glb -o view.npz --removals report.json")
    };
    removals(json!([])).fails(65, &["report.json: no body was taken away"]);
    let pose = json!({ "translation": [0, 0, 0], "rotation": [0, 0, 0, 1] });
    let removal = |body: usize| {
        let nothing = json!([]);
        json!([{ "body": body, "frame": 1, "rest_frame": 1, "rest_on_it": nothing, "touches": nothing,
            "moved": nothing, "came_down": nothing, "at_rest": true, "speed": 0, "before": [pose], "after": [pose] }])
    };
    removals(removal(1)).fails(65, &["not a report: a removal names a body that is not there"]);
    removals(removal(0)).fails(65, &["states no frame rate"]);
}

/// A result in JSON is a scene as a `.glb` is, and a scene file in JSON stays one.
#[test]
fn results_in_json_are_scenes() {
    let desk = Desk::new();
    desk.line(&format!("bake {SCENE} -o pile.json -q")).ok();
    desk.line(&format!("bake {SCENE} -o pile.glb -q")).ok();
    desk.line("bake pile.json -o again.glb -q").ok();
    let read = |name: &str| std::fs::read(desk.path(name)).unwrap();
    assert!(read("again.glb") == read("pile.glb"));
    assert!(desk.line("verify pile.json").ok().contains("pile.json: the same"));
    let text = String::from_utf8(read("pile.json")).unwrap();
    desk.write("pile.json", text.replacen("\"fps\":", "\"fps\": ", 1));
    let done = desk.line("verify pile.json");
    assert_eq!((done.code, done.stdout.contains("DIFFERS")), (1, true), "{}", done.stdout);
    let scene = desk.line(&format!("scene {SCENE} --json")).ok();
    desk.write("scene.json", scene);
    desk.line("bake scene.json -o third.glb -q").ok();
    assert!(read("third.glb") == read("pile.glb"));
}

/// What holds no scene says so.
#[test]
fn some_results_cannot_be_verified() {
    let desk = Desk::new();
    for name in ["pile.csv", "pile.xml", "pile.pack.zip"] {
        desk.write(name, "any");
        let ending = name.trim_start_matches("pile");
        let what = format!("a {ending} cannot be verified: it does not hold its scene");
        desk.line(&format!("verify {name}")).fails(65, &[&what, "compare output_blake3"]);
    }
    std::fs::create_dir(desk.path("pack")).unwrap();
    desk.write("pack/manifest.json", "{}");
    desk.line("verify pack").fails(65, &["a pack cannot be verified"]);
}
