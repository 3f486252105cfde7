//! The reader against a collection of real and broken files, if one is at hand.
//!
//! The collection is a folder with a `MANIFEST.tsv` (name, kind, ..., triangles, watertight, ...): `CAIRN_DATA`, or
//! `../shared/data` beside the workspace.

use std::path::{Path, PathBuf};

use cairn_core::asset::{self, Asset, Limits, Problem, Source};

struct Entry {
    name: String,
    kind: String,
    triangles: Option<usize>,
}

fn collection() -> Option<(PathBuf, Vec<Entry>)> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("CAIRN_DATA").map_or(beside, PathBuf::from);
    let Ok(manifest) = std::fs::read_to_string(folder.join("MANIFEST.tsv")) else {
        println!("no collection of files at {}: nothing was tried", folder.display());
        return None;
    };
    let entry = |line: &str| {
        let fields: Vec<&str> = line.split('\t').collect();
        Entry { name: fields[0].into(), kind: fields[1].into(), triangles: fields[5].parse().ok() }
    };
    let entries = manifest.lines().skip(1).map(entry).collect();
    Some((folder, entries))
}

fn read(folder: &Path, name: &str) -> Result<Asset, Vec<Problem>> {
    let path = folder.join(name);
    let bytes = std::fs::read(&path).expect("the manifest's files are there");
    let beside = path.parent().expect("a file has a folder").to_owned();
    let resolve = |uri: &str| std::fs::read(beside.join(uri)).map_err(|e| e.to_string());
    asset::read(&Source { name, bytes: &bytes, node: None, resolve: &resolve, limits: Limits::default() })
}

#[test]
fn table() {
    let Some((folder, entries)) = collection() else { return };
    for e in &entries {
        match read(&folder, &e.name) {
            Ok(a) => {
                let n = a.mesh.triangles.len() + a.degenerate;
                let same = if e.triangles == Some(n) { "" } else { "DIFFERS" };
                println!(
                    "{}\t{}\tread {n} ({} degenerate)\t{:?}\t{same}\t{:?}",
                    e.kind, e.name, a.degenerate, e.triangles, a.notes
                );
            }
            Err(ps) => {
                for p in ps {
                    println!("{}\t{}\trefused ({:?})\t{p}", e.kind, e.name, e.triangles)
                }
            }
        }
    }
}
