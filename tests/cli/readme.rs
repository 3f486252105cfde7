//! What the README and the examples show works.

use crate::desk::Desk;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A folder with the files that the README speaks of.
fn desk() -> Desk {
    let desk = Desk::new();
    for name in ["dome.glb", "book.glb"] {
        std::fs::copy(root().join("examples/assets").join(name), desk.path(name)).unwrap();
    }
    desk
}

/// The indented blocks of the README.
fn blocks() -> Vec<String> {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    let mut blocks = vec![String::new()];
    for line in readme.lines() {
        match line.strip_prefix("    ") {
            Some(code) => *blocks.last_mut().unwrap() += &format!("{code}\n"),
            None if line.is_empty() => blocks.last_mut().unwrap().push('\n'),
            None => blocks.push(String::new()),
        }
    }
    blocks.into_iter().filter(|block| !block.trim().is_empty()).collect()
}

#[test]
fn commands() {
    let desk = desk();
    let mut tried = 0;
    for line in blocks().iter().flat_map(|block| block.lines()).filter(|line| line.starts_with("cairn ")) {
        let mut words: Vec<&str> = line.split_whitespace().skip(1).take_while(|word| *word != ">").collect();
        match words[0] {
            // The scene must be right; the bake itself takes too long here.
            "bake" => {
                words[0] = "check";
                let output = words.iter().position(|word| *word == "-o").expect("a bake names its output");
                words.drain(output..output + 2);
                // The tests of the service bake on servers.
                if let Some(server) = words.iter().position(|word| *word == "--server") {
                    words.drain(server..server + 2);
                }
            }
            // Its flags must be right; it would not end.
            "serve" => words.push("--help"),
            "render" => continue,
            _ => {}
        }
        desk.run(&words).ok();
        tried += 1;
    }
    assert!(tried >= 3);
}

#[test]
fn scene_file() {
    let desk = desk();
    let scene = blocks().into_iter().find(|block| block.contains("[[props]]")).unwrap();
    desk.write("pile.toml", scene);
    desk.line("check pile.toml").ok();
}

#[test]
fn examples() {
    let desk = desk();
    let entries = std::fs::read_dir(root().join("examples")).unwrap().map(|entry| entry.unwrap().path());
    let scenes: Vec<PathBuf> = entries.filter(|path| path.extension().is_some_and(|ending| ending == "toml")).collect();
    assert!(!scenes.is_empty());
    for scene in scenes {
        desk.run(&["check", scene.to_str().unwrap()]).ok();
    }
}
