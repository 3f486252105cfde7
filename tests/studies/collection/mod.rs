//! A collection of models of others, as examples bake it: a folder with a `MANIFEST.tsv` (name, kind, source, licence,
//! bytes, triangles, watertight, ...), named in `CAIRN_COLLECTION`, or `../shared/data` beside the workspace.

use cairn_input::asset::{self, Limits, Source};
use cairn_input::scene::Model;
use std::path::{Path, PathBuf};

pub fn folder() -> PathBuf {
    let beside = Path::new(env!("CAIRN_REPOSITORY")).join("../shared/data");
    std::env::var_os("CAIRN_COLLECTION").map_or(beside, PathBuf::from)
}

pub fn manifest(folder: &Path) -> PathBuf {
    folder.join("MANIFEST.tsv")
}

/// The glTF files of a kind, by name; each with whether it is watertight, in the manifest's own words.
pub fn of_kind<'a>(manifest: &'a str, kind: &str) -> Vec<(&'a str, &'a str)> {
    let rows = manifest.lines().skip(1).map(|line| line.split('\t').collect::<Vec<_>>());
    let is_gltf = |name: &str| name.ends_with(".glb") || name.ends_with(".gltf");
    let fits = |row: &Vec<&str>| row.len() > 6 && row[1] == kind && is_gltf(row[0]);
    let mut found: Vec<(&str, &str)> = rows.filter(fits).map(|row| (row[0], row[6])).collect();
    found.sort_unstable();
    found
}

/// Reads a file of the collection.
pub fn model(folder: &Path, name: &str) -> Result<Model, String> {
    let path = folder.join(name);
    let bytes = std::fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let beside = path.parent().unwrap_or(folder).to_owned();
    let resolve = |relative: &str| std::fs::read(beside.join(relative)).map_err(|e| e.to_string());
    let source = Source { name, bytes: &bytes, node: None, resolve: &resolve, limits: Limits::default() };
    let problems = |all: Vec<asset::AssetProblem>| all.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
    Ok(Model::new(name.to_owned(), asset::read(&source).map_err(problems)?.mesh))
}
