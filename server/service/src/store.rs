//! The data directory. Long: all that touches its files. Files appear complete or not at all.
//!
//! ```text
//! lock                 held by the server that uses the directory
//! version              of this layout
//! assets/SHA256        one file per asset
//! owners/SHA256        who has uploaded it
//! bakes/ID/            spec.binpb, status.binpb, events.log, result.*, report.*, baked.postcard, textures/, assets/
//! partial/             files being written
//! cache/               fills and bakes for reuse
//! clock                the time by which entries age
//! ```
//!
//! A bake has its assets as hard links, so that they may be removed from `assets/` at any time, and the bake can still
//! give its result in further formats.

mod limits;
#[cfg(test)]
mod tests;

use crate::accounts::Account;
use crate::asset_owners::AssetOwners;
use crate::config::Config;
use crate::folder::{ASSETS, EARLIER_PILE, EVENTS, PILE, REPORT, ResultKind, SPEC, is_laid_out, layout_name};
use crate::seal::{sealed, unsealed};
use crate::status::no_more_files;
use crate::store_clock::StoreClock;
use crate::worker_message::ResultHead;
use bytes::Bytes;
use cairn_export::{Format, SIDECAR_FOLDER};
use cairn_files::failpoints;
use cairn_files::{Staged, remove_unfinished, sync_folder, write_atomically};
use cairn_wire::digest::hex;
use cairn_wire::proto::{AnalysePileRequest, AssetReference, BakeSpec, BakeState, BakeStatus};
pub use limits::BakeKeeper;
use prost::Message;
use sha2::{Digest, Sha256};
use std::fs::{self, File, TryLockError};
use std::io::{ErrorKind, Read, Result};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use tempfile::{NamedTempFile, TempDir};
use tracing::{info, warn};

const STATUS: &str = "status.binpb";
/// The folder of the cache.
const CACHE: &str = "cache";

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
    pub owners: Arc<AssetOwners>,
    clock: StoreClock,
    lock: File,
}

/// What is said while the directory is away.
pub const AWAY: &str = "it is away, or another folder is in its place";

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
        let assets = entries(&root.join("assets"), is_asset)?;
        let names = assets.iter().map(|kept| (kept.name(), kept.bytes));
        let owners = Arc::new(AssetOwners::open(root.join("owners"), names)?);
        let clock = StoreClock::open(&root.join("clock"), || {
            let bakes = entries(&root.join("bakes"), is_bake).unwrap_or_default();
            assets.iter().chain(&bakes).map(|kept| kept.used).max()
        });
        if let Err(error) = clock.save() {
            warn!(%error, "the time of the store could not be saved");
        }
        Ok(Store { root, most_bytes: config.store_bytes(), longest: config.store_time(), owners, clock, lock })
    }

    /// Whether the directory is the one that was opened. A disk or a network drive may be away for some time, and
    /// another folder in its place.
    pub fn is_here(&self) -> bool {
        let there = fs::metadata(self.root.join("lock"));
        there.and_then(|there| Ok(is_same(&there, &self.lock.metadata()?))).unwrap_or(false)
    }

    /// An error while the directory is away.
    fn check_here(&self) -> Result<()> {
        match self.is_here() {
            true => Ok(()),
            false => Err(std::io::Error::new(ErrorKind::NotConnected, AWAY)),
        }
    }

    /// Keeps the store's time for the next server.
    pub fn save_clock(&self) {
        if self.is_here()
            && let Err(error) = self.clock.save()
        {
            warn!(%error, "the time of the store could not be saved");
        }
    }

    /// Why the directory cannot be used, if so.
    pub fn fault(&self) -> Option<String> {
        if !self.is_here() {
            return Some(AWAY.into());
        }
        let tried = ["assets", "bakes"].iter().try_for_each(|folder| fs::metadata(self.root.join(folder)).map(drop));
        let tried = tried.and_then(|()| tempfile::tempfile_in(self.root.join("partial")));
        // That no handle is free is no fault of the directory.
        tried.err().filter(|error| !no_more_files(error)).map(|error| error.kind().to_string())
    }

    /// The folder of a bake.
    pub fn folder(&self, id: &str) -> PathBuf {
        self.root.join("bakes").join(id)
    }

    /// The cache of a project, or of what has none. A common one would show another project's work, since a bake from
    /// the cache has no stage of the fill.
    pub fn cache(&self, project: &str) -> PathBuf {
        let cache = self.root.join(CACHE);
        if project.is_empty() { cache } else { cache.join(blake3::hash(project.as_bytes()).to_hex().as_str()) }
    }

    /// An asset of a project, or of none. Who knows the hash of another project's asset does not have it by that.
    fn asset(&self, sha256: &str, project: &str) -> PathBuf {
        self.root.join("assets").join(asset_name(sha256, project))
    }

    /// Whether the store has an asset of a project. Marks it as used.
    pub fn has(&self, sha256: &str, project: &str) -> bool {
        self.mark_used(&self.asset(sha256, project)).is_ok()
    }

    /// Size of all that is kept of a bake.
    pub fn bake_bytes(&self, id: &str) -> u64 {
        Kept::of(self.folder(id)).map_or(0, |kept| kept.bytes)
    }

    pub fn upload(&self) -> Result<Upload> {
        failpoints::at("upload-create")?;
        self.check_here()?;
        let file = NamedTempFile::new_in(self.root.join("partial"))?;
        Ok(Upload { file, hasher: Sha256::new(), bytes: 0 })
    }

    /// Stores an upload of an account if its content has this hash. Returns whether it has.
    pub fn keep(&self, upload: Upload, sha256: &str, account: &Account) -> Result<bool> {
        if hex(&upload.hasher.finalize()) != sha256 {
            return Ok(false);
        }
        failpoints::at("upload-sync")?;
        self.check_here()?;
        upload.file.as_file().sync_all()?;
        failpoints::at("upload-rename")?;
        let (path, name) = (self.asset(sha256, &account.project), asset_name(sha256, &account.project));
        let is_new = self.owners.add(&name, account, upload.bytes)?;
        if let Err(error) = upload.file.persist(&path) {
            if is_new {
                self.owners.remove(&name);
            }
            return Err(error.into());
        }
        self.mark_used(&path)?;
        sync_folder(&self.root.join("assets"))?;
        Ok(true)
    }

    /// Stores a file of a bake as an asset of an account too, if its content has this hash. Returns whether it has.
    pub fn adopt(&self, file: &Path, sha256: &str, account: &Account) -> Result<bool> {
        self.check_here()?;
        let (hash, bytes) = digest_of(file)?;
        if hash != sha256 {
            return Ok(false);
        }
        let (path, name) = (self.asset(sha256, &account.project), asset_name(sha256, &account.project));
        let is_new = self.owners.add(&name, account, bytes)?;
        let linked = failpoints::at("store-link").and_then(|()| fs::hard_link(file, &path));
        if let Err(error) = linked
            && error.kind() != ErrorKind::AlreadyExists
        {
            if is_new {
                self.owners.remove(&name);
            }
            return Err(error);
        }
        self.mark_used(&path)?;
        sync_folder(&self.root.join("assets"))?;
        Ok(true)
    }

    /// Creates an empty folder for a bake, with its request and those of its assets that the store has.
    pub fn prepare(&self, id: &str, spec: &BakeSpec, project: &str) -> Result<PathBuf> {
        self.remove(id)?;
        let folder = self.folder(id);
        // Not the folders above: where the disk is away, they must not appear.
        fs::create_dir(&folder)?;
        self.fill(&folder, &spec.assets, project)?;
        // Its name outlives a power cut once the status does.
        Staged::write(&folder.join(SPEC), &sealed(spec.encode_to_vec()))?.publish()?;
        Ok(folder)
    }

    /// Saves that a bake is accepted. From now on, a power cut does not undo it.
    pub fn keep_accepted(&self, status: &BakeStatus) -> Result<()> {
        self.write_status(status)?;
        sync_folder(&self.root.join("bakes"))
    }

    /// The request of a bake.
    pub fn spec(&self, id: &str) -> Result<BakeSpec> {
        Ok(BakeSpec::decode(Bytes::from(unsealed(fs::read(self.folder(id).join(SPEC))?)?))?)
    }

    /// The saved status of a bake; `None` if it is missing or damaged.
    pub fn status(&self, id: &str) -> Result<Option<BakeStatus>> {
        match fs::read(self.folder(id).join(STATUS)) {
            Ok(bytes) => {
                let status = unsealed(bytes).ok().and_then(|bytes| BakeStatus::decode(Bytes::from(bytes)).ok());
                Ok(status.filter(|status| status.bake_id == id))
            }
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// The damage of a bake that has succeeded, found by the sizes of its files. What cannot be known now is an error.
    pub fn damage(&self, status: &BakeStatus, result_bytes: i64) -> Result<Option<String>> {
        if status.state() != BakeState::Succeeded {
            return Ok(None);
        }
        let folder = self.folder(&status.bake_id);
        let has = |name: &str, bytes: i64| match fs::metadata(folder.join(name)) {
            Ok(file) => Ok(file.len() as i64 == bytes),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(false),
            Err(error) => Err(error),
        };
        let mut results =
            Format::ALL.into_iter().map(|format| has(&ResultKind::of(format).result_name(), result_bytes));
        let damage = if !has(EVENTS, status.event_bytes)? {
            "its events are truncated or missing"
        } else if !results.try_fold(false, |any, has| Ok::<bool, std::io::Error>(any || has?))? {
            "its result is truncated or missing"
        } else {
            return Ok(None);
        };
        self.check_here()?;
        Ok(Some(damage.into()))
    }

    /// A temporary folder for a plan.
    pub fn prepare_plan(&self, spec: &BakeSpec, project: &str) -> Result<TempDir> {
        self.check_here()?;
        let folder = TempDir::new_in(self.root.join("partial"))?;
        self.fill(folder.path(), &spec.assets, project)?;
        write_passing(&folder.path().join(SPEC), &sealed(spec.encode_to_vec()))?;
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
        self.check_here()?;
        let folder = TempDir::new_in(self.root.join("partial"))?;
        self.fill(folder.path(), if result.is_some() { &[] } else { &request.assets }, project)?;
        write_passing(&folder.path().join(SPEC), &sealed(request.encode_to_vec()))?;
        if let (Some(result), Some(asset)) = (result, request.assets.first()) {
            fs::hard_link(result, folder.path().join(ASSETS).join(&asset.sha256))?;
        }
        Ok(folder)
    }

    /// Gives a folder those of these assets that the store has.
    fn fill(&self, folder: &Path, assets: &[AssetReference], project: &str) -> Result<()> {
        failpoints::at("store-folder")?;
        fs::create_dir(folder.join(ASSETS))?;
        for asset in assets {
            let from = self.asset(&asset.sha256, project);
            failpoints::at("store-link")?;
            match fs::hard_link(&from, folder.join(ASSETS).join(&asset.sha256)) {
                Ok(()) => self.mark_used(&from)?,
                // The worker reports missing assets, and one asset may have several names.
                Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::AlreadyExists) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    pub fn write_status(&self, status: &BakeStatus) -> Result<()> {
        let path = self.folder(&status.bake_id).join(STATUS);
        write_atomically(&path, &sealed(status.encode_to_vec()))?;
        self.mark_used(&path)
    }

    /// What describes a bake's result, if it was made.
    pub fn head(&self, id: &str, kind: &ResultKind) -> Result<Option<ResultHead>> {
        match fs::read(self.folder(id).join(kind.head_name())) {
            Ok(bytes) => Ok(unsealed(bytes).ok().and_then(|bytes| ResultHead::decode(Bytes::from(bytes)).ok())),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Keeps a layout of a bake's results in USD, and marks it as used. Of many, those go that were not used for
    /// longest, with their results: they are made again when somebody asks.
    pub fn keep_layout(&self, id: &str, layout: &str, request: &[u8]) -> Result<()> {
        /// Each may have three results.
        const MOST: usize = 32;
        let (folder, name) = (self.folder(id), layout_name(layout));
        let path = folder.join(&name);
        if !path.is_file() {
            write_atomically(&path, &sealed(request.to_vec()))?;
        }
        self.mark_used(&path)?;
        let (first, last) = name.split_once(layout).unwrap_or_default();
        let files: Vec<PathBuf> = fs::read_dir(&folder)?.flatten().map(|entry| entry.path()).collect();
        let name_of = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let layout_of = |path: &PathBuf| {
            let layout = name_of(path).strip_prefix(first)?.strip_suffix(last)?.to_owned();
            Some((fs::metadata(path).and_then(|file| file.modified()).ok()?, layout))
        };
        let mut known: Vec<(SystemTime, String)> = files.iter().filter_map(layout_of).collect();
        known.sort();
        known.retain(|(_, known)| known != layout);
        for (_, oldest) in known.iter().take((known.len() + 1).saturating_sub(MOST)) {
            info!(bake_id = id, layout = oldest, "a layout that was not used for longest goes, with its results");
            for file in files.iter().filter(|file| name_of(file).contains(oldest)) {
                fs::remove_file(file)?;
            }
        }
        Ok(())
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
        let _ = self.mark_used(&self.folder(id).join(STATUS));
    }

    fn mark_used(&self, path: &Path) -> Result<()> {
        File::options().append(true).open(path)?.set_modified(self.clock.now())
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
        self.take_away(id).map(drop)
    }

    /// Takes a bake out of the store at once. Its files go when what is returned is dropped, which takes a while.
    pub fn take_away(&self, id: &str) -> Result<Option<TempDir>> {
        failpoints::at("store-remove")?;
        self.check_here()?;
        let folder = self.folder(id);
        if !folder.exists() {
            return Ok(None);
        }
        let away = TempDir::new_in(self.root.join("partial"))?;
        match fs::rename(&folder, away.path().join(id)) {
            Err(error) if error.kind() == ErrorKind::CrossesDevices => fs::remove_dir_all(&folder)?,
            moved => moved?,
        }
        Ok(Some(away))
    }
}

/// Writes a file that no power cut needs to spare.
fn write_passing(path: &Path, bytes: &[u8]) -> Result<()> {
    failpoints::at("files-create")?;
    failpoints::write("files-write", &mut File::create(path)?, bytes)
}

/// The SHA-256 of a file, and its size.
fn digest_of(file: &Path) -> Result<(String, u64)> {
    let (mut file, mut hasher, mut buffer, mut bytes) = (File::open(file)?, Sha256::new(), vec![0; 1 << 16], 0);
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok((hex(&hasher.finalize()), bytes)),
            read => {
                hasher.update(&buffer[..read]);
                bytes += read as u64;
            }
        }
    }
}

/// The name of an asset's file.
fn asset_name(sha256: &str, project: &str) -> String {
    match project {
        "" => sha256.to_owned(),
        _ => format!("{sha256}-{}", blake3::hash(project.as_bytes()).to_hex()),
    }
}

/// The entries of a folder that are ours.
fn entries(folder: &Path, is_ours: fn(&Path) -> bool) -> Result<Vec<Kept>> {
    // An entry may be removed meanwhile.
    let paths = fs::read_dir(folder)?.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| is_ours(path));
    Ok(paths.filter_map(|path| Kept::of(path).ok()).collect())
}

#[cfg(unix)]
fn is_same(one: &fs::Metadata, other: &fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

#[cfg(not(unix))]
fn is_same(_: &fs::Metadata, _: &fs::Metadata) -> bool {
    true
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

    fn name(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }
}
