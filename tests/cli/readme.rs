//! The commands in the README, the guide and the examples work.

use crate::desk::Desk;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A folder with the files of the README's commands.
fn desk() -> Desk {
    let desk = Desk::new();
    for name in ["dome.glb", "book.glb"] {
        std::fs::copy(root().join("examples/assets").join(name), desk.path(name)).unwrap();
    }
    desk
}

/// The indented blocks of the README.
fn blocks() -> Vec<String> {
    blocks_of(&root().join("README.md"))
}

fn blocks_of(page: &Path) -> Vec<String> {
    let readme = std::fs::read_to_string(page).unwrap();
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
            // The tests of batches bake results again.
            "bake" if words[1] == "pile.glb" => continue,
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
            // Its flags must be right; it would not end, or not soon.
            "serve" | "cost" | "batch" | "rank" => words.push("--help"),
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
    let guide = std::fs::read_dir(root().join("examples/guide")).unwrap().map(|entry| entry.unwrap().path());
    let scenes = entries.chain(guide).filter(|path| path.extension().is_some_and(|ending| ending == "toml"));
    let scenes: Vec<PathBuf> = scenes.collect();
    assert!(!scenes.is_empty());
    for scene in scenes {
        desk.run(&["check", scene.to_str().unwrap()]).ok();
    }
}

/// A folder with the examples, as in the repository.
fn desk_with_examples() -> Desk {
    let desk = Desk::new();
    for folder in ["examples", "examples/assets", "examples/guide"] {
        std::fs::create_dir(desk.path(folder)).unwrap();
        for entry in std::fs::read_dir(root().join(folder)).unwrap().map(|entry| entry.unwrap()) {
            if entry.path().extension().is_some_and(|ending| ["glb", "toml"].iter().any(|one| ending == *one)) {
                std::fs::copy(entry.path(), desk.path(folder).join(entry.file_name())).unwrap();
            }
        }
    }
    desk
}

/// Every command of the guide, in the guide's order; but piles are small and pictures tiny.
#[test]
fn guide() {
    let desk = desk_with_examples();
    let mut tried = 0;
    for page in ["README.md", "glue.md", "how-props-lie.md", "recipes.md", "troubleshooting.md"] {
        let blocks = blocks_of(&root().join("examples/guide").join(page));
        for line in blocks.iter().flat_map(|block| block.lines()).filter(|line| !line.is_empty()) {
            let (command, file) = line.split_once(" > ").map_or((line, None), |(command, file)| (command, Some(file)));
            let smaller = match command.split_whitespace().nth(1) {
                Some("bake") => " --quiet --accuracy draft --set fill.count=8",
                Some("render") => " --size 48x36 --samples 1",
                Some("doctor") => " --skip-bake",
                _ => "",
            };
            let words = format!("{command}{smaller}");
            let words = words.strip_prefix("cairn ").unwrap_or_else(|| panic!("{line} is no command of cairn"));
            let printed = desk.line(words).ok();
            if let Some(file) = file {
                desk.write(file, printed);
            }
            tried += 1;
        }
    }
    assert!(tried >= 15, "{tried}");
}

/// The links in the guide lead to existing files.
#[test]
fn links_of_the_guide() {
    let folder = root().join("examples/guide");
    let mut found = 0;
    for page in ["README.md", "glue.md", "how-props-lie.md", "recipes.md", "troubleshooting.md"] {
        let text = std::fs::read_to_string(folder.join(page)).unwrap();
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            assert!(folder.join(link).is_file(), "{page} leads to {link}");
            found += 1;
        }
    }
    assert!(found >= 9);
}
