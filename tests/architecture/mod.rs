//! `ARCHITECTURE.md` is true: the files that it names exist, its layers are those of the code, and its invariants hold.

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

#[test]
fn every_file_named_exists() {
    let text = read("ARCHITECTURE.md");
    let mut named = 0;
    for name in text.split('`').skip(1).step_by(2) {
        if name.starts_with(|c: char| c.is_lowercase()) && name.contains('/') && !name.contains([' ', ':', '*']) {
            let places = ["", "server/engine/src/world/", "server/export/src/", "server/src/", "server/service/src/"];
            let exists = places.iter().any(|place| root().join(place).join(name).exists());
            assert!(exists, "ARCHITECTURE.md names `{name}`");
            named += 1;
        }
    }
    assert!(named > 20, "the code map names files");
}

/// The rooms: packages below `server/`, in the order of the map, lowest first; the program is the last.
fn rooms() -> Vec<String> {
    let text = read("ARCHITECTURE.md");
    let map = text.split("### Rooms").nth(1).and_then(|rest| rest.split("\n###").next()).expect("a map of rooms");
    let row = |line: &str| Some(line.strip_prefix("| `server/")?.split('/').next()?.to_owned());
    map.lines().filter_map(row).collect()
}

/// What a manifest's section names.
fn named(manifest: &str, section: &str) -> Vec<String> {
    let toml: toml::Table = read(manifest).parse().expect("TOML");
    toml.get(section).and_then(|found| found.as_table()).into_iter().flat_map(|table| table.keys().cloned()).collect()
}

fn manifest(room: &str) -> String {
    if room == "src" { "Cargo.toml".into() } else { format!("server/{room}/Cargo.toml") }
}

/// Each point of `SECURITY.md` names its tests, which exist.
#[test]
fn every_promise_of_security_names_its_tests() {
    let page = read("SECURITY.md");
    let page = page.split("## What is trusted").nth(1).expect("the page says what is trusted");
    let sources: String = ["server", "tests"].iter().flat_map(|folder| files(folder, ".rs")).map(read).collect();
    let mut points: Vec<String> = Vec::new();
    for line in page.split("## Supply chain").next().unwrap_or_default().lines() {
        match (line.strip_prefix("- "), points.last_mut()) {
            (Some(first), _) => points.push(first.to_owned()),
            (None, Some(point)) if line.starts_with("  ") => *point += line,
            _ => {}
        }
    }
    assert!(points.len() > 10, "{points:?}");
    for point in points {
        let tests = point.split("Tests: ").nth(1).unwrap_or_default();
        let names: Vec<&str> = tests.split('`').skip(1).step_by(2).collect();
        assert!(!names.is_empty(), "no test is named: {point}");
        for name in names {
            assert!(sources.contains(&format!("fn {name}(")), "there is no test {name}: {point}");
        }
    }
}

#[test]
fn a_room_uses_only_rooms_above_it_in_the_map() {
    let rooms = rooms();
    let packages = fs::read_dir(root().join("server")).unwrap().map(|entry| entry.unwrap());
    for package in packages.filter(|entry| entry.path().join("src/lib.rs").exists()) {
        let name = package.file_name().into_string().unwrap();
        assert!(rooms.contains(&name) || name == "codegen", "server/{name} is not on the map");
    }
    for (place, room) in rooms.iter().enumerate() {
        for used in named(&manifest(room), "dependencies") {
            if let Some(used) = used.strip_prefix("cairn-") {
                assert!(
                    rooms[..place].iter().any(|above| above == used),
                    "{room} uses {used}: the map has no such order"
                );
            }
        }
    }
}

/// The first page of a room says what it is, what it must never know, and what always holds.
#[test]
fn a_room_has_a_first_page() {
    for room in rooms().iter().filter(|room| !["src", "gltf", "statics"].contains(&room.as_str())) {
        let text = read(format!("server/{room}/src/lib.rs"));
        let page: String = text.lines().take_while(|line| line.starts_with("//!")).collect::<Vec<_>>().join(" ");
        assert!(page.contains("must never"), "server/{room}/src/lib.rs does not say what the room must never know");
    }
}

/// Libraries that one room alone names, by the map.
#[test]
fn libraries_stay_in_their_room() {
    let only = [
        ("rapier3d", &["engine"][..]),
        ("parry3d", &["geometry"]),
        ("clarabel", &["statics"]),
        ("draco-core", &["gltf"]),
        ("openusd", &["export"]),
        ("sysinfo", &["job"]),
        ("axum", &["service"]),
        ("prometheus", &["service"]),
        ("rmcp", &["src"]),
        ("clap", &["src"]),
        ("indicatif", &["src"]),
        // What bakes does not know who asks.
        ("tonic", &["service", "src"]),
        ("tokio", &["service", "src"]),
        ("prost-reflect", &["wire", "service"]),
    ];
    for (library, homes) in only {
        for room in rooms() {
            let names = named(&manifest(&room), "dependencies").iter().any(|name| name == library);
            assert_eq!(names, homes.contains(&room.as_str()), "{room} and {library}");
        }
    }
}

/// The rooms below the program, up to the core.
const PURE: [&str; 10] =
    ["geometry", "statics", "gltf", "input", "engine", "prepare", "analysis", "motion", "show", "core"];

#[test]
fn the_core_is_pure() {
    for room in PURE {
        for path in files(&format!("server/{room}/src"), ".rs") {
            for name in ["std::fs", "std::net", "std::time", "std::env", "std::process"] {
                let is_test = path.to_string_lossy().contains("tests");
                assert!(is_test || !code(&path).contains(name), "{} uses {name}", path.display());
            }
        }
    }
}

/// Statics trusts no engine, and knows nothing of piles, files or the wire. glTF depends on no room.
#[test]
fn what_may_be_published_stands_alone() {
    assert_eq!(
        named("server/statics/Cargo.toml", "dependencies"),
        ["clarabel", "glam", "libm", "nalgebra", "thiserror"]
    );
    assert!(!named("server/gltf/Cargo.toml", "dependencies").iter().any(|name| name.starts_with("cairn")));
}

/// How a body is treated has one writer: a stage with a reason calls the policy.
#[test]
fn role_resistance_and_friction_have_one_writer() {
    const WRITER: &str = "server/motion/src/policy.rs";
    let treatment = [".set_role(", ".set_resistance(", ".set_slippery(", ".keep_awake("];
    let calls = |path: &Path| treatment.iter().any(|call| code(path).contains(call));
    assert!(calls(Path::new(WRITER)), "{WRITER} writes");
    for room in ["prepare", "analysis", "motion", "show", "core"] {
        for path in files(&format!("server/{room}/src"), ".rs") {
            assert!(path == Path::new(WRITER) || !calls(&path), "{} treats a body: call {WRITER}", path.display());
        }
    }
}

/// One place names the hull of the geometry library.
#[test]
fn the_hull_has_one_place() {
    for path in files("server/geometry/src", ".rs") {
        let names = code(&path).contains("parry3d::");
        assert!(!names || path == Path::new("server/geometry/src/hull.rs"), "{} names the library", path.display());
    }
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
