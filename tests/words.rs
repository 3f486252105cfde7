//! Plain words: everything that a reader sees, code and comments included, says one thing by one word, the field's own.
//!
//! A word that is out stands in [`OUT`] with what to write in its place. An identifier is one word (`told_of` is not
//! "told"), and so is a file's name.

use std::fs;
use std::path::{Path, PathBuf};

/// Words that are out, and what says it plainly.
const OUT: &[(&str, &str)] = &[
    ("tell", "report, print, state, say"),
    ("tells", "reports, prints, states, says"),
    ("told", "reported, printed, stated"),
    ("telling", "reporting"),
    ("mend", "fix"),
    ("mends", "fixes"),
    ("mended", "fixed"),
    ("anew", "again"),
    ("for ever", "forever, without end"),
    ("rising", "ascending, of an order; increasing, of a value"),
    ("lies along", "is aligned with"),
    ("lie along", "are aligned with"),
    ("let go", "released, release"),
    ("lets go", "releases"),
    ("stir", "move"),
    ("stirs", "moves"),
    ("stirred", "moved"),
    ("dearer", "more expensive; raise the price"),
    ("dearest", "most expensive"),
    ("fasten", "weld"),
    ("fastened", "welded"),
    ("fastening", "weld"),
    ("distrust", "discount the friction of"),
    ("wean", "release gently"),
    ("weaned", "released gently"),
    ("natural time", "characteristic time"),
    ("natural times", "characteristic times"),
    ("candidates bodies", "candidate bodies"),
    ("shall", "must, or the plain present"),
];

/// What is read: folders and files, and the endings that count in them.
const READ: &[&str] = &["server", "proto", "addon", "python", "tests", "examples", ".ci", ".github", "."];
const ENDINGS: &[&str] = &["rs", "py", "proto", "md", "toml", "sh", "yml"];

/// Files with words of others, or made by a command from data.
const LEFT_OUT: &[&str] = &["tests/words.rs", "Cargo.lock", "target", "tests/fuzz/found"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every file that is read, relative to the root.
fn files() -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders: Vec<PathBuf> = READ.iter().map(|folder| root().join(folder)).collect();
    while let Some(folder) = folders.pop() {
        let is_root = folder == root().join(".");
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(root()).unwrap().to_owned();
            let name = name.strip_prefix(".").unwrap_or(&name).to_owned();
            if LEFT_OUT.iter().any(|out| name.starts_with(out)) {
                continue;
            }
            if path.is_dir() {
                if !is_root {
                    folders.push(path);
                }
            } else if name.extension().is_some_and(|e| ENDINGS.iter().any(|ending| e == *ending)) {
                found.push(name);
            }
        }
    }
    found.sort();
    found
}

fn is_of_a_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Where a phrase stands by itself in a lower-case text; white space between its words may be a line's end with a
/// comment's mark.
fn places(text: &str, phrase: &str) -> Vec<usize> {
    let starts = text.match_indices(phrase).map(|(at, _)| at);
    let alone =
        |&at: &usize| !text[..at].ends_with(is_of_a_word) && !text[at + phrase.len()..].starts_with(is_of_a_word);
    starts.filter(alone).collect()
}

/// The words that are out in a text: line, word, what to write.
fn out(text: &str) -> Vec<(usize, &'static str, &'static str)> {
    let lower = text.to_ascii_lowercase();
    let line = |at: usize| lower[..at].matches('\n').count() + 1;
    let found = OUT.iter().flat_map(|&(word, better)| {
        places(&lower, word).into_iter().map(move |at| (at, word, better)).collect::<Vec<_>>()
    });
    let mut found: Vec<_> = found.map(|(at, word, better)| (line(at), word, better)).collect();
    found.sort();
    found
}

#[test]
fn the_words_are_plain() {
    let files = files();
    assert!(files.len() > 300, "the files are read: {}", files.len());
    let mut found = Vec::new();
    for file in &files {
        let text = fs::read_to_string(root().join(file)).unwrap();
        for (line, word, better) in out(&text) {
            found.push(format!("{}:{line}: \"{word}\": write {better}", file.display()));
        }
    }
    assert!(found.is_empty(), "{} words that are out:\n{}", found.len(), found.join("\n"));
}

#[test]
fn a_word_is_found_where_it_stands_alone() {
    assert_eq!(out("It tells.\nHe Told"), [(1, "tells", OUT[1].1), (2, "told", OUT[2].1)]);
    assert_eq!(out("fn told_of() { retell(); let s = \"mend it\"; }"), [(1, "mend", OUT[4].1)]);
    assert_eq!(out("untold, amendment, natural timer"), []);
}
