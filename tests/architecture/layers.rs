//! Which module may use which: an import goes down, and no two modules side by side lead to each other.

use crate::modules::{Crate, Import, ModulePath};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The layers of `cairn-core`, lowest first. A module may use its own layer and those before it. The root file stands
/// above all.
const CORE: &[&[&str]] = &[
    &["error", "invariants", "platform"],
    &["geometry"],
    &["input"],
    &["asset"],
    &["measure"],
    &["prepare"],
    &["world"],
    &["sim"],
    &["analysis"],
    &["stages"],
    &["report"],
];

/// The layers inside `cairn_engine::world`, lowest first. What the world's root file holds is for all of them.
pub const WORLD: &[&[&str]] = &[
    &["units", "colliders"],
    &["manifold"],
    &["settings"],
    &["bodies"],
    &["corrections"],
    &["scenery"],
    &["contacts"],
    &["joints"],
    &["lifecycle"],
    &["validation"],
    &["stepping"],
    &["queries"],
    &["any_engine"],
];

/// The layers of `cairn-statics`, lowest first.
const STATICS: &[&[&str]] = &[&["local"], &["program"], &["global"], &["limit"], &["glue"], &["removal"]];

/// The layers of `cairn`, lowest first.
const SERVICE: &[&[&str]] = &[
    &["version"],
    &["failpoints"],
    &["problem"],
    &["files"],
    &["wire"],
    &["scene_file"],
    &["model"],
    &["job"],
    &["cost"],
    &["batch"],
    &["sheet"],
    &["client"],
    &["service"],
    &["cli"],
];

/// What the messages call a module.
fn name(path: &ModulePath) -> String {
    if path.is_empty() { "the root file".to_owned() } else { path.join("::") }
}

/// The height of the layer that a module is in: the root file's is above all, and `None` is that of a module without
/// one.
fn height(layers: &[&[&str]], path: &ModulePath) -> Option<usize> {
    let Some(top) = path.first() else { return Some(layers.len()) };
    layers.iter().position(|layer| layer.contains(&top.as_str()))
}

fn location(code: &Crate, import: &Import) -> String {
    format!("{}: `{}`", code.file(&import.from).display(), import.text)
}

/// Every import from a layer to one above it; what a module names of another one more than once is listed once. The
/// layers are those of the modules in `folder`; what the folder's own root file holds is for all of them.
fn upward(code: &Crate, folder: &[&str], layers: &[&[&str]]) -> Vec<String> {
    let inside = |path: &ModulePath| {
        let rest = path.get(folder.len()..).filter(|_| path.iter().zip(folder).all(|(a, b)| a == b));
        rest.map(<[String]>::to_vec)
    };
    let layer = |path: &ModulePath| path.first().cloned().unwrap_or_else(|| name(path));
    let mut up = BTreeMap::new();
    for import in code.imports() {
        let Some((from, to)) = inside(&import.from).zip(inside(&import.to)) else { continue };
        if !folder.is_empty() && to.is_empty() {
            continue;
        }
        if height(layers, &from).zip(height(layers, &to)).is_some_and(|(from, to)| to > from) {
            let text = format!("{} leads up from layer {} to {}", location(code, &import), layer(&from), layer(&to));
            // The whole path says more than a name that a `use` made short.
            let is_whole = import.text.starts_with("crate::") || import.text.starts_with("super::");
            let known = up.entry((import.from, import.to)).or_insert_with(|| text.clone());
            if is_whole {
                *known = text;
            }
        }
    }
    up.into_values().collect()
}

/// Modules of a folder that no layer names.
fn without_layer(code: &Crate, folder: &[&str], layers: &[&[&str]]) -> Vec<String> {
    let paths =
        code.paths().filter(|path| path.len() == folder.len() + 1 && path.iter().zip(folder).all(|(a, b)| a == b));
    paths.filter(|path| height(layers, &path[folder.len()..].to_vec()).is_none()).map(name).collect()
}

/// The circles among modules side by side: each with an import for every step of it.
fn circles(code: &Crate) -> Vec<String> {
    // Every import is one between the two siblings where the ways to its ends part.
    let mut steps: BTreeMap<(ModulePath, ModulePath), Import> = BTreeMap::new();
    for import in code.imports() {
        let common = import.from.iter().zip(&import.to).take_while(|(a, b)| a == b).count();
        if common < import.from.len().min(import.to.len()) {
            let sibling = |path: &ModulePath| path[..=common].to_vec();
            steps.entry((sibling(&import.from), sibling(&import.to))).or_insert(import);
        }
    }
    let mut told_of = BTreeSet::new();
    let mut found = Vec::new();
    for start in code.paths() {
        let Some(circle) = shortest_circle(start, &steps) else { continue };
        if told_of.insert(circle.iter().cloned().collect::<BTreeSet<_>>()) {
            let ways = (0..circle.len()).map(|k| {
                let (from, to) = (&circle[k], &circle[(k + 1) % circle.len()]);
                let import = &steps[&(from.clone(), to.clone())];
                format!("{} -> {} ({})", name(from), name(to), location(code, import))
            });
            found.push(ways.collect::<Vec<_>>().join(", "));
        }
    }
    found
}

/// The modules on the shortest way from a module back to itself.
fn shortest_circle(start: &ModulePath, steps: &BTreeMap<(ModulePath, ModulePath), Import>) -> Option<Vec<ModulePath>> {
    let mut before: BTreeMap<&ModulePath, &ModulePath> = BTreeMap::new();
    let mut front = vec![start];
    while !front.is_empty() {
        let mut next = Vec::new();
        for from in front {
            for (_, to) in steps.keys().filter(|(a, _)| a == from) {
                if to == start {
                    let mut circle = vec![from.clone()];
                    while circle[circle.len() - 1] != *start {
                        circle.push(before[&circle[circle.len() - 1]].clone());
                    }
                    circle.reverse();
                    return Some(circle);
                }
                if !before.contains_key(to) {
                    before.insert(to, from);
                    next.push(to);
                }
            }
        }
        front = next;
    }
    None
}

fn parse(folder: &str) -> Crate {
    let read = |path: &Path| std::fs::read_to_string(crate::root().join(path)).ok();
    Crate::parse(&Path::new(folder).join("lib.rs"), &read)
}

#[track_caller]
fn assert_none(what: &str, found: &[String]) {
    assert!(found.is_empty(), "{} {what}:\n  {}", found.len(), found.join("\n  "));
}

#[test]
fn imports_of_the_core_go_down() {
    let code = parse("server/core/src");
    assert!(code.imports().len() > 100, "the imports are read");
    assert_none("modules without a layer", &without_layer(&code, &[], CORE));
    assert_none("imports upward", &upward(&code, &[], CORE));
}

#[test]
fn imports_inside_the_world_go_down() {
    let code = parse("server/core/src");
    assert_none("modules without a layer", &without_layer(&code, &["world"], WORLD));
    assert_none("imports upward", &upward(&code, &["world"], WORLD));
}

#[test]
fn imports_of_the_statics_go_down() {
    let code = parse("server/statics/src");
    assert_none("modules without a layer", &without_layer(&code, &[], STATICS));
    assert_none("imports upward", &upward(&code, &[], STATICS));
    assert_none("circles", &circles(&code));
}

#[test]
fn imports_of_the_service_go_down() {
    let code = parse("server/src");
    assert!(code.imports().len() > 100, "the imports are read");
    assert_none("modules without a layer", &without_layer(&code, &[], SERVICE));
    assert_none("imports upward", &upward(&code, &[], SERVICE));
}

#[test]
fn no_module_of_the_core_leads_back_to_itself() {
    assert_none("circles", &circles(&parse("server/core/src")));
}

#[test]
fn no_module_of_the_gltf_reader_leads_back_to_itself() {
    assert_none("circles", &circles(&parse("server/gltf/src")));
}

#[test]
fn no_module_of_the_service_leads_back_to_itself() {
    assert_none("circles", &circles(&parse("server/src")));
}

/// `ARCHITECTURE.md` draws the layers as they are: each begins a line of its own, in their order.
#[test]
fn the_map_has_the_layers_in_their_order() {
    let map = crate::read("ARCHITECTURE.md");
    for (folder, begin, layers) in
        [("server/statics/src", "`", STATICS), ("server/core/src", "| `", CORE), ("server/src", "`", SERVICE)]
    {
        let mut at = 0;
        for layer in layers.iter().flat_map(|layer| layer.iter()) {
            let found =
                ["/`", ".rs`"].iter().filter_map(|end| map[at..].find(&format!("{begin}{folder}/{layer}{end}")));
            at += found.min().unwrap_or_else(|| panic!("{folder}/{layer} is not drawn behind the layers below it"));
        }
    }
}

/// A crate of made-up files, by their paths in the source folder.
fn made_up(files: &[(&str, &str)]) -> Crate {
    let files: BTreeMap<PathBuf, String> =
        files.iter().map(|(path, text)| (PathBuf::from(path), (*text).to_owned())).collect();
    Crate::parse(Path::new("lib.rs"), &|path| files.get(path).cloned())
}

const MADE_UP: &[&[&str]] = &[&["low"], &["high"]];

fn upward_in(low: &str) -> Vec<String> {
    let high = "pub struct Roof;";
    upward(
        &made_up(&[("lib.rs", "mod low; mod high; pub use high::Roof;"), ("low.rs", low), ("high.rs", high)]),
        &[],
        MADE_UP,
    )
}

#[test]
fn an_import_upward_is_found_wherever_it_stands() {
    let places = [
        "use crate::high::Roof;",
        "use crate::{high as h};",
        "use super::high::*;",
        "fn f(roof: &crate::high::Roof) {}",
        "fn f() { let roof = crate::high::Roof; }",
        "fn f() { use crate::high; drop(high::Roof); }",
        "fn f() { assert!(true, \"{:?}\", crate::high::Roof); }",
        "struct Wall(Option<crate::high::Roof>);",
        "mod inner { use super::super::high::Roof; }",
    ];
    for place in places {
        let found = upward_in(place);
        assert_eq!(found.len(), 1, "{place}: {found:?}");
        assert!(found[0].starts_with("low.rs: `"), "{found:?}");
        assert!(found[0].ends_with("leads up from layer low to high"), "{found:?}");
    }
    // By the root file: up twice, to the root and to where the name comes from.
    assert_eq!(upward_in("use crate::Roof;").len(), 2);
}

#[test]
fn a_folder_has_layers_of_its_own() {
    let with = |low: &'static str| {
        made_up(&[
            ("lib.rs", "mod folder; mod high;"),
            ("high.rs", ""),
            ("folder/mod.rs", "mod low; mod high; pub use high::Roof; pub struct Shared;"),
            ("folder/low.rs", low),
            ("folder/high.rs", "pub struct Roof;"),
        ])
    };
    let found = |low: &'static str| upward(&with(low), &["folder"], MADE_UP);
    assert_eq!(found("use super::Shared; use crate::high;"), [""; 0]);
    assert_eq!(found("use super::high::Roof;").len(), 1);
    assert_eq!(found("use super::Roof;").len(), 1);
    assert_eq!(without_layer(&with(""), &["folder"], &[&["low"]]), ["folder::high"]);
}

#[test]
fn what_only_looks_like_an_import_is_none() {
    let places = [
        "#[cfg(test)] mod tests { use crate::high::Roof; }",
        "#[cfg(test)] use crate::high::Roof;",
        "// use crate::high::Roof;\n/// [`crate::high::Roof`]\nfn f() -> &'static str { \"crate::high::Roof\" }",
        "use ::high::Roof;",
        "use other::high; fn f() { high::Roof; }",
        "pub(crate) fn high() {} fn f(high: u8) -> u8 { high }",
    ];
    for place in places {
        assert_eq!(upward_in(place), [""; 0], "{place}");
    }
    let down = [("lib.rs", "mod low; mod high;"), ("low.rs", ""), ("high.rs", "use crate::low;")];
    assert_eq!(upward(&made_up(&down), &[], MADE_UP), [""; 0]);
    let third = [("lib.rs", "mod low; mod third;"), ("low.rs", ""), ("third.rs", "")];
    assert_eq!(without_layer(&made_up(&third), &[], MADE_UP), ["third"]);
}

#[test]
fn a_circle_is_found_among_siblings_and_below() {
    let parent = "mod a; mod b; mod c; pub use b::B; pub struct Shared;";
    let with = |a: &'static str, b: &'static str, c: &'static str| {
        circles(&made_up(&[
            ("lib.rs", "mod p;"),
            ("p/mod.rs", parent),
            ("p/a.rs", a),
            ("p/b.rs", b),
            ("p/c/mod.rs", "mod deep;"),
            ("p/c/deep.rs", c),
        ]))
    };
    // What a parent holds is everybody's.
    assert_eq!(
        with("use super::Shared; use super::b::B;", "use super::c::deep::D;", "use super::super::Shared;"),
        [""; 0]
    );
    let found = with("use super::b::B;", "use super::c::deep::D;", "use crate::p::a::A;");
    assert_eq!(found.len(), 1, "{found:?}");
    for part in ["p::a -> p::b (p/a.rs: `super::b::B`)", "p::b -> p::c (p/b.rs", "p::c -> p::a (p/c/deep.rs"] {
        assert!(found[0].contains(part), "{found:?}");
    }
    // A re-export hides no circle.
    assert_eq!(with("use super::B;", "use super::a::A;", "").len(), 1);
}
