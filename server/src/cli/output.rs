//! Files that a command writes: checked before any work, written complete or not at all.

use super::{Failure, interrupt};
use crate::files;
use crate::problem::Problem;
use std::path::{Path, PathBuf};

/// Whether a file can appear at this path, and would not replace one of the inputs.
pub fn check(path: &Path, inputs: &[PathBuf]) -> Result<(), Failure> {
    let usage =
        |what: String, remedy: &str| Err(Failure::Usage(vec![Problem::new(path.display().to_string(), what, remedy)]));
    if path.is_dir() {
        return usage("a folder, not a file".into(), "Name a file in it.");
    }
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    if !folder.is_dir() {
        return usage(format!("there is no folder {}", folder.display()), "Make it first.");
    }
    if let Err(error) = tempfile::tempfile_in(folder) {
        return usage(format!("nothing can be written in {}: {error}", folder.display()), "Choose another folder.");
    }
    let own = path.canonicalize().ok();
    if own.is_some() && inputs.iter().any(|input| input.canonicalize().ok() == own) {
        return usage("the scene reads this file".into(), "Choose another name for the result.");
    }
    Ok(())
}

/// Writes a file, complete or not at all.
pub fn write(path: &Path, content: &[u8]) -> Result<(), Failure> {
    files::write_atomically(path, content).map_err(|error| Failure::write(path, error))
}

/// Writes result and report: both or none.
pub fn write_result(output: &Path, result: &[u8], report: Option<(&Path, String)>) -> Result<(), Failure> {
    let _complete = interrupt::shield();
    if interrupt::asked() {
        return Err(Failure::Cancelled);
    }
    if let Some((path, text)) = &report {
        write(path, text.as_bytes())?;
    }
    write(output, result).inspect_err(|_| {
        if let Some((path, _)) = &report {
            // A report of a result that is not there would mislead.
            let _ = std::fs::remove_file(path);
        }
    })
}
