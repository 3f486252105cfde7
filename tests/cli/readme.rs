//! The commands in the README, the guide and the examples work.

use crate::cli::desk::Desk;
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};

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

/// A server on a free port, and its address.
fn serve(desk: &Desk) -> (Child, String) {
    let mut server = desk.command(&["serve", "--listen", "127.0.0.1:0"]).stdout(Stdio::piped()).spawn().unwrap();
    let mut address = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut address).unwrap();
    (server, address.trim().to_owned())
}

/// The commands of the README as they are written, in its order; but piles are small and pictures tiny, of many bakes
/// the first are made, and a server is one on a free port.
#[test]
fn commands() {
    let desk = desk();
    let (mut server, address) = serve(&desk);
    let mut tried = Vec::new();
    for line in blocks().iter().flat_map(|block| block.lines()).filter(|line| line.starts_with("cairn ")) {
        let (line, file) = line.split_once(" > ").map_or((line, None), |(line, file)| (line, Some(file)));
        let line = line.replace("127.0.0.1:50151", &address);
        let few = "--accuracy draft --set fill.count=8 --set output.frames=4";
        let smaller = match line.split_whitespace().nth(1).unwrap() {
            // A result is its own scene.
            "bake" if line.contains("bake pile.glb") => "--quiet".into(),
            "bake" => format!("--quiet {few}"),
            "batch" if line.contains("--range") => format!("--jobs 2 {few}"),
            // The accuracy varies.
            "batch" => "--range 0-1 --set fill.count=8 --set output.frames=4".into(),
            "cost" => format!("--presets-only --seeds 1 {few}").replace("--accuracy draft ", ""),
            "render" => "--size 48x36 --samples 1".into(),
            // It would go on; its flags must be right. One runs already.
            "serve" => "--help".into(),
            _ => String::new(),
        };
        let printed = desk.line(&format!("{} {smaller}", line.strip_prefix("cairn ").unwrap())).ok();
        if let Some(file) = file {
            desk.write(file, printed);
        }
        tried.push(line);
    }
    server.kill().unwrap();
    server.wait().unwrap();
    let commands: BTreeSet<&str> = tried.iter().map(|line| line.split_whitespace().nth(1).unwrap()).collect();
    for command in ["bake", "check", "scene", "render", "cost", "batch", "rank", "serve"] {
        assert!(commands.contains(command), "{command} is not in the README: {tried:?}");
    }
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
    for folder in ["examples", "examples/assets", "examples/assets/stacks", "examples/clutter", "examples/guide"] {
        std::fs::create_dir(desk.path(folder)).unwrap();
        for entry in std::fs::read_dir(root().join(folder)).unwrap().map(|entry| entry.unwrap()) {
            if entry.path().extension().is_some_and(|ending| ["glb", "toml", "usda"].iter().any(|one| ending == *one)) {
                std::fs::copy(entry.path(), desk.path(folder).join(entry.file_name())).unwrap();
            }
        }
    }
    desk
}

/// The pages of the guide, its index first.
fn pages() -> Vec<String> {
    let entries = std::fs::read_dir(root().join("examples/guide")).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut pages: Vec<String> = names.filter(|name| name.ends_with(".md")).collect();
    pages.sort_by_key(|page| (page != "README.md", page.clone()));
    pages
}

/// Every command of the guide, in the guide's order; but piles are small and pictures tiny.
#[test]
fn guide() {
    let desk = desk_with_examples();
    let (mut server, address) = serve(&desk);
    let mut tried = 0;
    for page in pages() {
        let blocks = blocks_of(&root().join("examples/guide").join(&page));
        let lines = blocks.iter().flat_map(|block| block.lines());
        for line in lines.filter(|line| line.starts_with("cairn ") && !line.starts_with("cairn serve")) {
            // As a shell reads it.
            let line = line.split(" #").next().unwrap().trim_end().replace("127.0.0.1:50151", &address);
            let (command, file) =
                line.split_once(" > ").map_or((&*line, None), |(command, file)| (command, Some(file)));
            let smaller = match command.split_whitespace().nth(1) {
                Some("bake") => " --quiet --accuracy draft --set fill.count=8",
                Some("render") => " --size 48x36 --samples 1",
                Some("doctor") => " --skip-bake",
                Some("cost") => " --seeds 1 --budget 1s",
                // Each process reads the catalogue.
                Some("clutter") => " --sheet 1 --jobs 1 --progress none",
                _ => "",
            };
            // Only `render` makes tiny pictures: of the others, one of few bodies is enough.
            let picture = command.split_whitespace().skip_while(|word| *word != "--picture").nth(1);
            let few = |command: &str| command.replace(" -n 1000 ", " -n 2 ");
            let command = match picture {
                _ if command.starts_with("cairn clutter") => few(command),
                Some(picture) if picture != "arch.png" => command.replace(&format!(" --picture {picture}"), ""),
                _ => command.to_owned(),
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
    server.kill().unwrap();
    server.wait().unwrap();
    assert!(tried >= 15, "{tried}");
}

/// The links in the guide lead to existing files.
#[test]
fn links_of_the_guide() {
    let folder = root().join("examples/guide");
    let mut found = 0;
    let index = std::fs::read_to_string(folder.join("README.md")).unwrap();
    for page in pages() {
        assert!(page == "README.md" || index.contains(&format!("({page})")), "the index has no {page}");
        let text = std::fs::read_to_string(folder.join(&page)).unwrap();
        let links = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
        for link in links.filter(|link| !link.starts_with("http") && !link.starts_with('#')) {
            let file = link.split('#').next().unwrap();
            assert!(folder.join(file).exists(), "{page} leads to {link}");
            found += 1;
        }
    }
    assert!(found >= 9);
}
