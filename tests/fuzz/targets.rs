//! What is fuzzed: functions of any bytes, which panic where a promise is broken. `main.rs` calls them in the tests,
//! `guided.rs` by libFuzzer.

mod equilibrium;
mod models;
mod uploads;

use cairn_wire::from_proto;
use cairn_wire::scene_file::SceneTree;
use prost::Message;
use std::path::{Path, PathBuf};

/// A target.
pub struct Target {
    pub name: &'static str,
    pub run: fn(&[u8]),
    /// Inputs to begin with.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Inputs that the tests make of them.
    #[allow(dead_code, reason = "only the tests count")]
    pub short: usize,
}

pub const TARGETS: [Target; 5] = [
    Target { name: "reading", run: models::reading, seeds: models::seeds, short: 50_000 },
    Target { name: "scene", run: scene, seeds: scenes, short: 20_000 },
    Target { name: "uploads", run: uploads::run, seeds: uploads::seeds, short: 20_000 },
    Target { name: "equilibrium", run: equilibrium::run, seeds: equilibrium::seeds, short: 100_000 },
    Target { name: "shape", run: models::shape, seeds: models::shape_seeds, short: 60 },
];

/// The repository.
pub fn root() -> PathBuf {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    if own.ends_with("tests/fuzz") { own.join("../..") } else { own.to_owned() }
}

/// The content of all files below a folder whose names end so, the smaller ones.
pub fn contents(folder: &Path, endings: &[&str]) -> Vec<Vec<u8>> {
    /// Bytes: mutations of more reach little.
    const LARGEST: u64 = 64 << 10;
    let mut entries: Vec<PathBuf> =
        folder.read_dir().into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    entries.sort();
    let mut found = Vec::new();
    for path in entries {
        let name = path.to_string_lossy().into_owned();
        if path.is_dir() {
            found.extend(contents(&path, endings));
        } else if endings.iter().any(|ending| name.ends_with(ending))
            && path.metadata().is_ok_and(|file| file.len() <= LARGEST)
        {
            found.push(std::fs::read(&path).unwrap());
        }
    }
    found
}

/// The first byte says in which form: a scene file becomes a message, parameters and, written again, the same scene.
fn scene(bytes: &[u8]) {
    let Some((form, text)) = bytes.split_first() else { return };
    let name = Path::new(if form % 2 == 0 { "scene.toml" } else { "scene.json" });
    let tree = match SceneTree::read(name, text) {
        Ok(tree) => tree,
        Err(problems) => {
            assert!(!problems.is_empty(), "it is refused, and nothing is reported");
            problems.iter().for_each(|problem| assert!(!problem.to_string().is_empty()));
            return;
        }
    };
    let message = tree.to_message();
    let (params, problems) = from_proto::params_and_problems(&message);
    let mut texts = params.problems().into_iter().map(|problem| problem.to_string()).collect::<Vec<_>>();
    texts.extend(problems.iter().map(ToString::to_string));
    assert!(texts.iter().all(|text| !text.is_empty()));
    let again = SceneTree::from_message(&message);
    assert!(again.problems().is_empty(), "a message of a scene file has no unknown names");
    assert_eq!(again.to_message().encode_to_vec(), message.encode_to_vec(), "message, tree, message");
    for (name, text) in [("scene.toml", again.to_toml()), ("scene.json", again.to_json())] {
        let read = SceneTree::read(Path::new(name), text.as_bytes());
        let read = read.unwrap_or_else(|problems| panic!("{name}, as it was written: {problems:?}\n{text}"));
        assert_eq!(read.to_message().encode_to_vec(), message.encode_to_vec(), "{name}, written and read:\n{text}");
    }
}

fn scenes() -> Vec<Vec<u8>> {
    let mut seeds = Vec::new();
    for (form, ending) in [(0, ".toml"), (1, ".json")] {
        for folder in ["examples", "tests"] {
            let found = contents(&root().join(folder), &[ending]);
            seeds.extend(found.into_iter().map(|text| [&[form], &text[..]].concat()));
        }
    }
    let plain = [
        "seed = 1\ngravity = 9.81\ncontrol_mesh = \"a.glb\"\nprops = [\"b.glb\", { path = \"c.glb\", weight = 0.5 }]\n",
        "control = \"off\"\nglue = \"natural\"\naccuracy = \"draft\"\n[fill]\nmethod = \"pour\"\ncount = 12\n",
        "[[bodies]]\nprop = 0\nposition = [0, 1, 0]\nrotation = [0, 0, 0, 1]\n[effects]\nrolling = \"on\"\n",
    ];
    seeds.extend(plain.iter().map(|text| [&[0], text.as_bytes()].concat()));
    let tree = SceneTree::read(Path::new("a.toml"), plain[0].as_bytes());
    seeds.extend(tree.map(|tree| [&[1], tree.to_json().as_bytes()].concat()));
    seeds
}
