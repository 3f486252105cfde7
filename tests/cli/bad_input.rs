//! Bad input: a message with place and remedy, an exit code for the kind of fault, and no output file.

use crate::cli::desk::{Desk, Done, box_data, box_json, glb};
use serde_json::json;

/// Bakes `--control cone.glb` with other arguments and expects exit code 65, these words, and nothing written.
#[track_caller]
fn refused(desk: &Desk, args: &str, words: &[&str]) {
    let before = desk.files();
    desk.line(&format!("bake -o pile.glb --report report.json {args}")).fails(65, words);
    assert_eq!(desk.files(), before);
}

#[test]
fn files_that_cannot_be_read() {
    let desk = Desk::new();
    desk.write("empty.glb", "");
    std::fs::create_dir(desk.path("folder.glb")).unwrap();
    refused(&desk, "--control cone.glb --prop stik.glb", &["stik.glb: no such file", "Did you mean stick.glb?"]);
    refused(&desk, "--control cone.glb --prop no/stick.glb", &["no/stick.glb: no such file", "no folder no"]);
    refused(&desk, "--control cone.glb --prop empty.glb", &["empty.glb: the file is empty", "Export it again"]);
    refused(&desk, "--control folder.glb --prop stick.glb", &["folder.glb: a folder", "Name a file in it"]);
    refused(&desk, "--control cone.glb --prop kit.obj", &["kit.obj"]);
}

/// From old archives and Windows shares.
#[cfg(unix)]
#[test]
fn names_that_are_no_text() {
    use std::os::unix::ffi::OsStrExt;
    let desk = Desk::new();
    let odd = |name: &[u8]| desk.path("").join(std::ffi::OsStr::from_bytes(name));
    let (model, folder) = (odd(b"bad\xff.glb"), odd(b"old\xe9"));
    std::fs::create_dir(&folder).unwrap();
    std::fs::copy(desk.path("stick.glb"), &model).unwrap();
    desk.write("scene.toml", "control_mesh = \"../cone.glb\"\nprops = [\"../stick.glb\"]\nfill.count = 3\n");
    std::fs::copy(desk.path("scene.toml"), folder.join("scene.toml")).unwrap();
    let check = || desk.command(&["check"]);
    let mut of_prop = check();
    of_prop.args(["--control", "cone.glb", "--prop"]).arg(&model);
    let mut of_scene = check();
    of_scene.arg(folder.join("scene.toml"));
    let mut within = check();
    within.arg("scene.toml").current_dir(&folder);
    for (case, mut command, code, words) in [
        (
            "when a prop has an odd name",
            of_prop,
            2,
            ["bad\u{fffd}.glb: this name is not UTF-8 text", "Rename the file"],
        ),
        (
            "when a scene is in a folder with an odd name",
            of_scene,
            65,
            ["old\u{fffd}/scene.toml: the name of its folder is not UTF-8 text", "go into it"],
        ),
        ("when it is named from there", within, 0, ["", ""]),
    ] {
        let done = Done::of(command.output().unwrap());
        assert_eq!(done.code, code, "{case}: {}", done.stderr);
        assert!(words.iter().all(|words| done.stderr.contains(words)), "{case}: {}", done.stderr);
    }
    // JSON lines are asked for, and given.
    let mut command =
        desk.command(&["bake", "--progress", "json", "-o", "pile.glb", "--control", "cone.glb", "--prop"]);
    let done = Done::of(command.arg(&model).output().unwrap());
    assert!(done.code == 2 && done.stderr.starts_with("{\"error\":\""), "{}", done.stderr);
}

#[test]
fn all_problems_at_once() {
    let desk = Desk::new();
    let args = "--control no.glb --prop brick.glb#Brik --prop gone.glb --static away.glb --set fill.friction=-1";
    refused(&desk, args, &["no.glb", "brick.glb", "`Brik`", "`Brick`", "gone.glb", "away.glb", "fill.friction"]);
}

#[test]
fn a_scene_without_its_parts() {
    let desk = Desk::new();
    refused(&desk, "--prop stick.glb", &["no control mesh", "--control"]);
    refused(&desk, "--control cone.glb", &["no props", "--prop"]);
}

#[test]
fn weights_that_are_none() {
    let desk = Desk::new();
    refused(&desk, "--control cone.glb --prop stick.glb:0", &["weight 0", "stick.glb", "give one"]);
    for weight in ["-1", "nan", "inf", "-inf"] {
        refused(
            &desk,
            &format!("--control cone.glb --prop stick.glb:{weight}"),
            &["weight", "stick.glb", "out of range"],
        );
    }
    desk.line("bake -o pile.glb --control cone.glb --prop stick.glb:much").fails(2, &["much", "not a number"]);
}

#[test]
fn values_out_of_range() {
    let desk = Desk::new();
    let scene = "--control cone.glb --prop stick.glb";
    for (set, words) in [
        ("gravity=0", "gravity"),
        ("gravity=nan", "gravity"),
        ("physics.step_seconds=0", "physics.step"),
        ("physics.substeps=-1", "physics.substeps"),
        ("props.0.scale_min=-1", "scale"),
        ("props.0.density=0", "density"),
        ("fill.count=0", "fill.count"),
        ("output.fps=0", "output.fps"),
    ] {
        refused(&desk, &format!("{scene} --set {set}"), &[words]);
    }
}

/// Lengths far beyond those of any thing overflow nothing: they are planned or refused.
#[test]
fn lengths_beyond_all_measure() {
    let desk = Desk::new();
    for size in [1e-38, 1e-30, 1e-12, 1e12, 1e30, 1e37] {
        desk.write("odd.glb", glb(&box_json(), &box_data([size; 3])));
        let mut scaled = box_json();
        scaled["nodes"][0]["scale"] = json!([size, size, size]);
        desk.write("scaled.glb", glb(&scaled, &box_data([0.3, 0.2, 0.4])));
        for odd in ["odd.glb", "scaled.glb"] {
            for scene in [
                format!("--control cone.glb --prop {odd}"),
                format!("--control {odd} --prop brick.glb"),
                format!("--control {odd} --prop {odd}"),
                format!("--control cone.glb --prop brick.glb --prop {odd} --set release.interval_natural=1e-9"),
            ] {
                // It checks, too.
                let done = desk.line(&format!("plan {scene}"));
                assert!([0, 65].contains(&done.code), "{scene}, {size:e}: {}", done.stderr);
            }
        }
    }
}

#[test]
fn a_prop_larger_than_the_control_mesh() {
    let desk = Desk::new();
    desk.write("beam.glb", glb(&box_json(), &box_data([0.1, 100.0, 0.1])));
    refused(&desk, "--control cone.glb --prop beam.glb", &["beam.glb", "larger than the control mesh", "scale one"]);
}

#[test]
fn open_and_flat_control_meshes() {
    let desk = Desk::new();
    let mut open = box_json();
    // A box without its lid is filled; two walls of one enclose nothing.
    open["accessors"][1]["count"] = json!(30);
    desk.write("open.glb", glb(&open, &box_data([4.0, 4.0, 4.0])));
    let words = desk.line("check --control open.glb --prop brick.glb").ok();
    assert!(words.contains("1 hole was closed"), "{words}");
    open["accessors"][1]["count"] = json!(12);
    desk.write("open.glb", glb(&open, &box_data([4.0, 4.0, 4.0])));
    refused(&desk, "--control open.glb --prop brick.glb", &["open.glb", "open", "fill its holes"]);
    desk.write("flat.glb", glb(&box_json(), &box_data([4.0, 4.0, 0.0])));
    refused(&desk, "--control flat.glb --prop brick.glb", &["flat.glb"]);
}

#[test]
fn damaged_files() {
    let desk = Desk::new();
    let whole = glb(&box_json(), &box_data([0.3, 0.2, 0.4]));
    desk.write("cut.glb", &whole[..whole.len() - 40]);
    let mut nan = box_data([0.3, 0.2, 0.4]);
    nan[0..4].copy_from_slice(&f32::NAN.to_le_bytes());
    desk.write("nan.glb", glb(&box_json(), &nan));
    let mut huge = box_json();
    huge["accessors"][0]["count"] = json!(1_u64 << 62);
    desk.write("huge.glb", glb(&huge, &box_data([0.3, 0.2, 0.4])));
    let mut cycle = box_json();
    cycle["nodes"] = json!([{ "mesh": 0, "children": [1] }, { "children": [0] }]);
    desk.write("cycle.glb", glb(&cycle, &box_data([0.3, 0.2, 0.4])));
    desk.write("text.glb", "this is no model");
    for name in ["cut.glb", "nan.glb", "huge.glb", "cycle.glb", "text.glb"] {
        refused(&desk, &format!("--control cone.glb --prop {name}"), &[name]);
    }
}

#[test]
fn external_buffers_stay_below_their_folder() {
    let desk = Desk::new();
    for uri in ["../brick.bin", "/etc/hostname", "%2e%2e/brick.bin", "file:///etc/hostname", "gone.bin"] {
        let mut document = box_json();
        document["buffers"][0]["uri"] = json!(uri);
        desk.write("far.gltf", document.to_string());
        refused(&desk, "--control cone.glb --prop far.gltf", &["far.gltf"]);
    }
    let mut document = box_json();
    document["buffers"][0]["uri"] = json!("my%20brick.bin");
    desk.write("near.gltf", document.to_string());
    desk.write("my brick.bin", box_data([0.3, 0.2, 0.4]));
    desk.line("check --control cone.glb --prop near.gltf").ok();
}

#[test]
fn check_tells_the_same_as_json() {
    let desk = Desk::new();
    let done = desk.line("check --json --control cone.glb --prop stik.glb");
    assert_eq!(done.code, 65);
    let words: serde_json::Value = serde_json::from_str(&done.stdout).unwrap();
    assert_eq!(words["ok"], false);
    assert_eq!(words["problems"][0]["place"], "stik.glb");
    assert_eq!(words["problems"][0]["remedy"], "Did you mean stick.glb?");
}

/// Messages show numbers as numbers, and shorten long texts.
#[test]
fn values_out_of_range_are_told_shortly() {
    let desk = Desk::new();
    desk.write("pile.toml", "control_mesh = 'cone.glb'\nprops = ['stick.glb']\nseed = 99999999999999999999\n");
    desk.line("check pile.toml").fails(65, &["`seed` is 1", "a whole number up to 9223372036854775807"]);
    desk.write(
        "pile.toml",
        format!("control_mesh = 'cone.glb'\nprops = ['stick.glb']\nseed = '{}'\n", "x".repeat(5000)),
    );
    let done = desk.line("check pile.toml");
    done.fails(65, &["x...", "a whole number"]);
    assert!(done.stderr.len() < 500, "{}", done.stderr);
}

/// A file of this many instances of four boxes.
fn instances(desk: &Desk, name: &str, count: usize) {
    let mut document = box_json();
    document["nodes"] = (0..count).map(|_| json!({ "mesh": 0 })).collect();
    document["scenes"][0]["nodes"] = (0..count).collect();
    let primitive = document["meshes"][0]["primitives"][0].clone();
    document["meshes"][0]["primitives"] = vec![primitive; 4].into();
    desk.write(name, glb(&document, &box_data([1.0; 3])));
}

/// Instances are counted before any is laid out.
#[test]
fn a_small_file_that_unfolds_to_millions() {
    let desk = Desk::new();
    instances(&desk, "many.glb", 350_000 / 2);
    desk.line("check --control many.glb --prop stick.glb")
        .fails(65, &["triangles are more than the limit of 4,000,000", "raise --max-triangles"]);
}

/// A memory limit: the scene is at fault, and nothing is left behind.
#[test]
#[cfg(target_os = "linux")]
fn more_memory_than_allowed() {
    let desk = Desk::new();
    let scene = "--control cone.glb --prop stick.glb";
    refused(&desk, &format!("{scene} --max-triangles 11"), &["stick.glb", "more than the limit of", "simpler file"]);
    desk.line(&format!("check {scene} --max-memory-mib 511")).fails(2, &["--max-memory-mib", "511"]);
    // Half a gigabyte is much for a small scene, and little for a million instances.
    desk.line(&format!("check {scene} --max-memory-mib 512")).ok();
    instances(&desk, "many.glb", 190_000);
    let before = desk.files();
    let limits = "--max-triangles 20000000 --max-memory-mib 512";
    let done = desk.line(&format!("bake -o pile.glb --control cone.glb --prop many.glb {limits}"));
    assert_eq!((done.code, desk.files()), (65, before), "{}", done.stderr);
    // The standard library's message comes first.
    let words = done.stderr.lines().find(|line| line.starts_with("error: ")).unwrap_or_default();
    for part in ["it needs more memory than the limit of 512 MiB", "simpler meshes", "--max-memory-mib"] {
        assert!(words.contains(part), "`{part}` is missing in:\n{}", done.stderr);
    }
}

/// Names of settings are suggested as those of scene files are.
#[test]
fn a_mistyped_setting_of_the_server() {
    let desk = Desk::new();
    desk.write("server.toml", "worker = 2\n");
    desk.line("serve --config server.toml").fails(78, &["server.toml", "Did you mean `workers`?"]);
}

/// A file of another format is named by what it is.
#[test]
fn files_of_other_formats_are_recognized() {
    let desk = Desk::new();
    let stl = [&[7; 80][..], &1_u32.to_le_bytes(), &[0; 50]].concat();
    for (begin, words) in [
        (&b"\x89PNG\r\n"[..], "it looks like a PNG picture"),
        (b"RIFF1234WEBP", "a RIFF file (WebP, WAV or AVI)"),
        (b"BLENDER-v300", "a Blender file"),
        (b"Kaydara FBX Binary  ", "an FBX file"),
        (b"#usda 1.0\n", "a USD file"),
        (b"MM\x00\x2a", "a 3D Studio or TIFF file"),
        (b"PK\x03\x04....", "a zip archive (perhaps .zip, .usdz or .3mf): unpack it first"),
        (b"\x1f\x8b\x08", "a gzip archive or an old compressed Blender file: unpack it first"),
        (b"\x28\xb5\x2f\xfd", "a Zstandard archive or a compressed Blender file"),
        (b"version https://git-lfs.github.com/spec/v1\n", "a Git LFS pointer: fetch the real file with `git lfs pull`"),
        (b"<!DOCTYPE html>", "a web page: the download gave a page instead of the file"),
        (b"<?xml version=\"1.0\"?>", "an XML file (perhaps COLLADA)"),
        (b"# cube\nv 0 0 0\n", "a Wavefront OBJ file"),
        (&stl[..], "a binary STL file"),
        (&[0; 64], "a file of zeros, as a broken copy leaves it"),
        (b"hello", "some other text"),
        (&[1, 2, 3, 255], "some other binary file"),
        (b"glTF\x02\0\0", "it ends after 7 bytes, within the header"),
        (b"glTF\x02\0\0\0\x10\0\0\0....", "it ends within the header of a chunk, at byte 12"),
    ] {
        desk.write("other.glb", begin);
        desk.line("check --control cone.glb --prop other.glb").fails(65, &["other.glb", words]);
    }
}

/// A URI that leads to no file of its glTF file says why.
#[test]
fn uris_that_lead_nowhere_say_why() {
    let desk = Desk::new();
    for (uri, words) in [
        ("data:;base64", "there is no comma before the data"),
        ("data:,%0g", "a % is not followed by two hexadecimal digits"),
        ("%2e%2e/brick.bin", "it hides a dot, slash, backslash or colon by %-encoding"),
        ("%ff.bin", "its %-encoding is not UTF-8"),
        ("a\u{7}.bin", "it contains control characters"),
        ("~/brick.bin", "it starts in a home folder, and only files beside the glTF are read"),
        ("https://example.org/brick.bin", "it names a scheme or a stream, and only files are read"),
        ("../brick.bin", "it leads out of the glTF's folder"),
    ] {
        let mut document = box_json();
        document["buffers"][0]["uri"] = json!(uri);
        desk.write("brick.gltf", document.to_string());
        desk.line("check --control cone.glb --prop brick.gltf").fails(65, &["brick.gltf", words]);
    }
}
