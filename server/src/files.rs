//! Reads input files, with a message for each way that this can fail.

use crate::problem::{Problem, nearest};
use std::io::ErrorKind;
use std::path::Path;

/// The whole file.
pub fn read(path: &Path) -> Result<Vec<u8>, Problem> {
    let name = path.display().to_string();
    if path.as_os_str().is_empty() {
        return Err(Problem::new("input", "a path is empty", "name a file"));
    }
    if path.is_dir() {
        return Err(Problem::new(name, "a folder, not a file", "name a file in it"));
    }
    match std::fs::read(path) {
        Ok(bytes) if bytes.is_empty() => Err(Problem::new(name, "the file is empty", "export it again")),
        Ok(bytes) => Ok(bytes),
        Err(error) => Err(match error.kind() {
            ErrorKind::NotFound => Problem::new(name, "no such file", missing(path)),
            ErrorKind::PermissionDenied => {
                Problem::new(name, "not readable by this user", "change its permissions")
            }
            _ => Problem::new(name, format!("cannot be read: {error}"), "check the disk"),
        }),
    }
}

/// What to do about a file that is not there.
fn missing(path: &Path) -> String {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(entries) = folder.read_dir() else {
        return format!("the folder {} does not exist either", folder.display());
    };
    let names: Vec<String> = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    let wanted = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    match nearest(&wanted, names.iter().map(String::as_str)) {
        Some(name) => format!("did you mean {}?", path.with_file_name(name).display()),
        None => "check the path; those in a scene file are relative to its folder".into(),
    }
}
