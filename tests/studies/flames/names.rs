//! Functions' names, short enough to be read in a flame graph.

use std::path::Path;

/// Crates whose functions only hand on to others, do arithmetic, or take the samples: their time is that of who calls
/// them.
const CARRIERS: [&str; 13] = [
    "core",
    "std",
    "alloc",
    "rayon",
    "rayon-core",
    "rayon_core",
    "glam",
    "libm",
    "smallvec",
    "nalgebra",
    "simba",
    "backtrace",
    "pprof",
];

/// A function by its name and file; `None` for what only hands on. What was inlined has a name without its path: the
/// file names the module.
pub fn short(name: &str, file: Option<&Path>) -> Option<String> {
    let name = unqualified(name);
    match file {
        Some(file) if !name.contains("::") => by_file(name, file),
        _ => by_path(&name),
    }
}

/// `run`, `server/core/src/fill.rs` -> `fill::run`; of other crates, `rapier3d step`.
fn by_file(name: String, file: &Path) -> Option<String> {
    if is_noise(&name) {
        return None;
    }
    let parts: Vec<&str> = file.iter().filter_map(|part| part.to_str()).collect();
    let source = parts.iter().rposition(|&part| part == "src")?;
    let package = parts.get(source.checked_sub(1)?)?;
    if source >= 2 && parts[source - 2] == "server" {
        let module =
            parts[source + 1..].iter().rev().map(|part| part.trim_end_matches(".rs")).find(|&part| part != "mod");
        return Some(match module {
            Some(module) if module != "lib" => format!("{module}::{name}"),
            _ => name,
        });
    }
    let (package, _) = package.rsplit_once('-').unwrap_or((package, ""));
    if CARRIERS.contains(&package) { None } else { Some(format!("{package} {name}")) }
}

/// `<rapier3d::dynamics::A<T> as B>::f::{{closure}}::h0123456789abcdef` -> `rapier3d A::f`; our own core's without its
/// name.
fn by_path(name: &str) -> Option<String> {
    let segments: Vec<&str> = name.split("::").filter(|part| !part.is_empty() && !is_noise(part)).collect();
    let first = segments.first()?.trim_start_matches(['&', '*', ' ', '_']).trim_start_matches("mut ");
    if CARRIERS.contains(&first) {
        return None;
    }
    let last = segments[segments.len().saturating_sub(2)..].join("::");
    let is_ours = first.starts_with("cairn_") || segments.len() < 3;
    let last = last.strip_prefix(&format!("{first}::")).unwrap_or(&last).to_owned();
    Some(if is_ours { last } else { format!("{first} {last}") })
}

/// Hashes and closures.
fn is_noise(part: &str) -> bool {
    let is_hash = part.len() == 17 && part.starts_with('h') && part[1..].bytes().all(|b| b.is_ascii_hexdigit());
    is_hash || part.starts_with('{')
}

/// Without type arguments; `<A as B>` is `A`.
fn unqualified(name: &str) -> String {
    let name = match name.strip_prefix('<') {
        Some(rest) => {
            let end = closing(rest);
            let (inner, after) = (&rest[..end], rest.get(end + 1..).unwrap_or_default());
            let cut = top_level(inner, " as ").unwrap_or(inner.len());
            format!("{}{after}", &inner[..cut])
        }
        None => name.to_owned(),
    };
    let mut depth = 0;
    let mut before = ' ';
    name.chars()
        .filter(|&c| {
            let is_arrow = c == '>' && before == '-';
            before = c;
            match c {
                '<' => depth += 1,
                '>' if !is_arrow => {
                    depth -= 1;
                    return false;
                }
                _ => {}
            }
            depth == 0
        })
        .collect()
}

/// Where the bracket ends that was opened before the text.
fn closing(text: &str) -> usize {
    top_level(text, ">").unwrap_or(text.len())
}

/// The first place of a text outside of all brackets.
fn top_level(text: &str, wanted: &str) -> Option<usize> {
    let mut depth = 0;
    for (at, c) in text.char_indices() {
        if depth == 0 && text[at..].starts_with(wanted) {
            return Some(at);
        }
        match c {
            '<' => depth += 1,
            '>' if !text[..at].ends_with('-') => depth -= 1,
            _ => {}
        }
    }
    None
}
