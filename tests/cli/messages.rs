//! Every message about files, scenes and piles, provoked on its cause.
//!
//! None is printed for two others that look alike. The table is `messages.toml`; the guide's page on troubleshooting
//! has it. `exceptions.toml` says which sentences of the program are held against it.

use crate::cli::shop::shop;
use rayon::prelude::*;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use syn::buffer::{Cursor, TokenBuffer};

#[derive(Deserialize)]
struct Table {
    message: Vec<Row>,
}

#[derive(Deserialize)]
struct Row {
    part: String,
    /// `error`: the scene is refused. `warning`: the bake goes on.
    kind: String,
    says: String,
    cause: String,
    remedy: String,
    /// A command line in the folder of [`shop`] that prints it, and two that do not; with `test`, the names of that
    /// test's cases.
    provoked: String,
    alike: [String; 2],
    /// `FILE::FUNCTION`: what no command reaches is provoked there, as a state of the code that says it.
    test: Option<String>,
}

/// See the comments there.
#[derive(Deserialize)]
struct Exceptions {
    writers: Vec<String>,
    variants: Vec<String>,
    program: Vec<String>,
    exempt: Vec<[String; 3]>,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A table beside this file.
fn read<T: DeserializeOwned>(name: &str) -> T {
    toml::from_str(&std::fs::read_to_string(root().join("tests/cli").join(name)).unwrap()).unwrap()
}

fn table() -> Vec<Row> {
    read::<Table>("messages.toml").message
}

/// The fixed texts of a message.
fn fixed(says: &str) -> Vec<&str> {
    says.split('…').map(str::trim).filter(|part| !part.is_empty()).collect()
}

/// Whether a text has all fixed parts of a message in their order, in one line. Counts are written in the singular or
/// the plural.
fn says(text: &str, message: &str) -> bool {
    text.lines().any(|line| {
        let mut rest = line;
        fixed(message).iter().all(|part| match rest.find(part) {
            Some(at) => {
                rest = &rest[at + part.len()..];
                true
            }
            None => false,
        })
    })
}

#[test]
fn each_message_has_the_cause_that_it_names() {
    let desk = shop();
    let rows = table();
    let of_commands = || rows.iter().filter(|row| row.test.is_none());
    let commands: BTreeSet<&String> =
        of_commands().flat_map(|row| [&row.provoked].into_iter().chain(&row.alike)).collect();
    let number: BTreeMap<&String, usize> = commands.iter().enumerate().map(|(at, command)| (*command, at)).collect();
    let printed: BTreeMap<&String, String> = commands
        .par_iter()
        .map(|command| {
            // Outputs of one folder must not meet.
            let line = command.replace("-o pile", &format!("-o pile{}", number[command]));
            let done = desk.line(&line);
            (*command, format!("{}\n{}", done.stdout, done.stderr))
        })
        .collect();
    let mut wrong = Vec::new();
    for row in of_commands() {
        let command = &row.provoked;
        if !says(&printed[command], &row.says) {
            wrong.push(format!("`{command}` does not print \"{}\":\n{}", row.says, printed[command]));
        }
        for alike in row.alike.iter().filter(|alike| says(&printed[alike], &row.says)) {
            wrong.push(format!("`{alike}` prints \"{}\":\n{}", row.says, printed[alike]));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// What no command reaches is a case of a test, whose words are the message's; two other cases have other words, or
/// none. Those tests compare all that is said in a case.
#[test]
fn the_cases_of_other_tests_are_there() {
    let mut wrong = Vec::new();
    for row in table() {
        let Some(test) = &row.test else { continue };
        let (file, name) = test.split_once("::").expect("FILE::FUNCTION");
        let text = std::fs::read_to_string(root().join(file)).unwrap_or_default();
        let cases = cases(&text, name);
        let said = |case: &String| cases.get(case).map(|words| words.iter().any(|words| has_words(words, &row.says)));
        if said(&row.provoked) != Some(true) || row.alike.iter().any(|case| said(case) != Some(false)) {
            wrong.push(format!("{test}: {:?}, {:?}: \"{}\"", row.provoked, row.alike, row.says));
        }
    }
    assert!(wrong.is_empty(), "no such case, or other words:\n{}", wrong.join("\n"));
}

/// The cases of a test: texts that begin with "when", and the texts up to the next.
fn cases(file: &str, test: &str) -> BTreeMap<String, Vec<String>> {
    let mut cases = BTreeMap::<String, Vec<String>>::new();
    let mut case = None;
    for text in texts(file, Wanted::Test(test)) {
        if text.starts_with("when ") {
            case = Some(text.clone());
            cases.insert(text, Vec::new());
        } else if let Some(case) = &case {
            cases.get_mut(case).expect("a case").push(text);
        }
    }
    cases
}

/// Whether the words of a case are those of a message: they have one of its longer parts, or are a piece of one.
fn has_words(words: &str, message: &str) -> bool {
    let parts = fixed(message);
    let longest = parts.iter().map(|part| part.len()).max().unwrap_or(0);
    let long = parts.iter().filter(|part| part.len() >= SENTENCE.min(longest));
    let mut known = long.map(|part| words.contains(part) || words.len() >= SENTENCE && part.contains(words));
    known.any(|is_known| is_known)
}

/// Characters of a text that is a sentence, not a word within one.
const SENTENCE: usize = 24;
/// Characters of a part of a message that belongs to no other.
const WORDS: usize = 12;

/// The fixed parts of a text of the program that are long enough to know it by.
fn sentences(literal: &str) -> Vec<&str> {
    let parts = literal.split(['{', '}']).step_by(2).map(|part| part.trim_matches([' ', ':', ';', '.', ',']));
    parts.filter(|part| part.len() >= SENTENCE).collect()
}

/// Whether a text is known by some words.
fn is_known(parts: &[&str], words: &[&str]) -> bool {
    let has = |part: &&str| words.iter().any(|word| word.contains(part) || word.len() >= WORDS && part.contains(word));
    parts.iter().any(has)
}

/// A new message needs a row.
#[test]
fn no_message_is_missing_in_the_table() {
    let (rows, exceptions) = (table(), read::<Exceptions>("exceptions.toml"));
    let known: Vec<&str> = rows.iter().flat_map(|row| fixed(&row.says)).collect();
    let mut missing = Vec::new();
    for file in &exceptions.writers {
        for literal in in_file(&root().join(file), Wanted::Program) {
            let parts = sentences(&literal);
            let is_variant = exceptions.variants.iter().any(|variant| literal.contains(variant));
            if !parts.is_empty() && !is_variant && !is_known(&parts, &known) {
                missing.push(format!("{file}: {literal:?}"));
            }
        }
    }
    assert!(missing.is_empty(), "no row of messages.toml has:\n{}", missing.join("\n"));
}

/// The command line's own, the writers' and the service's.
#[test]
fn each_message_of_the_program_is_provoked_somewhere() {
    let (rows, exceptions) = (table(), read::<Exceptions>("exceptions.toml"));
    let tests: Vec<String> =
        ["tests", "server"].iter().flat_map(|top| files(&root().join(top))).flat_map(|file| tested(&file)).collect();
    let known: Vec<&str> =
        rows.iter().flat_map(|row| fixed(&row.says)).chain(tests.iter().map(String::as_str)).collect();
    let mut missing = Vec::new();
    for file in exceptions.program.iter().flat_map(|top| files(&root().join(top))) {
        let name = file.strip_prefix(root()).unwrap().to_string_lossy().replace('\\', "/");
        let is_exempt = |text: &str| {
            exceptions.exempt.iter().any(|[file, begin, _]| name.starts_with(file) && text.starts_with(begin))
        };
        for literal in in_file(&file, Wanted::Program) {
            let parts: Vec<&str> = sentences(&literal).into_iter().filter(|part| part.contains(' ')).collect();
            let is_fault = literal.trim_start_matches(['{', '}', ':', ' ']).starts_with(char::is_lowercase);
            if is_fault && !is_exempt(&literal) && !parts.is_empty() && !is_known(&parts, &known) {
                missing.push(format!("{name}: {literal:?}"));
            }
        }
    }
    assert!(missing.is_empty(), "neither a row of messages.toml nor a test has:\n{}", missing.join("\n"));
}

/// A client knows the faults of the service by these.
#[test]
fn each_reason_of_a_fault_is_asserted() {
    let is_reason = |text: &String| text.len() > 5 && text.chars().all(|c| c.is_ascii_uppercase() || c == '_');
    let of_program = in_file(&root().join("server/service/src/status.rs"), Wanted::Program);
    let reasons: Vec<String> = of_program.into_iter().filter(is_reason).collect();
    let tops = ["tests/service", "server/service/src"];
    let tests: Vec<String> =
        tops.iter().flat_map(|top| files(&root().join(top))).flat_map(|file| tested(&file)).collect();
    assert!(reasons.len() > 20, "{reasons:?}");
    let missing: Vec<&String> = reasons.iter().filter(|reason| !tests.contains(reason)).collect();
    assert!(missing.is_empty(), "no test has {missing:?}");
}

/// Rust files of a folder and all below it, or the file itself.
fn files(top: &Path) -> Vec<PathBuf> {
    if top.is_file() {
        return vec![top.to_owned()];
    }
    let entries = std::fs::read_dir(top).unwrap().map(|entry| entry.unwrap().path());
    let inside = entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] });
    inside.filter(|path| path.extension().is_some_and(|extension| extension == "rs")).collect()
}

/// The texts of a test's file, or of the tests in a file of the program.
fn tested(file: &Path) -> Vec<String> {
    let is_test = file.starts_with(root().join("tests")) || file.components().any(|part| part.as_os_str() == "tests");
    let texts = in_file(file, if is_test { Wanted::All } else { Wanted::Tests });
    texts.iter().map(|text| text.trim().to_owned()).collect()
}

fn in_file(file: &Path, wanted: Wanted) -> Vec<String> {
    texts(&std::fs::read_to_string(file).unwrap(), wanted)
}

/// Which texts of a file's code.
#[derive(Clone, Copy)]
enum Wanted<'a> {
    All,
    /// No tests, no reasons of a panic and no lines of a log.
    Program,
    /// Those of modules of tests.
    Tests,
    /// Those of one test.
    Test(&'a str),
}

/// The texts in code, without its comments.
fn texts(code: &str, wanted: Wanted) -> Vec<String> {
    let mut found = Vec::new();
    add_texts(TokenBuffer::new2(code.parse().expect("the code compiles")).begin(), wanted, &mut found);
    found
}

fn add_texts(mut at: Cursor, wanted: Wanted, found: &mut Vec<String>) {
    // The word just before; the function that begins; whether its body, or a module's, is that of a test.
    let (mut word, mut function, mut is_test) = (String::new(), String::new(), false);
    while let Some((tree, next)) = at.token_tree() {
        if let Some((inside, delimiter, ..)) = at.any_group() {
            let is_body = format!("{delimiter:?}") == "Brace";
            let (first, attribute) = inside.ident().map_or_else(Default::default, |(first, rest)| {
                (first.to_string(), rest.token_tree().map_or_else(String::new, |(tree, _)| tree.to_string()))
            });
            let below = match wanted {
                // A comment.
                _ if word.starts_with('#') && first == "doc" => None,
                Wanted::Program if is_test && is_body || is_silent(&word) => None,
                Wanted::Tests if is_test && is_body => Some(Wanted::All),
                Wanted::Test(name) if is_test && is_body && name == function => Some(Wanted::All),
                wanted => Some(wanted),
            };
            below.into_iter().for_each(|wanted| add_texts(inside, wanted, found));
            is_test = !is_body && (is_test || word == "#" && (first == "test" || attribute == "(test)"));
            word.clear();
        } else if let Some((name, _)) = at.ident() {
            if word == "fn" {
                function = name.to_string();
            }
            word = name.to_string();
        } else if let Some((sign, _)) = at.punct() {
            is_test &= sign.as_char() != ';';
            match sign.as_char() {
                '!' => word.push('!'),
                sign => word = sign.to_string(),
            }
        } else if matches!(wanted, Wanted::All | Wanted::Program) {
            found.extend(syn::parse_str::<syn::LitStr>(&tree.to_string()).map(|text| text.value()));
        }
        at = next;
    }
}

/// Whether what follows this word is the reason of a panic, or what is logged.
fn is_silent(word: &str) -> bool {
    let macros = ["info!", "warn!", "error!", "unreachable!"];
    word == "expect"
        || macros.contains(&word)
        || word.ends_with('!') && ["assert", "describe_"].iter().any(|part| word.contains(part))
}

/// `UPDATE_PAGE=1` writes the page's table again.
#[test]
fn the_pages_are_the_table_of_messages() {
    const MARKS: [&str; 2] = ["<!-- messages -->\n", "<!-- end of messages -->\n"];
    let path = root().join("examples/guide/troubleshooting.md");
    let page = std::fs::read_to_string(&path).unwrap();
    let (head, rest) = page.split_once(MARKS[0]).expect("the page has a place for the table");
    let (_, tail) = rest.split_once(MARKS[1]).expect("the table has an end");
    let mut made = String::new();
    let rows = table();
    let parts = rows.iter().map(|row| row.part.as_str());
    let mut seen = Vec::new();
    parts.for_each(|part| {
        if !seen.contains(&part) {
            seen.push(part);
        }
    });
    for part in seen {
        write!(made, "\n### {part}\n\n| message | | cause | what helps |\n| --- | --- | --- | --- |\n").unwrap();
        for row in rows.iter().filter(|row| row.part == part) {
            let cell = |text: &str| text.replace('|', "\\|");
            let (says, cause, remedy) = (cell(&row.says), cell(&row.cause), cell(&row.remedy));
            writeln!(made, "| {says} | {} | {cause} | {remedy} |", row.kind).unwrap();
        }
    }
    made.push('\n');
    let expected = [head, MARKS[0], &made, MARKS[1], tail].concat();
    if std::env::var_os("UPDATE_PAGE").is_some() {
        std::fs::write(&path, &expected).unwrap();
    }
    assert!(std::fs::read_to_string(&path).unwrap() == expected, "UPDATE_PAGE=1 cargo test writes {}", path.display());
}
