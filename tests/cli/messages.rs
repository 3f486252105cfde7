//! Every message about files, scenes and piles, provoked on its cause. Long: it makes a file for each fault.
//!
//! None is printed for two others that look alike. The table is `messages.toml`; the guide's page on troubleshooting
//! has it.

use crate::desk::{Desk, box_data, box_json, glb};
use rayon::prelude::*;
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;

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

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn table() -> Vec<Row> {
    let text = std::fs::read_to_string(root().join("tests/cli/messages.toml")).unwrap();
    toml::from_str::<Table>(&text).unwrap().message
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
    let Some((before, body)) = file.split_once(&format!("fn {test}() {{\n")) else { return cases };
    let (indent, is_test) = (before.len() - before.trim_end_matches(' ').len(), before.trim_end().ends_with("#[test]"));
    let end = format!("\n{}}}\n", " ".repeat(indent));
    let body = body.split_once(&end).map_or(body, |(body, _)| body);
    let mut case = None;
    for text in literals(body).into_iter().filter(|_| is_test) {
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

/// Files whose sentences are messages of the table.
const WRITERS: [&str; 16] = [
    "server/core/src/geometry/topology/holes.rs",
    "server/core/src/geometry/topology/repair.rs",
    "server/core/src/measure/mod.rs",
    "server/core/src/prepare/check.rs",
    "server/core/src/prepare/check/added.rs",
    "server/core/src/prepare/check/shell.rs",
    "server/core/src/prepare/check/standing.rs",
    "server/core/src/prepare/extremes.rs",
    "server/core/src/prepare/plan.rs",
    "server/core/src/report/glue.rs",
    "server/core/src/report/warnings.rs",
    "server/core/src/sim/events.rs",
    "server/gltf/src/geometry.rs",
    "server/gltf/src/node.rs",
    "server/gltf/src/problem.rs",
    "server/gltf/src/triangulate.rs",
];
/// Parts of messages that the table has by their other words.
const VARIANTS: [&str; 9] = [
    "dots of glue bridge gaps",
    ", or fill.method = \"insert\",",
    "raise fill.protrusion (it is",
    "use more accuracy, or props of a simpler shape",
    "primitives without positions",
    "before it are broken, so it is not tried",
    "which should be the positions",
    "its meshes are hidden (KHR_node_visibility",
    "but none of the nodes read",
];
/// Folders and files of the program. Of their sentences, one that begins with a small letter says what is wrong: it is
/// in the table, or a test has its words. One that begins with a capital is the remedy beside it, or help.
const PROGRAM: [&str; 9] = [
    "server/src/batch",
    "server/src/cli",
    "server/src/client.rs",
    "server/src/files.rs",
    "server/src/job",
    "server/src/scene_file",
    "server/src/service",
    "server/src/sheet",
    "server/src/wire",
];
/// Sentences of these files that begin so are no messages to a user, or are known by something else than their words.
const EXEMPT: [(&str, &str, &str); 34] = [
    ("server/src/cli/check.rs", "", "a summary that was asked for"),
    ("server/src/cli/cost.rs", "", "tables that were asked for"),
    ("server/src/cli/doctor.rs", "", "the lines of the check of a machine"),
    ("server/src/cli/plan.rs", "", "a table that was asked for"),
    ("server/src/cli/progress.rs", "", "progress"),
    ("server/src/cli/summary.rs", "", "a summary of what went well"),
    ("server/src/cli/verify.rs", "", "verdicts that were asked for"),
    ("server/src/cli/bounds.rs", "", "faults of the system, which no test can provoke on every machine"),
    ("server/src/cli/batch/process_pool.rs", "it was stopped from outside", "a fault of the system"),
    ("server/src/cli/bake.rs", "this pile was baked before", "what went well"),
    ("server/src/cli/bake.rs", "the fill comes from the cache", "what went well"),
    ("server/src/cli/bake.rs", "cancelled", "tests know an end by Ctrl-C by its exit code"),
    ("server/src/cli/batch/mod.rs", "cancelled", "tests know an end by Ctrl-C by its exit code"),
    ("server/src/cli/failure.rs", "cancelled", "tests know an end by Ctrl-C by its exit code"),
    ("server/src/cli/bakes.rs", "the stream of its events has ended", "a server that breaks its own protocol"),
    ("server/src/cli/remote.rs", "a link that leads out of the folder", "`a_model_behind_a_link_is_not_sent`"),
    ("server/src/client.rs", "the value of `", "control characters, which no command line of a test has"),
    ("server/src/client.rs", "the transfer of a file ended early", "`downloads_that_break_off`"),
    ("server/src/files.rs", "not readable by this user", "tests may run as root, who reads everything"),
    ("server/src/job/sources.rs", "it is not beside the file", "paths are checked before"),
    ("server/src/service/calls", "", "a client knows a fault by its reason and field, which tests assert"),
    ("server/src/service/codec.rs", "", "a client knows a fault by its reason and field, which tests assert"),
    ("server/src/service/encryption.rs", "", "wrong settings, of which `certificates.rs` has some; lines of the log"),
    ("server/src/service/jobs", "", "a client knows a fault by its reason, which tests assert"),
    ("server/src/service/listen.rs", "this system has no Unix sockets", "another system"),
    ("server/src/service/process.rs", "", "a client knows a fault by its reason, which tests assert"),
    ("server/src/service/quotas.rs", "", "the reason of a panic"),
    ("server/src/service/serve.rs", "the store cannot be read", "a fault of the system"),
    ("server/src/service/status.rs", "", "a client knows a fault by its reason: `each_reason_of_a_fault_is_asserted`"),
    ("server/src/service/store.rs", "", "a client knows a fault by its reason, which tests assert"),
    ("server/src/service/worker.rs", "", "a client knows a fault by its reason and field, which tests assert"),
    ("server/src/scene_file/mod.rs", "an unset field is left out", "the reason of a panic"),
    ("server/src/sheet/picture.rs", "", "the reason of a panic"),
    ("server/src/wire/parameters.rs", "", "the reason of a panic"),
];

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
    let rows = table();
    let known: Vec<&str> = rows.iter().flat_map(|row| fixed(&row.says)).collect();
    let mut missing = Vec::new();
    for file in WRITERS {
        for literal in literals(&code(&root().join(file))) {
            let parts = sentences(&literal);
            let is_variant = VARIANTS.iter().any(|variant| literal.contains(variant));
            if !parts.is_empty() && !is_variant && !is_known(&parts, &known) {
                missing.push(format!("{file}: {literal:?}"));
            }
        }
    }
    assert!(missing.is_empty(), "no row of messages.toml has:\n{}", missing.join("\n"));
}

/// The command line's own, and the service's.
#[test]
fn each_message_of_the_program_is_provoked_somewhere() {
    let rows = table();
    let tests: Vec<String> =
        ["tests", "server"].iter().flat_map(|top| files(&root().join(top))).flat_map(tested).collect();
    let known: Vec<&str> =
        rows.iter().flat_map(|row| fixed(&row.says)).chain(tests.iter().map(String::as_str)).collect();
    let mut missing = Vec::new();
    for file in PROGRAM.iter().flat_map(|top| files(&root().join(top))) {
        let name = file.strip_prefix(root()).unwrap().to_string_lossy().replace('\\', "/");
        let is_exempt =
            |text: &str| EXEMPT.iter().any(|(file, begin, _)| name.starts_with(file) && text.starts_with(begin));
        for literal in literals(&code(&file)) {
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
    let reasons: Vec<String> =
        literals(&code(&root().join("server/src/service/status.rs"))).into_iter().filter(is_reason).collect();
    let tops = ["tests/service", "server/src/service"];
    let tests: Vec<String> = tops.iter().flat_map(|top| files(&root().join(top))).flat_map(tested).collect();
    assert!(reasons.len() > 20, "{reasons:?}");
    let missing: Vec<&String> = reasons.iter().filter(|reason| !tests.contains(reason)).collect();
    assert!(missing.is_empty(), "no test has {missing:?}");
}

/// Rust files of a folder and all below it, or the file itself.
fn files(top: &Path) -> Vec<std::path::PathBuf> {
    if top.is_file() {
        return vec![top.to_owned()];
    }
    let entries = std::fs::read_dir(top).unwrap().map(|entry| entry.unwrap().path());
    let inside = entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] });
    inside.filter(|path| path.extension().is_some_and(|extension| extension == "rs")).collect()
}

/// The program's part of a file: no tests, no reasons of a panic and no lines of a log.
fn code(file: &Path) -> String {
    let text = std::fs::read_to_string(file).unwrap();
    let code = text.split("#[cfg(test)]").next().unwrap();
    let is_message = |line: &&str| {
        let begin = line.trim_start();
        !["//", "assert", "info!", "warn!", "error!", "describe_", ".expect("]
            .iter()
            .any(|start| begin.starts_with(start))
    };
    let lines: Vec<String> = code.lines().filter(is_message).map(without_log).collect();
    lines.join("\n")
}

/// A line without the reason of a panic, or what is logged.
fn without_log(line: &str) -> String {
    let marks = [".expect(\"", "unreachable!(", "info!(", "warn!(", "error!("];
    let begins = marks.iter().filter_map(|mark| line.find(mark));
    begins.min().map_or(line, |at| &line[..at]).to_owned()
}

/// The texts of a test's file, or of the tests in a file of the program.
fn tested(file: std::path::PathBuf) -> Vec<String> {
    let text = std::fs::read_to_string(&file).unwrap();
    let is_test = file.starts_with(root().join("tests")) || file.components().any(|part| part.as_os_str() == "tests");
    let tests = if is_test { Some(&*text) } else { text.split_once("#[cfg(test)]").map(|(_, tests)| tests) };
    tests.map(literals).unwrap_or_default().iter().map(|text| text.trim().to_owned()).collect()
}

/// The texts in a program's code, lines joined.
fn literals(code: &str) -> Vec<String> {
    let mut found = Vec::new();
    let without_comments: Vec<&str> = code.lines().filter(|line| !line.trim_start().starts_with("//")).collect();
    // A quote as a character begins no text.
    let code = without_comments.join("\n").replace("'\"'", "' '").replace("'\\\"'", "' '");
    let mut rest = code.as_str();
    while let Some(at) = rest.find('"') {
        let mut literal = String::new();
        let mut chars = rest[at + 1..].char_indices();
        let mut end = rest.len();
        while let Some((place, c)) = chars.next() {
            match c {
                '"' => {
                    end = at + 1 + place + 1;
                    break;
                }
                '\\' => match chars.next() {
                    Some((_, '\n')) => {
                        let tail = &rest[at + 1 + place + 2..];
                        let blank = tail.chars().take_while(|c| c.is_whitespace()).count();
                        chars.by_ref().take(blank).for_each(|_| ());
                    }
                    Some((_, 'n')) => literal.push('\n'),
                    Some((_, other)) => literal.push(other),
                    None => {}
                },
                c => literal.push(c),
            }
        }
        found.push(literal);
        rest = &rest[end..];
    }
    found
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

/// A box's document, changed.
fn changed(change: impl FnOnce(&mut Value)) -> Value {
    let mut document = box_json();
    change(&mut document);
    document
}

/// Boxes of these sizes at these places, each facing inward or outward, as one mesh of several primitives.
fn boxes(parts: &[([f32; 3], [f32; 3], bool)]) -> Vec<u8> {
    let mut data = Vec::new();
    let mut document = box_json();
    let (mut views, mut accessors, mut primitives) = (Vec::new(), Vec::new(), Vec::new());
    for (size, place, is_inward) in parts {
        let mut own = box_data(*size);
        for point in own[..96].chunks_exact_mut(12) {
            for (axis, value) in point.chunks_exact_mut(4).enumerate() {
                let moved = f32::from_le_bytes(value.try_into().unwrap()) + place[axis];
                value.copy_from_slice(&moved.to_le_bytes());
            }
        }
        if *is_inward {
            own[96..].chunks_exact_mut(6).for_each(|triangle| {
                let (first, second) = triangle.split_at_mut(2);
                first.swap_with_slice(&mut second[..2]);
            });
        }
        let begin = data.len();
        let first = accessors.len();
        views.push(json!({ "buffer": 0, "byteOffset": begin, "byteLength": 96 }));
        views.push(json!({ "buffer": 0, "byteOffset": begin + 96, "byteLength": 72 }));
        accessors.push(json!({ "bufferView": first, "componentType": 5126, "count": 8, "type": "VEC3" }));
        accessors.push(json!({ "bufferView": first + 1, "componentType": 5123, "count": 36, "type": "SCALAR" }));
        primitives.push(json!({ "attributes": { "POSITION": first }, "indices": first + 1 }));
        data.extend(own);
    }
    document["bufferViews"] = json!(views);
    document["accessors"] = json!(accessors);
    document["meshes"][0]["primitives"] = json!(primitives);
    document["buffers"][0]["byteLength"] = json!(data.len());
    glb(&document, &data)
}

/// A folder with a file for each fault.
fn shop() -> Desk {
    let desk = Desk::new();
    let data = box_data([0.3, 0.2, 0.4]);
    let file = |name: &str, change: &dyn Fn(&mut Value)| desk.write(name, glb(&changed(|json| change(json)), &data));
    let text = |name: &str, change: &dyn Fn(&mut Value)| {
        let percent: String = data.iter().map(|byte| format!("%{byte:02x}")).collect();
        let mut document = box_json();
        document["buffers"][0]["uri"] = json!(format!("data:,{percent}"));
        change(&mut document);
        desk.write(name, document.to_string());
    };
    // Files.
    desk.write("empty.glb", "");
    desk.write("text.glb", "this is no model");
    desk.write("broken.gltf", "{ \"asset\": { \"version\": \"2.0\" }, ");
    let whole = glb(&box_json(), &data);
    desk.write("cut.glb", &whole[..whole.len() - 40]);
    text("old.gltf", &|json| json["asset"]["version"] = json!("1.0"));
    file("bent.glb", &|json| {
        json["extensionsRequired"] = json!(["ACME_bend"]);
        json["nodes"][0]["extensions"] = json!({ "ACME_bend": {} });
    });
    file("unused.glb", &|json| json["extensionsRequired"] = json!(["ACME_bend"]));
    file("lines.glb", &|json| json["meshes"][0]["primitives"][0]["mode"] = json!(1));
    file("mixed.glb", &|json| {
        let primitive = json["meshes"][0]["primitives"][0].clone();
        json["meshes"][0]["primitives"] = json!([primitive, { "attributes": { "POSITION": 0 }, "mode": 0 }]);
    });
    file("lacking.glb", &|json| drop(json["accessors"][0].as_object_mut().unwrap().remove("count")));
    file("typed.glb", &|json| json["accessors"][0]["count"] = json!("eight"));
    file("astray.glb", &|json| json["nodes"][0]["mesh"] = json!(7));
    file("circle.glb", &|json| json["nodes"] = json!([{ "mesh": 0, "children": [1] }, { "children": [0] }]));
    file("shared.glb", &|json| {
        json["nodes"] = json!([{ "children": [1, 2] }, { "children": [3] }, { "children": [3] }, { "mesh": 0 }]);
    });
    file("unturned.glb", &|json| json["nodes"][0]["rotation"] = json!([0, 0, 0, 0]));
    file("loose.glb", &|json| json["nodes"][0]["rotation"] = json!([0, 0, 0, 1.1]));
    file("projected.glb", &|json| {
        json["nodes"][0]["matrix"] = json!([1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
    });
    file("endless.glb", &|json| {
        let scale = json!([1e200, 1e200, 1e200]);
        json["nodes"] = json!([{ "scale": scale, "children": [1] }, { "scale": scale, "mesh": 0 }]);
    });
    file("far.glb", &|json| json["nodes"][0]["translation"] = json!([1e15, 0, 0]));
    file("twins.glb", &|json| {
        json["nodes"] = json!([{ "name": "Brick", "mesh": 0 }, { "name": "Brick", "mesh": 0 }]);
        json["scenes"][0]["nodes"] = json!([0, 1]);
    });
    text("above.gltf", &|json| json["buffers"][0]["uri"] = json!("../brick.bin"));
    text("bufferless.gltf", &|json| json["buffers"][0]["uri"] = json!("gone.bin"));
    text("garbled.gltf", &|json| json["buffers"][0]["uri"] = json!("data:;base64,?"));
    text("nothing.gltf", &|json| drop(json["buffers"][0].as_object_mut().unwrap().remove("uri")));
    text("short.gltf", &|json| json["buffers"][0]["uri"] = json!("data:,%01%02"));
    file("beyond.glb", &|json| json["accessors"][0]["count"] = json!(9));
    file("bytes.glb", &|json| json["accessors"][1]["componentType"] = json!(5126));
    file("strided.glb", &|json| json["bufferViews"][0]["byteStride"] = json!(4));
    file("packed.glb", &|json| {
        json["meshes"][0]["primitives"][0]["extensions"] =
            json!({ "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": { "POSITION": 0 } } });
        json["accessors"].as_array_mut().unwrap().iter_mut().for_each(|accessor| {
            accessor.as_object_mut().unwrap().remove("bufferView");
        });
    });
    let mut restarted = data.clone();
    restarted[96..98].copy_from_slice(&u16::MAX.to_le_bytes());
    let as_strip = changed(|json| json["meshes"][0]["primitives"][0]["mode"] = json!(5));
    desk.write("strip.glb", glb(&as_strip, &restarted));
    file("sparse.glb", &|json| {
        let places = json!({ "bufferView": 1, "componentType": 5123 });
        json["accessors"][0]["sparse"] = json!({ "count": 9, "indices": places, "values": { "bufferView": 0 } });
    });
    file("faulty.glb", &|json| {
        json["nodes"] = json!((0..90).map(|i| json!({ "mesh": 7 + i })).collect::<Vec<_>>());
        json["scenes"][0]["nodes"] = json!((0..90).collect::<Vec<_>>());
    });
    file("few.glb", &|json| json["accessors"][0]["count"] = json!(4));
    let mut nan = data.clone();
    nan[0..4].copy_from_slice(&f32::NAN.to_le_bytes());
    desk.write("nan.glb", glb(&box_json(), &nan));
    file("sceneless.glb", &|json| drop(json.as_object_mut().unwrap().remove("scenes")));
    file("scenes.glb", &|json| json["scenes"] = json!([{ "nodes": [0] }, { "name": "Second", "nodes": [0] }]));
    let hidden = json!({ "KHR_node_visibility": { "visible": false } });
    file("hidden.glb", &|json| {
        json["nodes"] = json!([{ "mesh": 0 }, { "name": "Proxy", "mesh": 0, "extensions": hidden }]);
        json["scenes"][0]["nodes"] = json!([0, 1]);
    });
    let skin = |json: &mut Value| {
        json["nodes"][0]["skin"] = json!(0);
        json["skins"] = json!([{ "joints": [0] }]);
    };
    file("doll.glb", &|json| skin(json));
    desk.write("giant-doll.glb", glb(&changed(skin), &box_data([0.1, 100.0, 0.1])));
    file("morph.glb", &|json| json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": 0 }]));
    file("fat.glb", &|json| {
        json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": 0 }]);
        json["meshes"][0]["weights"] = json!([1]);
    });
    file("unplaced.glb", &|json| {
        let primitive = json["meshes"][0]["primitives"][0].clone();
        json["meshes"][0]["primitives"] = json!([primitive, { "attributes": {} }]);
    });
    file("uneven.glb", &|json| json["accessors"][1]["count"] = json!(35));
    let mut needles = data.clone();
    needles[98..100].copy_from_slice(&0_u16.to_le_bytes());
    desk.write("needles.glb", glb(&box_json(), &needles));
    // What is no file, or none to be changed.
    for folder in ["folder.glb", "results"] {
        std::fs::create_dir(desk.path(folder)).unwrap();
    }
    desk.write("results/1.glb", &whole);
    let figures = json!({ "output_blake3": "0", "measures": {}, "warnings": [], "bodies": 1 });
    desk.write("results/1.report.json", figures.to_string());
    std::fs::File::create(desk.path("huge.glb")).unwrap().set_len((1 << 30) + 1).unwrap();
    desk.write("blank.txt", "\n");
    desk.write("locked.json", "{}");
    let mut locked = std::fs::metadata(desk.path("locked.json")).unwrap().permissions();
    locked.set_readonly(true);
    std::fs::set_permissions(desk.path("locked.json"), locked).unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink(root().join("examples/assets/cone-small.glb"), desk.path("linked.glb")).unwrap();
    // What a result leaves out.
    let pictured = |json: &mut Value, uri: &str| {
        json["meshes"][0]["primitives"][0]["material"] = json!(0);
        json["materials"] = json!([{ "name": "Clay", "normalTexture": { "index": 0 } }]);
        json["textures"] = json!([{ "source": 0 }]);
        json["images"] = json!([{ "uri": uri }]);
    };
    text("pictured.gltf", &|json| pictured(json, "textures/gone.png"));
    text("distant.gltf", &|json| pictured(json, "https://example.org/red.png"));
    text("text-picture.gltf", &|json| pictured(json, "text.glb"));
    text("smudged.gltf", &|json| json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(77));
    file("filmed.glb", &|json| {
        json["nodes"][0]["camera"] = json!(0);
        json["cameras"] = json!([{ "type": "perspective" }]);
    });
    for (name, count) in [("forest.glb", 1001), ("grove.glb", 3)] {
        let places = (0..count).flat_map(|i| [i as f32 * 0.002, 0.0, 0.0]);
        let bytes: Vec<u8> = data.iter().copied().chain(places.flat_map(f32::to_le_bytes)).collect();
        let document = changed(|json| {
            let view = json!({ "buffer": 0, "byteOffset": 168, "byteLength": 12 * count });
            json["bufferViews"].as_array_mut().unwrap().push(view);
            let accessor = json!({ "bufferView": 2, "componentType": 5126, "count": count, "type": "VEC3" });
            json["accessors"].as_array_mut().unwrap().push(accessor);
            json["buffers"][0]["byteLength"] = json!(168 + 12 * count);
            json["nodes"][0]["extensions"] =
                json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 2 } } });
        });
        desk.write(name, glb(&document, &bytes));
    }
    // Control meshes and props.
    let large = box_data([4.0; 3]);
    let with_faces = |count: usize| changed(|json| json["accessors"][1]["count"] = json!(count));
    desk.write("lidless.glb", glb(&with_faces(30), &large));
    desk.write("torn.glb", glb(&with_faces(12), &large));
    desk.write("open-prop.glb", glb(&with_faces(30), &data));
    let room = |size: f32| ([size; 3], [0.0, 2.0, 0.0]);
    for (name, inner) in [("skin.glb", 3.9999), ("shell.glb", 3.8)] {
        let ((outer, place), (inner, _)) = (room(4.0), room(inner));
        desk.write(name, boxes(&[(outer, place, false), (inner, place, true)]));
    }
    desk.write("slab.glb", boxes(&[([5.0, 0.32, 5.0], [0.0, 0.16, 0.0], false)]));
    let rod = |i: usize| ([0.1, 3.0, 0.1], [2.0 + 0.3 * (i / 14) as f32, 1.5, 0.3 * (i % 14) as f32], false);
    let cube = ([1.0; 3], [0.0, 0.5, 0.0], false);
    desk.write("rods.glb", boxes(&std::iter::once(cube).chain((0..168).map(rod)).collect::<Vec<_>>()));
    desk.write(
        "partly.glb",
        boxes(&[([1.0; 3], [0.0, 0.5, 0.0], false), ([6.0, 0.15, 6.0], [9.0, 0.075, 0.0], false)]),
    );
    desk.write("crumb.glb", boxes(&[([0.02; 3], [0.0; 3], false)]));
    desk.write("beam.glb", boxes(&[([0.1, 100.0, 0.1], [0.0; 3], false)]));
    desk.write("wide.glb", boxes(&[([9.0, 3.0, 9.0], [0.0, 1.5, 0.0], false)]));
    let (unit, beside) = (([1.0; 3], [0.0, 0.5, 0.0], false), |x| ([1.0; 3], [x, 0.5, 0.0], false));
    desk.write("apart.glb", boxes(&[unit, beside(3.0)]));
    desk.write("touching.glb", boxes(&[unit, beside(1.0)]));
    desk.write("overlapping.glb", boxes(&[unit, beside(0.5)]));
    desk.write("cavity.glb", boxes(&[unit, ([0.4; 3], [0.0, 0.5, 0.0], true)]));
    desk.write("doubled.glb", boxes(&[unit, unit]));
    desk.write("reversed.glb", boxes(&[([1.0; 3], [0.0, 0.5, 0.0], true)]));
    desk.write("hollow.glb", boxes(&[([0.3; 3], [0.0; 3], false), ([0.28; 3], [0.0; 3], true)]));
    let mut flipped = box_data([1.0; 3]);
    let (first, second) = flipped[96..100].split_at_mut(2);
    first.swap_with_slice(second);
    desk.write("flipped.glb", glb(&box_json(), &flipped));
    // It stands on one corner.
    desk.write(
        "top.glb",
        glb(
            &changed(|json| json["nodes"][0]["rotation"] = json!([0.325_057_6, 0.0, 0.325_057_6, 0.888_073_8])),
            &box_data([1.0; 3]),
        ),
    );
    // Scenes with bodies, emitters and moving scenery.
    let scene = |name: &str, more: &str| {
        desk.write(
            name,
            format!("control_mesh = 'cone.glb'\nprops = ['stick.glb', {{ path = 'brick.glb', weight = 0 }}]\n{more}"),
        );
    };
    for (name, body) in [
        ("placed.toml", "position = [9, 0.2, 0]"),
        ("placed-wrong.toml", "prop = '5'\nposition = [9, 0.2, 0]"),
        ("flat-place.toml", "position = [9, 0.2]"),
        ("unrotated.toml", "position = [9, 0.2, 0]\nrotation = [0, 0, 0, 0]"),
        ("kept.toml", "position = [9, 0.2, 0]\nkept = true\nkept_until_seconds = 2"),
        ("kept-thrown.toml", "position = [9, 0.2, 0]\nkept = true\nvelocity = [1, 0, 0]"),
        ("until.toml", "position = [9, 0.2, 0]\nkept_until_seconds = 2"),
        ("early.toml", "position = [9, 0.2, 0]\nkept = true\nstart_seconds = 3\nkept_until_seconds = 2"),
        ("thrown.toml", "position = [9, 0.2, 0]\nvelocity = [90, 0, 0]\nstart_seconds = 1"),
    ] {
        scene(name, &format!("[[bodies]]\n{}{body}\n", if body.starts_with("prop") { "" } else { "prop = '0'\n" }));
    }
    for (name, emitter) in [
        ("emitter.toml", "center = [0, 3, 0]\nsize = [1, 1, 1]"),
        ("emitter-high.toml", "center = [0, 90, 0]\nsize = [1, 1, 1]"),
        ("weightless.toml", "center = [0, 3, 0]\nsize = [1, 1, 1]\nprops = ['1']"),
        ("holed.toml", "mesh = 'torn.glb'"),
    ] {
        scene(name, &format!("[[emitters]]\n{emitter}\nrate = 5\ncount = 2\n"));
    }
    desk.write(
        "named-twice.toml",
        "control_mesh = 'cone.glb'\nprops = ['stick.glb', 'stick.glb']\n\
         [[bodies]]\nprop = 'stick'\nposition = [9, 0, 0]\n",
    );
    scene("keys.toml", "[[statics]]\npath = 'brick.glb'\nkeyframes = [{ frame = 2 }, { frame = 1 }]\n");
    desk
}
