//! Reads input files, with a message for each kind of failure, and writes files complete or not at all. Long: all that
//! the package knows of paths is here.
//!
//! It must never know a message or a scene: paths, bytes and problems ([`problem`]) alone.
//!
//! Invariants: a file appears complete or not at all; each place that writes, syncs or renames can be made to fail
//! ([`failpoints`]).

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod failpoints;
pub mod fence;
pub mod problem;
pub mod version;

use crate::fence::Fence;
use crate::problem::{Problem, nearest};
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs::File;
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tempfile::NamedTempFile;

/// Largest input file, bytes (1 GiB). Real models are far smaller, and a wrong path must not fill the memory.
const LARGEST: u64 = 1 << 30;

/// Reads a whole file.
pub fn read(path: &Path) -> Result<Vec<u8>, Problem> {
    let fail = |what: &str, remedy: &str| Problem::at(path, what, remedy);
    if path.as_os_str().is_empty() {
        return Err(Problem::new("input", "a path is empty", "Name a file."));
    }
    let found = std::fs::metadata(path).map_err(|error| refused(path, &error))?;
    if found.is_dir() {
        return Err(fail("a folder, not a file", "Name a file in it."));
    }
    if !found.is_file() {
        return Err(fail("not a regular file", "Copy its content into a file."));
    }
    if found.len() > LARGEST {
        return Err(fail("larger than 1 GiB", "Export only the model itself."));
    }
    let bytes = std::fs::read(path).map_err(|error| refused(path, &error))?;
    if bytes.is_empty() { Err(fail("the file is empty", "Export it again.")) } else { Ok(bytes) }
}

fn refused(path: &Path, error: &std::io::Error) -> Problem {
    match error.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => Problem::at(path, "no such file", missing(path)),
        ErrorKind::PermissionDenied => Problem::at(path, "not readable by this user", "Change its permissions."),
        _ => Problem::at(path, format!("cannot be read: {error}"), "Check the path and the disk."),
    }
}

/// The remedy for a missing file.
fn missing(path: &Path) -> String {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(entries) = folder.read_dir() else {
        return format!("There is no folder {}.", folder.display());
    };
    let names: Vec<String> = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    let wanted = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    match nearest(&wanted, names.iter().map(String::as_str)) {
        Some(name) => format!("Did you mean {}?", path.with_file_name(name).display()),
        None => "Check the path. Paths in a scene file are relative to its folder.".into(),
    }
}

/// Where the files of a scene come from: a disk, or the uploads of a request.
pub trait FileSource: Send + Sync {
    fn read(&self, path: &Path) -> Result<Vec<u8>, Problem>;

    /// As `read`, for a file that a model names.
    fn read_beside(&self, _model: &Path, path: &Path) -> Result<Vec<u8>, Problem> {
        self.read(path)
    }

    /// The file that a model means by this path: the path itself, or the only one that differs from it in case alone.
    fn find(&self, path: &Path) -> Option<PathBuf>;

    /// What is said of a file that is not there, and the remedy.
    fn absence(&self) -> (&'static str, &'static str);

    /// Files that are there, and were asked for, and may not be read: see [`Fence`].
    fn refused(&self) -> Vec<Problem> {
        Vec::new()
    }

    /// Whether some files may not be read.
    fn is_fenced(&self) -> bool {
        false
    }
}

/// The files of this machine.
#[derive(Clone, Debug, Default)]
pub struct Disk {
    /// Files that lie elsewhere than the scene says, by their [`normalized`] paths there.
    ///
    /// Whoever fills this knows their content, so that no fence is between.
    pub moved: BTreeMap<PathBuf, PathBuf>,
    /// What may be read; `None`: all that this user may read.
    pub fence: Option<Arc<Fence>>,
}

impl Disk {
    fn fenced(&self, path: &Path, model: Option<&Path>) -> Result<Vec<u8>, Problem> {
        let moved = self.moved.get(&normalized(path));
        let is_known = || moved.is_some() || self.moved.values().any(|known| known == path);
        if let Some(fence) = self.fence.as_ref().filter(|_| !is_known()) {
            fence.admit(path, model)?;
        }
        read(moved.map_or(path, PathBuf::as_path))
    }
}

impl FileSource for Disk {
    fn read(&self, path: &Path) -> Result<Vec<u8>, Problem> {
        self.fenced(path, None)
    }

    fn read_beside(&self, model: &Path, path: &Path) -> Result<Vec<u8>, Problem> {
        self.fenced(path, Some(model))
    }

    fn refused(&self) -> Vec<Problem> {
        self.fence.as_ref().map_or_else(Vec::new, |fence| fence.refused())
    }

    fn is_fenced(&self) -> bool {
        self.fence.is_some()
    }

    fn find(&self, path: &Path) -> Option<PathBuf> {
        if let Some(found) = self.moved.get(&normalized(path)) {
            return Some(found.clone());
        }
        if path.is_file() {
            return Some(path.to_owned());
        }
        let mut found = PathBuf::new();
        for part in path.components() {
            let next = found.join(part);
            found = if !matches!(part, Component::Normal(_)) || next.exists() {
                next
            } else {
                let folder = if found.as_os_str().is_empty() { Path::new(".") } else { &found };
                let names = folder.read_dir().ok()?.flatten().map(|entry| entry.file_name());
                found.join(only_in_another_case(part.as_os_str(), names)?)
            };
        }
        found.is_file().then_some(found)
    }

    fn absence(&self) -> (&'static str, &'static str) {
        ("was not found", "Put it there, or export the model as one .glb file.")
    }
}

/// The only one of `names` that differs from `wanted` in case alone.
pub fn only_in_another_case<N: AsRef<OsStr>>(wanted: &OsStr, names: impl Iterator<Item = N>) -> Option<N> {
    let wanted = wanted.to_str()?.to_lowercase();
    let mut same = names.filter(|name| name.as_ref().to_str().is_some_and(|name| name.to_lowercase() == wanted));
    let first = same.next()?;
    same.next().is_none().then_some(first)
}

/// A path without `.` and, as far as it can be, without `..`: `a/../b` is `b`. Links are not followed.
pub fn normalized(path: &Path) -> PathBuf {
    let mut parts = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir if matches!(parts.components().next_back(), Some(Component::Normal(_))) => {
                parts.pop();
            }
            part => parts.push(part),
        }
    }
    parts
}

/// Whether a path is relative and has no `..`.
fn is_plain(path: &Path) -> bool {
    path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
}

/// The path of a file that a glTF file in `folder` names; `None` for a path that is not of the form which its reader
/// gives: relative, and `..` only in front.
pub fn beside(folder: &Path, relative: &str) -> Option<PathBuf> {
    let below = relative.trim_start_matches("../");
    let leads_away = below.is_empty() || below.contains(['\\', ':', '\0']) || !is_plain(Path::new(below));
    (!leads_away).then(|| folder.join(relative))
}

/// The way from a folder to a file or folder, as paths in files are written: `../kit/rock.usd`, `./rock.usd`. Where
/// there is none, as between drives, the whole path.
pub fn way(from: &Path, to: &Path) -> String {
    let whole = |path: &Path| {
        // The current folder is an empty path, too.
        let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
        normalized(&std::path::absolute(path).unwrap_or_else(|_| path.to_owned()))
    };
    let (from, to) = (whole(from), whole(to));
    let shared = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    let text = |part: Component| part.as_os_str().to_string_lossy().into_owned();
    if shared == 0 {
        return to.to_string_lossy().replace('\\', "/");
    }
    let up = from.components().skip(shared).map(|_| "..".to_owned());
    let parts: Vec<String> = up.chain(to.components().skip(shared).map(text)).collect();
    let way = parts.join("/");
    if way.starts_with("..") { way } else { format!("./{way}") }
}

/// A path below another one, as paths in files are written: see [`way`].
pub fn joined(folder: &str, path: &str) -> String {
    let path = path.replace('\\', "/");
    if folder.contains("://") {
        return format!("{}/{path}", folder.trim_end_matches('/'));
    }
    let whole = normalized(&Path::new(folder).join(&path)).to_string_lossy().replace('\\', "/");
    if whole.starts_with("..") || Path::new(&whole).is_absolute() { whole } else { format!("./{whole}") }
}

/// Whether a path is written as one below a folder. Links are not followed.
pub fn is_below(folder: &Path, path: &Path) -> bool {
    let relative = if folder == Path::new(".") { Some(path) } else { path.strip_prefix(folder).ok() };
    relative.is_some_and(is_plain)
}

/// Whether links in a path below a folder lead out of the folder.
pub fn leads_out(folder: &Path, path: &Path) -> bool {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    match (folder.canonicalize(), path.canonicalize()) {
        (Ok(folder), Ok(path)) => !path.starts_with(folder),
        _ => false,
    }
}

/// Extensions of the files that hold models.
const MODEL_EXTENSIONS: [&str; 6] = ["glb", "gltf", "usd", "usda", "usdc", "usdz"];

/// Extensions of the files of USD.
const USD_EXTENSIONS: [&str; 4] = ["usd", "usda", "usdc", "usdz"];

/// Whether a path names a file of USD, by its extension.
pub fn is_usd(path: &str) -> bool {
    let extension = path.rsplit_once('.').map_or("", |(_, extension)| extension);
    USD_EXTENSIONS.iter().any(|known| extension.eq_ignore_ascii_case(known))
}

/// Whether a path names a model, by its extension.
pub fn is_model_file(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    MODEL_EXTENSIONS.iter().any(|known| extension.eq_ignore_ascii_case(known))
}

/// `kit.glb#Brick` -> file and node, `kit.usd#/Kit/Brick` -> file and prim. A `#` elsewhere belongs to the file's name.
pub fn split_node(path: &str) -> (&str, Option<&str>) {
    let lower = path.to_ascii_lowercase();
    let ends = MODEL_EXTENSIONS.into_iter().filter_map(|extension| {
        let mark = format!(".{extension}#");
        lower.find(&mark).map(|at| at + mark.len())
    });
    match ends.min() {
        Some(end) => (&path[..end - 1], Some(&path[end..])),
        None => (path, None),
    }
}

/// Replaces the file at `path` by a complete one, or leaves it unchanged.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    sync_folder(folder_of(&Staged::write(path, bytes)?.publish()?))
}

/// A complete file under a temporary name. Dropping it removes it.
pub struct Staged {
    file: NamedTempFile,
    path: PathBuf,
}

impl Staged {
    pub fn write(path: &Path, bytes: &[u8]) -> std::io::Result<Staged> {
        failpoints::at("files-create")?;
        let mut file = new_file_in(folder_of(path))?;
        failpoints::write("files-write", &mut file, bytes)?;
        failpoints::at("files-sync")?;
        file.as_file().sync_all()?;
        Ok(Staged { file, path: path.to_owned() })
    }

    /// Gives the file its final name and returns that. Until the folder is synced, a power cut may undo this.
    pub fn publish(self) -> std::io::Result<PathBuf> {
        failpoints::at("files-rename")?;
        self.file.persist(&self.path)?;
        Ok(self.path)
    }
}

/// Prefix and suffix of the temporary names.
const UNFINISHED: [&str; 2] = [".cairn-", ".part"];
/// A younger file may not be locked yet.
const NEW: Duration = Duration::from_secs(60);

fn unfinished(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let is_unfinished = |name: &str| name.starts_with(UNFINISHED[0]) && name.ends_with(UNFINISHED[1]);
    let entries = folder.read_dir().into_iter().flatten().flatten();
    entries.filter(move |entry| is_unfinished(&entry.file_name().to_string_lossy())).map(|entry| entry.path())
}

/// Removes all temporary files of a folder that no other process uses.
pub fn remove_unfinished(folder: &Path) {
    unfinished(folder).for_each(|path| drop(std::fs::remove_file(path)));
}

/// Removes temporary files that no process is writing any more. Files being written are locked.
pub fn remove_abandoned(folder: &Path) {
    for path in unfinished(folder) {
        let age = |file: &File| file.metadata().ok()?.modified().ok()?.elapsed().ok();
        let is_abandoned = File::options()
            .append(true)
            .open(&path)
            .is_ok_and(|file| age(&file).is_some_and(|age| age > NEW) && file.try_lock().is_ok());
        if is_abandoned {
            let _ = std::fs::remove_file(path);
        }
    }
}

/// A file under a temporary name, which its writer gives its final name by `persist`.
pub fn new_file_in(folder: &Path) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(UNFINISHED[0]).suffix(UNFINISHED[1]);
    #[cfg(unix)]
    {
        // Temporary files are private by default, which would hide the result from the user's group.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let file = builder.tempfile_in(folder)?;
    // On a drive without locks, abandoned files cannot be recognized and stay.
    let _ = file.as_file().try_lock();
    Ok(file)
}

/// Makes the new and renamed files of a folder outlive a power cut.
pub fn sync_folder(folder: &Path) -> std::io::Result<()> {
    failpoints::at("files-sync-folder")?;
    // Other systems cannot open folders, and keep their changes themselves.
    if cfg!(not(unix)) {
        return Ok(());
    }
    match File::open(folder)?.sync_all() {
        // Some network drives cannot sync a folder, and need not.
        Err(error) if matches!(error.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => Ok(()),
        synced => synced,
    }
}

/// The system's text for an error, without names of files.
pub fn plain_reason(error: &std::io::Error) -> String {
    let inner = error.get_ref().and_then(|inner| inner.source()?.downcast_ref::<std::io::Error>());
    match inner.unwrap_or(error).raw_os_error() {
        Some(code) => std::io::Error::from_raw_os_error(code).to_string(),
        None => error.kind().to_string(),
    }
}

/// The folder that a file is in.
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::SystemTime;

    #[test]
    fn unlocked_old_files_are_abandoned() {
        let folder = tempfile::tempdir().unwrap();
        let part = |name: &str, age: u64| {
            let file = File::create(folder.path().join(name)).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(age)).unwrap();
            file
        };
        drop(part(".cairn-old.part", 3600));
        drop(part(".cairn-new.part", 1));
        drop(part("other.part", 3600));
        let held = part(".cairn-held.part", 3600);
        held.lock().unwrap();
        remove_abandoned(folder.path());
        let mut left: Vec<String> = folder
            .path()
            .read_dir()
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        left.sort();
        assert_eq!(left, [".cairn-held.part", ".cairn-new.part", "other.part"]);
    }

    #[test]
    fn files_being_written_are_locked() {
        let folder = tempfile::tempdir().unwrap();
        let staged = Staged::write(&folder.path().join("pile.glb"), b"pile").unwrap();
        let long_ago = SystemTime::now() - Duration::from_secs(3600);
        staged.file.as_file().set_modified(long_ago).unwrap();
        remove_abandoned(folder.path());
        let path = staged.publish().unwrap();
        assert_eq!(std::fs::read(path).unwrap(), b"pile");
    }

    #[test]
    fn files_are_found_in_another_case_where_one_alone_fits() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("Textures")).unwrap();
        std::fs::write(folder.path().join("Textures/Red.PNG"), "red").unwrap();
        let disk = Disk::default();
        let find = |name: &str| disk.find(&folder.path().join(name)).map(|path| std::fs::read(path).unwrap());
        for name in ["Textures/Red.PNG", "textures/red.png", "TEXTURES/RED.png", "none/../textures/red.png"] {
            assert_eq!(find(name).as_deref(), (!name.contains("none")).then_some(&b"red"[..]), "{name}");
        }
        assert_eq!(find("textures/blue.png"), None);
        assert_eq!(find("textures"), None);
        // Of two that fit as well, none is taken. Some disks cannot hold both.
        std::fs::write(folder.path().join("Textures/RED.png"), "other").unwrap();
        if std::fs::read(folder.path().join("Textures/Red.PNG")).unwrap() == b"red" {
            assert_eq!(find("textures/red.png"), None);
            assert_eq!(find("Textures/RED.png").as_deref(), Some(&b"other"[..]));
        }
    }

    #[test]
    fn paths_are_normalized() {
        for (path, expected) in [
            ("kit/gltf/../textures/a.png", "kit/textures/a.png"),
            ("../a/./b", "../a/b"),
            ("a/../../b", "../b"),
            ("/../a", "/../a"),
        ] {
            assert_eq!(normalized(Path::new(path)), Path::new(expected), "{path}");
        }
    }

    #[test]
    fn ways_lead_from_a_folder_to_a_file() {
        for (from, to, expected) in [
            ("show/shots", "show/kit/rock.usd", "../kit/rock.usd"),
            ("show", "show/kit/rock.usd", "./kit/rock.usd"),
            ("show/./a/..", "show/rock.usd", "./rock.usd"),
            ("a/b", "a", ".."),
            ("shots/a", "", "../.."),
            ("", "", "./"),
        ] {
            assert_eq!(way(Path::new(from), Path::new(to)), expected);
        }
        for (folder, path, expected) in [
            ("", "kit/rock.usd", "./kit/rock.usd"),
            ("./a", "../kit/rock.usd", "./kit/rock.usd"),
            ("..", "kit/rock.usd", "../kit/rock.usd"),
            ("/show", "kit/rock.usd", "/show/kit/rock.usd"),
            ("show://kit/", "rock.usd", "show://kit/rock.usd"),
        ] {
            assert_eq!(joined(folder, path), expected);
        }
    }

    #[test]
    fn a_node_follows_the_extension() {
        assert_eq!(split_node("kit.glb#Brick"), ("kit.glb", Some("Brick")));
        assert_eq!(split_node("a#b/kit.GLTF#Brick #2"), ("a#b/kit.GLTF", Some("Brick #2")));
        assert_eq!(split_node("a#b/kit.glb"), ("a#b/kit.glb", None));
        assert_eq!(split_node("kit.usdc#/Kit/Brick"), ("kit.usdc", Some("/Kit/Brick")));
    }
}
