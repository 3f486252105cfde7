//! Reads input files, with a message for each way that this can fail.

use crate::problem::{Problem, nearest};
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};

/// Bytes of one input file, 1 GiB: no file of this trade comes near, and a wrong path must not fill the memory.
const LARGEST: u64 = 1 << 30;

/// The whole file.
pub fn read(path: &Path) -> Result<Vec<u8>, Problem> {
    let fail = |what: &str, remedy: &str| Problem::new(path.display().to_string(), what, remedy);
    if path.as_os_str().is_empty() {
        return Err(Problem::new("input", "a path is empty", "Name a file."));
    }
    let found = std::fs::metadata(path).map_err(|error| refused(path, &error))?;
    if found.is_dir() {
        return Err(fail("a folder, not a file", "Name a file in it."));
    }
    if !found.is_file() {
        return Err(fail("not a regular file", "Copy what it gives into a file."));
    }
    if found.len() > LARGEST {
        return Err(fail("larger than 1 GiB", "Export only the model itself."));
    }
    let bytes = std::fs::read(path).map_err(|error| refused(path, &error))?;
    if bytes.is_empty() { Err(fail("the file is empty", "Export it again.")) } else { Ok(bytes) }
}

fn refused(path: &Path, error: &std::io::Error) -> Problem {
    let name = path.display().to_string();
    match error.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => Problem::new(name, "no such file", missing(path)),
        ErrorKind::PermissionDenied => Problem::new(name, "not readable by this user", "Change its permissions."),
        _ => Problem::new(name, format!("cannot be read: {error}"), "Check the path and the disk."),
    }
}

/// What to do about a file that is not there.
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

/// A file that a glTF file names, as a path below the glTF file's own folder; `None` if it leads elsewhere.
pub fn below(folder: &Path, relative: &str) -> Option<PathBuf> {
    let is_plain = |path: &Path| path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    let leads_away = relative.is_empty() || relative.contains(['\\', ':', '\0']) || !is_plain(Path::new(relative));
    (!leads_away).then(|| folder.join(relative))
}
