//! `ARCHITECTURE.md` is true: the files that it names exist, its layers are those of the code, and its invariants hold.

mod layers;
mod modules;
mod world;
mod writers;

use std::fs;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: impl AsRef<Path>) -> String {
    fs::read_to_string(root().join(path)).unwrap()
}

/// All files below a folder whose names end so, relative to the root.
fn files(folder: &str, ending: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![root().join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.to_string_lossy().ends_with(ending) {
                found.push(path.strip_prefix(root()).unwrap().to_owned());
            }
        }
    }
    found.sort();
    found
}

/// The code of a file, without its comments.
fn code(path: &Path) -> String {
    read(path).lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n")
}

/// A crate is used where its name stands as a path's first part.
fn uses(code: &str, name: &str) -> bool {
    code.match_indices(&format!("{name}::"))
        .any(|(at, _)| !code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_'))
}

#[track_caller]
fn only_in(name: &str, folder: &str, allowed: &[&str]) {
    for path in files(folder, ".rs") {
        let is_allowed = allowed.iter().any(|allowed| path.starts_with(allowed));
        assert!(is_allowed || !uses(&code(&path), name), "{} uses {name}", path.display());
    }
}

#[test]
fn every_file_named_exists() {
    let text = read("ARCHITECTURE.md");
    let mut named = 0;
    for name in text.split('`').skip(1).step_by(2) {
        if name.contains('/') && !name.contains([' ', ':', '*']) {
            assert!(root().join(name).exists(), "ARCHITECTURE.md names `{name}`");
            named += 1;
        }
    }
    assert!(named > 20, "the code map names files");
}

#[test]
fn every_module_is_on_the_map() {
    let text = read("ARCHITECTURE.md");
    for folder in ["server/src", "server/core/src", "server/gltf/src", "server/statics/src"] {
        for entry in fs::read_dir(root().join(folder)).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(root()).unwrap().with_extension("");
            let name = name.to_str().unwrap();
            assert!(
                text.contains(&format!("`{name}.rs`")) || text.contains(&format!("`{name}/`")),
                "{name} is not on the map"
            );
        }
    }
}

#[test]
fn the_core_is_pure() {
    for name in ["tokio", "tonic", "prost", "clap", "std::fs", "std::net", "std::time", "std::env", "std::process"] {
        for path in files("server/core/src", ".rs").into_iter().chain(files("server/gltf/src", ".rs")) {
            let is_test = path.to_string_lossy().contains("tests");
            assert!(is_test || !uses(&code(&path), name), "{} uses {name}", path.display());
        }
    }
    let manifest = read("server/core/Cargo.toml") + &read("server/gltf/Cargo.toml");
    for name in ["tokio", "tonic", "prost", "clap"] {
        assert!(!manifest.lines().any(|line| line.starts_with(name)), "the core depends on {name}");
    }
}

/// Statics trusts no engine, and knows nothing of piles, files or the wire.
#[test]
fn statics_stands_alone() {
    let manifest = read("server/statics/Cargo.toml");
    let needed = manifest.split("[dependencies]").nth(1).and_then(|rest| rest.split("\n[").next()).unwrap();
    let names: Vec<&str> = needed.lines().filter_map(|line| line.split_once(" = ").map(|(name, _)| name)).collect();
    assert_eq!(names, ["clarabel", "glam", "libm", "nalgebra", "thiserror"]);
}

#[test]
fn libraries_stay_in_their_place() {
    // The measures recompute contacts by the geometry library alone, without the engine.
    only_in(
        "rapier3d",
        "server",
        &["server/core/src/geometry/hull.rs", "server/core/src/prepare/shape", "server/core/src/world"],
    );
    only_in("clarabel", "server", &["server/statics/src"]);
    only_in("draco_core", "server", &["server/gltf/src/compressed.rs"]);
    only_in("draco_gltf", "server", &["server/gltf/src/compressed.rs"]);
    only_in(
        "gltf",
        "server",
        &["server/gltf/src", "server/core/tests/asset_data.rs", "server/src/model/render/animation.rs"],
    );
    only_in("cairn_core", "server/gltf", &[]);
    // The error module has its way to write counts.
    only_in("cairn_gltf", "server/core/src", &["server/core/src/asset.rs", "server/core/src/error.rs"]);
    only_in("sysinfo", "server/src", &["server/src/job/machine.rs"]);
    only_in("prost_reflect", "server/src", &["server/src/scene_file", "server/src/service/codec.rs"]);
    only_in("clap", "server/src", &["server/src/cli"]);
    // What bakes does not know who asks.
    let service = [
        "client.rs",
        "cli",
        "service/access.rs",
        "service/audit.rs",
        "service/codec.rs",
        "service/calls",
        "service/deadline.rs",
        "service/in_process.rs",
        "service/jobs",
        "service/serve.rs",
        "service/status.rs",
        "service/unix.rs",
    ];
    only_in("tonic", "server/src", &service.map(|name| format!("server/src/{name}")).each_ref().map(String::as_str));
    only_in("figment", "server/src", &["server/src/cli/serve.rs"]);
    only_in("indicatif", "server/src", &["server/src/cli/progress.rs", "server/src/cli/batch/overview.rs"]);
}

/// Lines; above it, a file wants to be two.
const MOST_LINES: usize = 400;

/// A file that is long for a reason says so in its first line, with this word.
const REASON: &str = "Long:";

fn is_too_long(text: &str) -> bool {
    text.lines().count() > MOST_LINES && !text.lines().next().is_some_and(|first| first.contains(REASON))
}

#[test]
fn files_stay_readable() {
    let all = ["server", "tests", "examples"].map(|folder| files(folder, ".rs")).concat();
    let long: Vec<_> = all.iter().filter(|path| is_too_long(&read(path))).collect();
    assert!(long.is_empty(), "more than {MOST_LINES} lines, and no \"{REASON}\" in the first one: {long:?}");
}

#[test]
fn a_long_file_needs_a_reason() {
    let lines = |first: &str, count: usize| format!("{first}\n{}", "\n".repeat(count - 1));
    assert!(!is_too_long(&lines("//! Short.", MOST_LINES)) && is_too_long(&lines("//! Long.", MOST_LINES + 1)));
    assert!(!is_too_long(&lines("//! Long: one table.", MOST_LINES + 1)));
    assert!(is_too_long(&format!("//! A table.\n//! Long: one table.\n{}", "\n".repeat(MOST_LINES))));
}

/// Characters of a line.
const WIDEST: usize = 120;

#[test]
fn lines_stay_readable() {
    let all = ["server", "tests", "examples"].map(|folder| files(folder, ".rs")).concat();
    let wide = |path: &PathBuf| {
        let text = read(path);
        let wide: Vec<_> = text.lines().zip(1..).filter(|(line, _)| line.chars().count() > WIDEST).collect();
        wide.into_iter().map(|(_, number)| format!("{}:{number}", path.display())).collect::<Vec<_>>()
    };
    let wide: Vec<String> = all.iter().flat_map(wide).collect();
    assert!(wide.is_empty(), "more than {WIDEST} characters: {wide:?}");
}

/// The targets of a page's links that are files: `[text](target)` and `src="target"`.
fn targets(page: &str) -> Vec<&str> {
    let all = [("](", ')'), ("src=\"", '"')]
        .into_iter()
        .flat_map(|(begin, end)| page.split(begin).skip(1).filter_map(move |rest| rest.split(end).next()));
    let files = all.map(|target| target.split('#').next().unwrap_or_default());
    files.filter(|target| !target.is_empty() && !target.contains([':', ' ', '\n'])).collect()
}

#[test]
fn links_of_pages_lead_somewhere() {
    let pages = ["server", "tests", "examples", "proto", "addon", "python"].map(|folder| files(folder, ".md")).concat();
    let own = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md"].map(PathBuf::from);
    let mut checked = 0;
    for page in pages.iter().chain(&own) {
        for target in targets(&read(page)) {
            let path = root().join(page).parent().unwrap().join(target);
            assert!(path.exists(), "{}: {target} leads nowhere", page.display());
            checked += 1;
        }
    }
    assert!(checked > 100, "the links are read: {checked}");
}
