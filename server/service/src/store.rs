//! The data directory. Long: all that touches its files. Files appear complete or not at all.
//!
//! ```text
//! lock                 held by the server that uses the directory
//! version              of this layout
//! assets/SHA256        one file per asset
//! bakes/ID/            spec.binpb, status.binpb, events.log, result.*, report.*, baked.postcard, textures/, assets/
//! partial/             files being written
//! cache/               fills and bakes for reuse
//! ```
//!
//! A bake has its assets as hard links, so that they may be removed from `assets/` at any time, and the bake can still
//! give its result in further formats.

use crate::config::Config;
use crate::folder::{ASSETS, EARLIER_PILE, EVENTS, PILE, REPORT, ResultKind, SPEC, is_laid_out, layout_name};
use crate::status::no_more_files;
use crate::worker_message::ResultHead;
use bytes::Bytes;
use cairn_export::{Format, SIDECAR_FOLDER};
use cairn_files::failpoints;
use cairn_files::{remove_unfinished, sync_folder, write_atomically};
use cairn_wire::digest::hex;
use cairn_wire::proto::{AnalysePileRequest, AssetReference, BakeSpec, BakeState, BakeStatus};
use prost::Message;
use sha2::{Digest, Sha256};
use std::fs::{self, File, TryLockError};
use std::io::{ErrorKind, Result};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};
use tempfile::{NamedTempFile, TempDir};
use tracing::warn;

const STATUS: &str = "status.binpb";
/// The folder of the cache.
pub const CACHE: &str = "cache";

/// Version of the layout. A directory without one is of version 1, as the first servers made it.
const VERSION: u64 = 1;

/// Refuses a directory that a newer version has made, before anything in it changes, and writes the version into
/// others.
fn check_version(root: &Path) -> Result<()> {
    let path = root.join("version");
    let found = match fs::read_to_string(&path) {
        // A crash may have left it empty.
        Ok(text) if text.trim().is_empty() => VERSION,
        Ok(text) => text.trim().parse().unwrap_or(0),
        Err(error) if error.kind() == ErrorKind::NotFound => VERSION,
        Err(error) => return Err(error),
    };
    if found != VERSION {
        let what = format!(
            "its layout has the version {found}, and this server (cairn {}) knows {VERSION}: use the server that made \
             it, or another folder",
            cairn_files::version::VERSION
        );
        return Err(std::io::Error::new(ErrorKind::InvalidData, what));
    }
    if !path.is_file() {
        failpoints::at("store-version")?;
        fs::write(&path, format!("{VERSION}\n"))?;
    }
    Ok(())
}

/// An open data directory.
pub struct Store {
    root: PathBuf,
    most_bytes: u64,
    longest: Option<Duration>,
    _lock: File,
}

/// An unfinished upload.
pub struct Upload {
    file: NamedTempFile,
    hasher: Sha256,
    pub bytes: u64,
}

impl Store {
    /// Opens or creates a data directory, for this server alone.
    pub fn open(config: &Config) -> Result<Store> {
        let root = std::path::absolute(&config.data)?;
        failpoints::at("store-open")?;
        for folder in ["assets", "bakes"] {
            fs::create_dir_all(root.join(folder))?;
        }
        failpoints::at("store-lock")?;
        let lock = File::create(root.join("lock"))?;
        lock.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => {
                std::io::Error::new(ErrorKind::ResourceBusy, format!("{} is in use by another server", root.display()))
            }
            TryLockError::Error(error) => error,
        })?;
        check_version(&root)?;
        let _ = fs::remove_dir_all(root.join("partial"));
        fs::create_dir_all(root.join("partial"))?;
        Ok(Store { root, most_bytes: config.store_bytes(), longest: config.store_time(), _lock: lock })
    }

    /// Why the directory cannot be used, if so.
    pub fn fault(&self) -> Option<String> {
        let tried = ["assets", "bakes"].iter().try_for_each(|folder| fs::metadata(self.root.join(folder)).map(drop));
        let tried = tried.and_then(|()| tempfile::tempfile_in(self.root.join("partial")));
        // That no handle is free is no fault of the directory.
        tried.err().filter(|error| !no_more_files(error)).map(|error| error.kind().to_string())
    }

    /// The folder of a bake.
    pub fn folder(&self, id: &str) -> PathBuf {
        self.root.join("bakes").join(id)
    }

    /// An asset of a project, or of none. Who knows the hash of another project's asset does not have it by that.
    fn asset(&self, sha256: &str, project: &str) -> PathBuf {
        let assets = self.root.join("assets");
        match project {
            "" => assets.join(sha256),
            _ => assets.join(format!("{sha256}-{}", blake3::hash(project.as_bytes()).to_hex())),
        }
    }

    /// Whether the store has an asset of a project. Marks it as used.
    pub fn has(&self, sha256: &str, project: &str) -> bool {
        touch(&self.asset(sha256, project)).is_ok()
    }

    /// Size of all that is kept of a bake.
    pub fn bake_bytes(&self, id: &str) -> u64 {
        Kept::of(self.folder(id)).map_or(0, |kept| kept.bytes)
    }

    pub fn upload(&self) -> Result<Upload> {
        failpoints::at("upload-create")?;
        let file = NamedTempFile::new_in(self.root.join("partial"))?;
        Ok(Upload { file, hasher: Sha256::new(), bytes: 0 })
    }

    /// Stores an upload if its content has this hash. Returns whether it has.
    pub fn keep(&self, upload: Upload, sha256: &str, project: &str) -> Result<bool> {
        if hex(&upload.hasher.finalize()) != sha256 {
            return Ok(false);
        }
        failpoints::at("upload-sync")?;
        upload.file.as_file().sync_all()?;
        failpoints::at("upload-rename")?;
        upload.file.persist(self.asset(sha256, project))?;
        sync_folder(&self.root.join("assets"))?;
        Ok(true)
    }

    /// Creates an empty folder for a bake, with its request and those of its assets that the store has.
    pub fn prepare(&self, id: &str, spec: &BakeSpec, project: &str) -> Result<PathBuf> {
        self.remove(id)?;
        let folder = self.folder(id);
        self.fill(&folder, &spec.assets, spec, project)?;
        sync_folder(&self.root.join("bakes"))?;
        Ok(folder)
    }

    /// The request of a bake.
    pub fn spec(&self, id: &str) -> Result<BakeSpec> {
        Ok(BakeSpec::decode(Bytes::from(fs::read(self.folder(id).join(SPEC))?))?)
    }

    /// The saved status of a bake; `None` if it is missing or damaged.
    pub fn status(&self, id: &str) -> Result<Option<BakeStatus>> {
        match fs::read(self.folder(id).join(STATUS)) {
            Ok(bytes) => Ok(BakeStatus::decode(Bytes::from(bytes)).ok().filter(|status| status.bake_id == id)),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// The damage of a bake that has succeeded, found by the sizes of its files.
    pub fn damage(&self, status: &BakeStatus, result_bytes: i64) -> Option<String> {
        if status.state() != BakeState::Succeeded {
            return None;
        }
        let folder = self.folder(&status.bake_id);
        let has = |name: &str, bytes: i64| fs::metadata(folder.join(name)).is_ok_and(|file| file.len() as i64 == bytes);
        if !has(EVENTS, status.event_bytes) {
            Some("its events are truncated or missing".into())
        } else if !Format::ALL.into_iter().any(|format| has(&ResultKind::of(format).result_name(), result_bytes)) {
            Some("its result is truncated or missing".into())
        } else {
            None
        }
    }

    /// A temporary folder for a plan.
    pub fn prepare_plan(&self, spec: &BakeSpec, project: &str) -> Result<TempDir> {
        let folder = TempDir::new_in(self.root.join("partial"))?;
        self.fill(folder.path(), &spec.assets, spec, project)?;
        Ok(folder)
    }

    /// Creates a folder for an analysis, with its request and those of its assets that the store has. `result`: a file
    /// of a bake, which is its only asset. Dropping it deletes it.
    pub fn prepare_analysis(
        &self,
        request: &AnalysePileRequest,
        result: Option<&Path>,
        project: &str,
    ) -> Result<TempDir> {
        let folder = TempDir::new_in(self.root.join("partial"))?;
        self.fill(folder.path(), if result.is_some() { &[] } else { &request.assets }, request, project)?;
        if let (Some(result), Some(asset)) = (result, request.assets.first()) {
            fs::hard_link(result, folder.path().join(ASSETS).join(&asset.sha256))?;
        }
        Ok(folder)
    }

    fn fill(&self, folder: &Path, assets: &[AssetReference], request: &impl Message, project: &str) -> Result<()> {
        failpoints::at("store-folder")?;
        fs::create_dir_all(folder.join(ASSETS))?;
        for asset in assets {
            let from = self.asset(&asset.sha256, project);
            failpoints::at("store-link")?;
            match fs::hard_link(&from, folder.join(ASSETS).join(&asset.sha256)) {
                Ok(()) => touch(&from)?,
                // The worker reports missing assets, and one asset may have several names.
                Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::AlreadyExists) => {}
                Err(error) => return Err(error),
            }
        }
        write_atomically(&folder.join(SPEC), &request.encode_to_vec())
    }

    pub fn write_status(&self, status: &BakeStatus) -> Result<()> {
        write_atomically(&self.folder(&status.bake_id).join(STATUS), &status.encode_to_vec())
    }

    /// What describes a bake's result, if it was made.
    pub fn head(&self, id: &str, kind: &ResultKind) -> Result<Option<ResultHead>> {
        match fs::read(self.folder(id).join(kind.head_name())) {
            Ok(bytes) => Ok(ResultHead::decode(Bytes::from(bytes)).ok()),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Keeps a layout of a bake's results in USD. `false`: it has too many of them.
    pub fn keep_layout(&self, id: &str, layout: &str, request: &[u8]) -> Result<bool> {
        /// Each may have three results.
        const MOST: usize = 32;
        let (folder, name) = (self.folder(id), layout_name(layout));
        if folder.join(&name).is_file() {
            return Ok(true);
        }
        let (first, last) = name.split_once(layout).unwrap_or_default();
        let known = fs::read_dir(&folder)?.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
        if known.filter(|known| known.starts_with(first) && known.ends_with(last)).count() >= MOST {
            return Ok(false);
        }
        write_atomically(&folder.join(name), request)?;
        Ok(true)
    }

    /// Removes the files that an ended bake no longer needs: temporary files, and of one without a result assets and
    /// what there is of the result.
    pub fn tidy(&self, status: &BakeStatus) {
        let folder = self.folder(&status.bake_id);
        remove_unfinished(&folder);
        if status.state() != BakeState::Succeeded {
            for name in [ASSETS, SIDECAR_FOLDER] {
                let _ = fs::remove_dir_all(folder.join(name));
            }
            let of_format = |format| {
                let kind = ResultKind::of(format);
                [kind.result_name(), kind.report_name(), kind.head_name()]
            };
            let files = fs::read_dir(&folder).into_iter().flatten().flatten();
            for file in files.filter(|file| is_laid_out(&file.file_name().to_string_lossy())) {
                let _ = fs::remove_file(file.path());
            }
            let others = [REPORT, PILE, EARLIER_PILE].map(str::to_owned);
            for name in Format::ALL.into_iter().flat_map(of_format).chain(others) {
                let _ = fs::remove_file(folder.join(name));
            }
        }
    }

    /// Marks a bake as used.
    pub fn touch(&self, id: &str) {
        let _ = touch(&self.folder(id).join(STATUS));
    }

    /// Loads the status of all bakes. Removes bake folders without one, and leaves other files alone.
    pub fn load(&self) -> Result<Vec<BakeStatus>> {
        let mut found = Vec::new();
        for entry in fs::read_dir(self.root.join("bakes"))? {
            let folder = entry?.path();
            if !is_bake(&folder) {
                warn!(path = %folder.display(), "not a bake; leaving it alone");
                continue;
            }
            let id = folder.file_name().unwrap_or_default().to_string_lossy();
            match self.status(&id) {
                Ok(Some(status)) => found.push(status),
                Ok(None) => {
                    if let Err(error) = fs::remove_dir_all(&folder) {
                        warn!(path = %folder.display(), %error, "an incomplete bake could not be removed");
                    }
                }
                Err(error) => warn!(path = %folder.display(), %error, "a bake cannot be read; leaving it alone"),
            }
        }
        Ok(found)
    }

    pub fn remove(&self, id: &str) -> Result<()> {
        failpoints::at("store-remove")?;
        match fs::remove_dir_all(self.folder(id)) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
            _ => Ok(()),
        }
    }

    /// Removes entries that are too old, then the least recently used ones until the rest fits. `remove_bake` removes a
    /// bake unless it is unfinished, and returns whether it did. Returns the remaining bytes.
    pub fn trim(&self, remove_bake: impl Fn(&str) -> Result<bool>) -> Result<u64> {
        let mut cached = bytes_below(&self.root.join(CACHE));
        let mut entries = Vec::new();
        for (folder, is_ours) in [("assets", is_asset as fn(&Path) -> bool), ("bakes", is_bake)] {
            for entry in fs::read_dir(self.root.join(folder))? {
                // The entry may have been removed meanwhile.
                let path = entry.ok().map(|entry| entry.path()).filter(|path| is_ours(path));
                entries.extend(path.and_then(|path| Kept::of(path).ok()));
            }
        }
        entries.sort_by_key(|kept| kept.used);
        let mut total: u64 = entries.iter().map(|kept| kept.bytes).sum();
        if cached > 0 && total + cached > self.most_bytes {
            // Results are worth more than the cache, which only saves time.
            let _ = fs::remove_dir_all(self.root.join(CACHE));
            cached = 0;
        }
        total += cached;
        let oldest = self.longest.and_then(|longest| SystemTime::now().checked_sub(longest));
        for kept in entries {
            let too_old = oldest.is_some_and(|oldest| kept.used < oldest);
            if !too_old && total <= self.most_bytes {
                break;
            }
            let name = kept.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let removed = if kept.is_bake { remove_bake(&name) } else { fs::remove_file(&kept.path).map(|()| true) };
            // One failure does not protect the other entries.
            let is_gone = removed.unwrap_or_else(|error| {
                warn!(path = %kept.path.display(), %error, "an entry over the limits could not be removed");
                false
            });
            total -= if is_gone { kept.bytes } else { 0 };
        }
        Ok(total)
    }
}

impl Upload {
    pub fn write(&mut self, chunk: &[u8]) -> Result<()> {
        self.hasher.update(chunk);
        self.bytes += chunk.len() as u64;
        failpoints::write("upload-write", &mut self.file, chunk)
    }
}

/// Total size of the files below a folder.
fn bytes_below(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let bytes = entries.map(|entry| match entry.metadata() {
        Ok(found) if found.is_dir() => bytes_below(&entry.path()),
        Ok(found) => found.len(),
        Err(_) => 0,
    });
    bytes.sum()
}

/// Total size of the files of a folder that are elsewhere, too.
fn bytes_shared(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.metadata().ok()).filter(is_shared).map(|found| found.len()).sum()
}

#[cfg(unix)]
fn is_shared(file: &fs::Metadata) -> bool {
    std::os::unix::fs::MetadataExt::nlink(file) > 1
}

#[cfg(not(unix))]
fn is_shared(_: &fs::Metadata) -> bool {
    false
}

/// Whether a file's name is of hashes, as those of assets and bakes are. File managers and network drives put other
/// files here.
fn has_hashes(path: &Path, most: usize) -> bool {
    let is_hash = |name: &str| name.len() == 64 && name.bytes().all(|byte| byte.is_ascii_hexdigit());
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    name.split('-').count() <= most && name.split('-').all(is_hash)
}

fn is_asset(path: &Path) -> bool {
    has_hashes(path, 2) && path.is_file()
}

fn is_bake(path: &Path) -> bool {
    has_hashes(path, 1) && path.is_dir()
}

/// An asset or a bake, with the values that decide its removal.
struct Kept {
    path: PathBuf,
    is_bake: bool,
    bytes: u64,
    used: SystemTime,
}

impl Kept {
    fn of(path: PathBuf) -> Result<Kept> {
        let is_bake = path.is_dir();
        let mut used = fs::metadata(&path)?.modified()?;
        let bytes = if is_bake {
            used = fs::metadata(path.join(STATUS)).and_then(|status| status.modified()).unwrap_or(used);
            bytes_below(&path).saturating_sub(bytes_shared(&path.join(ASSETS)))
        } else {
            fs::metadata(&path)?.len()
        };
        Ok(Kept { path, is_bake, bytes, used })
    }
}

fn touch(path: &Path) -> Result<()> {
    File::options().append(true).open(path)?.set_modified(SystemTime::now())
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_wire::proto::BakeState;

    /// An id in the form of a bake's.
    fn id(name: &str) -> String {
        hex(&Sha256::digest(name))
    }

    fn bake(store: &Store, name: &str, bytes: usize, age: u64) {
        let id = &id(name);
        let folder = store.prepare(id, &BakeSpec::default(), "").unwrap();
        fs::write(folder.join("result.glb"), vec![0; bytes]).unwrap();
        let mut status = BakeStatus { bake_id: id.clone(), ..Default::default() };
        status.set_state(BakeState::Succeeded);
        store.write_status(&status).unwrap();
        let used = SystemTime::now() - Duration::from_secs(age);
        File::options().append(true).open(folder.join(STATUS)).unwrap().set_modified(used).unwrap();
    }

    fn names(store: &Store) -> Vec<String> {
        let mut names: Vec<String> = store.load().unwrap().into_iter().map(|status| status.bake_id).collect();
        names.sort();
        names
    }

    #[test]
    fn the_least_recently_used_is_removed_first() {
        let folder = tempfile::tempdir().unwrap();
        let config = Config { data: folder.path().join("data"), store_mib: 3, store_days: 1, ..Config::default() };
        let store = Store::open(&config).unwrap();
        for (name, age) in [("new", 0), ("older", 20), ("oldest", 30), ("at work", 40), ("past its days", 90_000)] {
            bake(&store, name, 1 << 20, age);
        }
        let remove = |bake: &str| Ok(bake != id("at work") && store.remove(bake).is_ok());
        let left = store.trim(remove).unwrap();
        let mut expected = [id("at work"), id("new")];
        expected.sort();
        assert_eq!(names(&store), expected);
        assert!((2 << 20..3 << 20).contains(&left), "{left}");
        store.touch(&id("at work"));
        assert_eq!(store.trim(remove).unwrap(), left);
    }

    #[test]
    fn a_bake_keeps_its_assets() {
        let folder = tempfile::tempdir().unwrap();
        let config = Config { data: folder.path().join("data"), store_mib: 0, ..Config::default() };
        let store = Store::open(&config).unwrap();
        let mut upload = store.upload().unwrap();
        upload.write(b"a prop").unwrap();
        let sha256 = hex(&Sha256::digest(b"a prop"));
        assert!(store.keep(upload, &sha256, "").unwrap() && store.has(&sha256, ""));
        assert!(!store.has(&sha256, "another project"));
        let asset = cairn_wire::proto::AssetReference { uri: "prop.glb".into(), sha256: sha256.clone() };
        let bake = store.prepare("bake", &BakeSpec { assets: vec![asset], ..Default::default() }, "").unwrap();
        store.trim(|_| Ok(false)).unwrap();
        assert!(!store.has(&sha256, ""));
        assert_eq!(fs::read(bake.join(ASSETS).join(sha256)).unwrap(), b"a prop");
        assert!(Store::open(&config).is_err(), "one server at a time");
    }
}
