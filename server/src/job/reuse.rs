//! The cache of earlier bakes: collision shapes, fills and whole bakes, by the hash of everything that they depend on.
//!
//! The cache never changes a result, only the time that it takes. Entries that cannot be read are computed again, and
//! entries that cannot be written are skipped.

use crate::failpoints;
use crate::wire::versions::versions;
use cairn_core::input::params::Params;
use cairn_core::input::scene::Scene;
use cairn_core::report::bake::Bake;
use cairn_core::stages::cache::{self, CachedFill, FillInputs};
use etcetera::BaseStrategy;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Total size of all entries, bytes. The oldest are removed first.
const MOST: usize = 2 << 30;
/// Largest entry, bytes.
const LARGEST: usize = 256 << 20;

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
    pub fn found(&self) -> Option<(&Path, usize, usize)> {
        let folder = self.folder.as_deref().filter(|folder| folder.is_dir())?;
        let (mut all, mut others) = (0, 0);
        let own = program();
        for entry in cacache::list_sync(folder).filter_map(Result::ok) {
            all += entry.size;
            others += if entry.key.split(' ').nth(1) == Some(&own) { 0 } else { entry.size };
        }
        Some((folder, all, others))
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

    fn read<T: DeserializeOwned>(&self, key: &str) -> Option<T> {
        let bytes = cacache::read_sync(self.folder.as_ref()?, key).ok()?;
        postcard::from_bytes(&bytes).ok()
    }

    fn write<T: Serialize>(&self, key: &str, value: &T) {
        let Some(folder) = &self.folder else { return };
        let Ok(bytes) = postcard::to_stdvec(value) else { return };
        if bytes.len() > LARGEST {
            return;
        }
        let written = failpoints::at("cache-write").is_ok() && write(folder, key, &bytes).is_ok();
        if written {
            trim(folder);
        }
    }
}

/// Writes an entry with its size, which the library's own `write_sync` leaves out: `trim` needs it.
fn write(folder: &Path, key: &str, bytes: &[u8]) -> cacache::Result<()> {
    let mut writer = cacache::WriteOpts::new().size(bytes.len()).open_sync(folder, key)?;
    let failed = |error| cacache::Error::IoError(error, format!("writing the entry {key}"));
    writer.write_all(bytes).map_err(failed)?;
    writer.commit().map(drop)
}

/// Removes files that killed processes were writing.
fn remove_unfinished(folder: &Path) {
    /// Far longer than writing takes.
    const LONGEST: Duration = Duration::from_secs(3600);
    for entry in folder.read_dir().into_iter().flatten().flatten() {
        let age = entry.metadata().and_then(|found| found.modified()).ok().and_then(|time| time.elapsed().ok());
        if age.is_some_and(|age| age > LONGEST) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
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
    Some(format!("{kind} {} {}", program(), hasher.finalize().to_hex()))
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
    remove_unfinished(&folder.join("tmp"));
    let mut entries: Vec<cacache::Metadata> = cacache::list_sync(folder).filter_map(Result::ok).collect();
    let mut total: usize = entries.iter().map(|entry| entry.size).sum();
    entries.sort_by_key(|entry| std::cmp::Reverse(entry.time));
    while total > MOST
        && let Some(oldest) = entries.pop()
    {
        total -= oldest.size;
        let _ = cacache::remove_sync(folder, &oldest.key);
        let _ = cacache::remove_hash_sync(folder, &oldest.integrity);
    }
}
