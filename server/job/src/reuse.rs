//! The cache of earlier bakes: fills with their collision shapes, collision shapes alone, and whole bakes, by the hash
//! of everything that they depend on.
//!
//! The cache never changes a result, only the time that it takes. Entries that cannot be read are computed again, and
//! entries that cannot be written are skipped.

use cairn_core::cache::{self, CachedFill, FillInputs};
use cairn_core::report::bake::Bake;
use cairn_engine::shape::{self, Shape, Size};
use cairn_files::failpoints;
use cairn_input::error::Error;
use cairn_input::params::{Params, Physics};
use cairn_input::scene::{Model, Prop, Scene};
use cairn_wire::versions::versions;
use etcetera::BaseStrategy;
use rayon::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::SystemTime;

/// Total size of all entries, bytes. The oldest are removed first.
const MOST: u64 = 2 << 30;
/// Largest entry, bytes.
const LARGEST: usize = 256 << 20;
/// How the name of an entry's file ends.
const ENDING: &str = ".cached";
/// Folders in which the cache of earlier versions was.
const EARLIER: [&str; 2] = ["content-v2", "index-v5"];

/// A cache on disk.
#[derive(Clone, Debug, Default)]
pub struct BakeCache {
    /// `None`: nothing is cached.
    folder: Option<PathBuf>,
}

impl BakeCache {
    pub fn none() -> BakeCache {
        BakeCache::default()
    }

    pub fn at(folder: &Path) -> BakeCache {
        BakeCache { folder: Some(folder.to_owned()) }
    }

    /// Its folder, if it has one that can be written.
    pub fn folder(&self) -> Option<&Path> {
        self.folder.as_deref().filter(|_| self.fault().is_none())
    }

    /// Why the folder cannot be written, if so.
    pub fn fault(&self) -> Option<std::io::Error> {
        self.folder
            .as_ref()
            .and_then(|folder| std::fs::create_dir_all(folder).and_then(|()| tempfile::tempfile_in(folder)).err())
    }

    /// The user's own cache folder, if the system has one.
    pub fn of_user() -> BakeCache {
        let folders = etcetera::choose_base_strategy().ok();
        BakeCache { folder: folders.map(|folders| folders.cache_dir().join("cairn")) }
    }

    /// Where the cache is, its size, and the size of what only other programs can read: earlier versions above all.
    /// Bytes.
    pub fn found(&self) -> Option<(&Path, u64, u64)> {
        let folder = self.folder.as_deref().filter(|folder| folder.is_dir())?;
        let own = format!("-{}-", program());
        let is_own =
            |file: &CachedFile| file.path.file_name().is_some_and(|name| name.to_string_lossy().contains(&own));
        let files = cached_files(folder);
        let size = |files: &mut dyn Iterator<Item = &CachedFile>| files.map(|file| file.size).sum();
        Some((folder, size(&mut files.iter()), size(&mut files.iter().filter(|file| !is_own(file)))))
    }

    /// The cached bake of this scene.
    pub fn bake(&self, scene: &Scene, params: &Params) -> Option<Bake> {
        self.folder.as_ref()?;
        self.read(&key("bake", &(scene, params))?)
    }

    pub fn keep_bake(&self, scene: &Scene, params: &Params, bake: &Bake) {
        if self.folder.is_some()
            && let Some(key) = key("bake", &(scene, params))
        {
            self.write(&key, bake);
        }
    }

    /// The collision shapes of a scene's props: those that are here, and new ones, which are kept. Also how many are
    /// new.
    pub fn shapes(&self, scene: &Scene, params: &Params, sizes: &[Size]) -> Result<(Vec<Shape>, usize), Error> {
        let made = AtomicUsize::new(0);
        let shape = |(i, (prop, &size)): (usize, (&Prop, &Size))| {
            let key = self.folder.as_ref().and_then(|_| key("shape", &ShapeInputs::new(prop, size, &params.physics)));
            if let Some(found) = key.as_ref().and_then(|key| self.read(key)) {
                return Ok(found);
            }
            made.fetch_add(1, Ordering::Relaxed);
            let shape = Shape::new(prop, size, &params.physics).map_err(shape::fault(i))?;
            if let Some(key) = &key {
                self.write(key, &shape);
            }
            Ok(shape)
        };
        let pairs: Vec<_> = scene.props.iter().zip(sizes).enumerate().collect();
        let shapes: Vec<Result<Shape, Error>> = pairs.into_par_iter().map(shape).collect();
        // The first error, not that of the fastest thread.
        Ok((shapes.into_iter().collect::<Result<_, _>>()?, made.into_inner()))
    }

    fn read<T: DeserializeOwned>(&self, key: &str) -> Option<T> {
        let bytes = std::fs::read(self.folder.as_ref()?.join(key)).ok()?;
        let (hash, content) = bytes.split_first_chunk::<{ blake3::OUT_LEN }>()?;
        // A disk may have changed what is on it.
        if blake3::hash(content) != *hash {
            return None;
        }
        postcard::from_bytes(content).ok()
    }

    fn write<T: Serialize>(&self, key: &str, value: &T) {
        let Some(folder) = &self.folder else { return };
        let Ok(content) = postcard::to_stdvec(value) else { return };
        if content.len() > LARGEST {
            return;
        }
        if failpoints::at("cache-write").is_ok() && write(folder, key, &content).is_ok() {
            trim(folder);
        }
    }
}

/// All that a collision shape depends on.
#[derive(Serialize)]
struct ShapeInputs<'a> {
    model: &'a Model,
    mesh_deviation: f64,
    density: f64,
    size: Size,
    physics: &'a Physics,
}

impl<'a> ShapeInputs<'a> {
    fn new(prop: &'a Prop, size: Size, physics: &'a Physics) -> ShapeInputs<'a> {
        let Prop { model, mesh_deviation, density, .. } = prop;
        ShapeInputs { model, mesh_deviation: *mesh_deviation, density: *density, size, physics }
    }
}

/// Writes an entry: a hash of the content, and the content. It appears complete or not at all.
fn write(folder: &Path, key: &str, content: &[u8]) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let mut file = cairn_files::new_file_in(folder)?;
    file.write_all(blake3::hash(content).as_bytes())?;
    file.write_all(content)?;
    file.persist(folder.join(key))?;
    Ok(())
}

struct CachedFile {
    path: PathBuf,
    /// Bytes.
    size: u64,
    written: SystemTime,
}

/// All files of the cache: nothing else that may be in the folder.
fn cached_files(folder: &Path) -> Vec<CachedFile> {
    let (mut files, mut folders) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(inside) = folders.pop() {
        for entry in inside.read_dir().into_iter().flatten().flatten() {
            let Ok(found) = entry.metadata() else { continue };
            let name = entry.file_name().to_string_lossy().into_owned();
            if found.is_dir() && (inside != folder || EARLIER.contains(&&*name)) {
                folders.push(entry.path());
            } else if found.is_file() && (inside != folder || name.ends_with(ENDING)) {
                let written = found.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                files.push(CachedFile { path: entry.path(), size: found.len(), written });
            }
        }
    }
    files
}

impl cache::FillCache for BakeCache {
    fn get(&mut self, inputs: &FillInputs) -> Option<CachedFill> {
        self.read(&key("fill", inputs)?)
    }

    fn put(&mut self, inputs: &FillInputs, found: &CachedFill) {
        if let Some(key) = key("fill", inputs) {
            self.write(&key, found);
        }
    }

    fn keeps(&self) -> bool {
        self.folder.is_some()
    }
}

/// The key of an entry: its kind, the program that made it, and a hash of the inputs.
fn key(kind: &str, inputs: &impl Serialize) -> Option<String> {
    let mut hasher = blake3::Hasher::new();
    postcard::to_io(inputs, &mut hasher).ok()?;
    Some(format!("{kind}-{}-{}{ENDING}", program(), hasher.finalize().to_hex()))
}

/// A hash of the versions, and of size and time of this program's file: two builds of a version may differ.
fn program() -> String {
    let versions = versions();
    let file = std::env::current_exe().and_then(std::fs::metadata).ok();
    let file = file.map_or(String::new(), |file| format!("{} {:?}", file.len(), file.modified().ok()));
    let mut hasher = blake3::Hasher::new();
    for part in [&*file, &*versions.cairn, &*versions.rapier3d, &*versions.clarabel] {
        hasher.update(part.as_bytes()).update(b"\n");
    }
    hasher.finalize().to_hex()[..16].to_owned()
}

/// Removes unfinished files, and the oldest entries until the rest is small enough.
fn trim(folder: &Path) {
    cairn_files::remove_abandoned(folder);
    let mut found = cached_files(folder);
    let mut total: u64 = found.iter().map(|file| file.size).sum();
    found.sort_by_key(|file| std::cmp::Reverse(file.written));
    while total > MOST
        && let Some(oldest) = found.pop()
    {
        total -= oldest.size;
        let _ = std::fs::remove_file(oldest.path);
    }
}
