//! The provenance of a result: the scene that it was baked from, and its files.

use crate::files;
use crate::model::export::{self, Format};
use crate::problem::Problem;
use crate::scene_file::SceneTree;
use crate::wire::digest::hex;
use serde::Deserialize;
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// The provenance as it is stored in a result.
#[derive(Debug, Deserialize)]
pub struct Origin {
    pub scene: Value,
    pub assets: Vec<AssetRecord>,
    pub versions: Value,
    pub result_blake3: String,
}

/// A file of the scene, or one that such a file names.
#[derive(Debug, Deserialize)]
pub struct AssetRecord {
    pub uri: String,
    pub sha256: String,
}

/// Reads the provenance from a result's bytes, if they hold one.
pub fn origin(result: &[u8]) -> Option<Origin> {
    Origin::deserialize(export::origin(result)?).ok()
}

/// The scene of a result. Its files are found by name and hash: below `assets` if given, else below the result's
/// folder, one above it, or the current folder.
pub fn scene(path: &Path, assets: Option<&Path>) -> Result<SceneTree, Vec<Problem>> {
    let one = |what: &str, remedy: &str| vec![Problem::at(path, what, remedy)];
    let bytes = files::read(path).map_err(|problem| vec![problem])?;
    let Some(origin) = origin(&bytes) else {
        return Err(match Format::of(path) {
            Some(Format::Glb) => one("a mesh, not a scene file", "Give it by --control, --prop or --static."),
            _ => one("it does not hold its scene", "Name an unchanged result of Cairn, or a scene file."),
        });
    };
    let folder = find(&origin.assets, &places(path, assets)).map_err(|asset| {
        let what = format!("its file {} is not here with the content that was baked", asset.uri);
        one(&what, "Name the folder of the file by --assets.")
    })?;
    let text = origin.scene.to_string();
    // Reading it as a scene file of that folder checks its fields against the schema.
    SceneTree::read(&folder.join("scene.json"), text.as_bytes())
}

/// Folders that may hold the files, most likely first.
fn places(result: &Path, assets: Option<&Path>) -> Vec<PathBuf> {
    /// Folders searched below each of the first ones.
    const MOST: usize = 1000;
    let mut tops: Vec<PathBuf> = match assets {
        Some(folder) => vec![folder.to_owned()],
        None => {
            let own = files::folder_of(result);
            let above = std::path::absolute(own).unwrap_or_default();
            [own.to_owned(), PathBuf::new()].into_iter().chain(above.ancestors().skip(1).map(Path::to_owned)).collect()
        }
    };
    let wide = tops.len().min(2);
    let inside: Vec<PathBuf> = tops[..wide].iter().flat_map(|top| below(top, MOST)).collect();
    tops.extend(inside);
    tops
}

/// The folders below one, nearest first.
fn below(top: &Path, most: usize) -> Vec<PathBuf> {
    let mut found = vec![top.to_owned()];
    let mut next = 0;
    while next < found.len() && found.len() < most {
        let folder = if found[next].as_os_str().is_empty() { Path::new(".") } else { &found[next] };
        let entries = folder.read_dir().into_iter().flatten().flatten();
        let is_folder = |entry: &std::fs::DirEntry| entry.file_type().is_ok_and(|kind| kind.is_dir());
        let mut inside: Vec<PathBuf> =
            entries.filter(is_folder).map(|entry| found[next].join(entry.file_name())).collect();
        inside.sort();
        found.extend(inside);
        next += 1;
    }
    found.truncate(most);
    found.split_off(1)
}

/// The first folder that has all files, or else the first file that no folder has.
fn find<'a>(assets: &'a [AssetRecord], places: &[PathBuf]) -> Result<PathBuf, &'a AssetRecord> {
    let is_there = |folder: &Path, asset: &AssetRecord| folder.join(&asset.uri).is_file();
    let is_same = |folder: &Path, asset: &AssetRecord| {
        files::read(&folder.join(&asset.uri)).is_ok_and(|bytes| hex(&Sha256::digest(&bytes)) == asset.sha256)
    };
    let mut missing = assets.first();
    for folder in places {
        let wrong = assets.iter().find(|asset| !is_there(folder, asset));
        match wrong.or_else(|| assets.iter().find(|asset| !is_same(folder, asset))) {
            None => return Ok(folder.clone()),
            Some(wrong) => missing = missing.or(Some(wrong)),
        }
    }
    missing.map_or_else(|| Ok(PathBuf::new()), Err)
}
