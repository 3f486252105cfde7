//! The provenance of a result: the scene that it was baked from, and its files.

use cairn_export::Format;
use cairn_files::Disk;
use cairn_files::problem::Problem;
use cairn_wire::digest::hex;
use cairn_wire::scene_file::SceneTree;
use serde::Deserialize;
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
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
    Origin::deserialize(cairn_export::origin(result)?).ok()
}

/// The scene of a result. Its files are found by their hashes, below `assets` if given, else below the result's folder,
/// one above it, or the current folder; first under their names, then under any. In the scene, they keep their names.
pub fn scene(path: &Path, assets: Option<&Path>) -> Result<SceneTree, Vec<Problem>> {
    let one = |what: &str, remedy: &str| vec![Problem::at(path, what, remedy)];
    let bytes = cairn_files::read(path).map_err(|problem| vec![problem])?;
    let Some(origin) = origin(&bytes) else {
        return Err(match Format::of(path) {
            Some(Format::Glb) => one("a mesh, not a scene file", "Give it by --control, --prop or --static."),
            _ => one("it does not hold its scene", "Name an unchanged result of Cairn, or a scene file."),
        });
    };
    let places = places(path, assets);
    let text = origin.scene.to_string();
    // Reading it as a scene file of a folder checks its fields against the schema.
    let read = |folder: &Path| SceneTree::read(&folder.join("scene.json"), text.as_bytes());
    if let Some(folder) = places.folders().find(|folder| has_all(folder, &origin.assets)) {
        let own = origin.assets.iter().map(|asset| folder.join(&asset.uri));
        let moved = own.map(|path| (cairn_files::normalized(&path), path)).collect();
        return Ok(read(&folder)?.with_files(Disk { moved, fence: None }));
    }
    let folder = places.tops.first().cloned().unwrap_or_default();
    let (mut finder, mut moved, mut problems) = (FileFinder::new(&places), BTreeMap::new(), Vec::new());
    for asset in &origin.assets {
        match finder.find(asset) {
            Some(found) => drop(moved.insert(cairn_files::normalized(&folder.join(&asset.uri)), found)),
            None => {
                let what = format!("its file {} is not here with the content that was baked", asset.uri);
                let hash = asset.sha256.get(..12).unwrap_or(&asset.sha256);
                let remedy = match assets {
                    Some(folder) => format!(
                        "No file in {} or below it has its SHA-256 ({hash}...): find an unchanged copy of it.",
                        folder.display()
                    ),
                    None => "Name the folder of the file by --assets.".to_owned(),
                };
                problems.push(Problem::at(path, what, remedy));
            }
        }
    }
    if problems.is_empty() { Ok(read(&folder)?.with_files(Disk { moved, fence: None })) } else { Err(problems) }
}

/// Folders that may hold the files.
struct Places {
    /// Most likely first.
    tops: Vec<PathBuf>,
    /// How many of these are searched with all that is below them.
    deep: usize,
}

/// Folders and files that are looked at below one folder.
const MOST_FOLDERS: usize = 1000;
const MOST_FILES: usize = 10_000;

fn places(result: &Path, assets: Option<&Path>) -> Places {
    let tops: Vec<PathBuf> = match assets {
        Some(folder) => vec![folder.to_owned()],
        None => {
            let own = cairn_files::folder_of(result);
            let above = std::path::absolute(own).unwrap_or_default();
            [own.to_owned(), PathBuf::new()].into_iter().chain(above.ancestors().skip(1).map(Path::to_owned)).collect()
        }
    };
    let deep = tops.len().min(2);
    Places { tops, deep }
}

impl Places {
    /// The folders, then those below the first ones.
    fn folders(&self) -> impl Iterator<Item = PathBuf> {
        self.tops.iter().cloned().chain(self.tops[..self.deep].iter().flat_map(|top| below(top, MOST_FOLDERS)))
    }
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

/// Whether a folder has all files under their names.
fn has_all(folder: &Path, assets: &[AssetRecord]) -> bool {
    let path = |asset: &AssetRecord| folder.join(&asset.uri);
    assets.iter().all(|asset| path(asset).is_file())
        && assets.iter().all(|asset| hash(&path(asset)).is_some_and(|found| found == asset.sha256))
}

fn hash(path: &Path) -> Option<String> {
    Some(hex(&Sha256::digest(cairn_files::read(path).ok()?)))
}

/// Finds files by their hashes.
struct FileFinder<'a> {
    places: &'a Places,
    /// All files that may be the ones, once they were needed.
    files: Option<Vec<PathBuf>>,
    hashes: BTreeMap<PathBuf, Option<String>>,
}

impl<'a> FileFinder<'a> {
    fn new(places: &'a Places) -> FileFinder<'a> {
        FileFinder { places, files: None, hashes: BTreeMap::new() }
    }

    fn find(&mut self, asset: &AssetRecord) -> Option<PathBuf> {
        let named = self.places.folders().map(|folder| folder.join(&asset.uri)).find(|path| self.is(path, asset));
        if named.is_some() {
            return named;
        }
        let wanted = Path::new(&asset.uri);
        let mut files = self.files.take().unwrap_or_else(|| self.all_files());
        // Files of this name first, then those of this kind.
        files.sort_by_key(|path| (path.file_name() != wanted.file_name(), path.extension() != wanted.extension()));
        let found = files.iter().find(|path| self.is(path, asset)).cloned();
        self.files = Some(files);
        found
    }

    fn is(&mut self, path: &Path, asset: &AssetRecord) -> bool {
        if !path.is_file() {
            return false;
        }
        let known = self.hashes.entry(path.to_owned()).or_insert_with(|| hash(path));
        known.as_deref() == Some(&*asset.sha256)
    }

    fn all_files(&self) -> Vec<PathBuf> {
        let Places { tops, deep } = self.places;
        let folders = tops[..*deep].iter().flat_map(|top| std::iter::once(top.clone()).chain(below(top, MOST_FOLDERS)));
        let entries = folders.flat_map(|folder| {
            let read = if folder.as_os_str().is_empty() { Path::new(".").read_dir() } else { folder.read_dir() };
            let names = read.into_iter().flatten().flatten().map(|entry| entry.file_name());
            names.map(|name| folder.join(name)).collect::<Vec<_>>()
        });
        let mut files: Vec<PathBuf> = entries.take(MOST_FILES).filter(|path| path.is_file()).collect();
        files.sort();
        files.dedup();
        files
    }
}
