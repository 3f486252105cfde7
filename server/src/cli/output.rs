//! Files that a command writes: checked before any work, written complete or not at all.

use super::{Failure, interrupt};
use crate::files::{self, Staged};
use crate::model::export::{BESIDE, Encoded};
use crate::problem::Problem;
use crate::trouble;
use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// How what is written at a path gets there.
enum Way {
    /// The path is `-`.
    Stdout,
    /// A FIFO or a device: what is written goes through it.
    Stream,
    /// A file that is there, or will be; where links lead.
    File(PathBuf),
}

/// The path that stands for the standard output.
pub fn is_stdout(path: &Path) -> bool {
    path == Path::new("-")
}

impl Way {
    fn to(path: &Path) -> Way {
        /// Links after links, as systems follow them.
        const MOST_LINKS: usize = 40;
        if is_stdout(path) {
            return Way::Stdout;
        }
        if std::fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir()) {
            return Way::Stream;
        }
        let mut path = path.to_owned();
        for _ in 0..MOST_LINKS {
            let Ok(target) = path.read_link() else { break };
            path = files::folder_of(&path).join(target);
        }
        Way::File(path)
    }
}

/// Whether a file can appear at this path, and would not replace one of the inputs. What commands that were killed have left half
/// written beside it goes.
pub fn check(path: &Path, inputs: &[PathBuf]) -> Result<(), Failure> {
    let usage =
        |what: String, remedy: &str| Err(Failure::Usage(vec![Problem::new(path.display().to_string(), what, remedy)]));
    if path.is_dir() {
        return usage("a folder, not a file".into(), "Name a file in it.");
    }
    let Way::File(target) = Way::to(path) else { return Ok(()) };
    let folder = files::folder_of(&target);
    files::remove_abandoned(folder);
    if !folder.is_dir() {
        return usage(format!("there is no folder {}", folder.display()), "Make it first.");
    }
    if let Err(error) = tempfile::tempfile_in(folder) {
        return usage(format!("nothing can be written in {}: {error}", folder.display()), "Choose another folder.");
    }
    if std::fs::metadata(&target).is_ok_and(|found| found.permissions().readonly()) {
        return usage("the file is read-only".into(), "Make it writable, or choose another name.");
    }
    let own = target.canonicalize().ok();
    if own.is_some() && inputs.iter().any(|input| input.canonicalize().ok() == own) {
        return usage("the scene reads this file".into(), "Choose another name for the result.");
    }
    Ok(())
}

/// Whether a result can have files beside it: it is a file, and theirs have a folder.
pub fn check_beside(output: &Path, is_remote: bool) -> Result<(), Failure> {
    let usage = |place: &Path, what: &str, remedy: &str| {
        Err(Failure::Usage(vec![Problem::new(place.display().to_string(), what, remedy)]))
    };
    if is_remote {
        let what = "its pictures would be in files beside it, and a server gives one file";
        return usage(output, what, "End it in .usdz: that holds all.");
    }
    if !matches!(Way::to(output), Way::File(_)) {
        let what = "its pictures would be in files beside it, and this is no file";
        return usage(output, what, "Use --format usdz: that holds all.");
    }
    let folder = files::folder_of(output).join(BESIDE);
    if folder.exists() && !folder.is_dir() {
        return usage(&folder, "no folder, and the result's pictures would be in it", "Rename it, or write elsewhere.");
    }
    Ok(())
}

/// Writes a file, complete or not at all; or into what the path leads to.
pub fn write(path: &Path, content: &[u8]) -> Result<(), Failure> {
    let written = match Way::to(path) {
        Way::File(target) => files::write_atomically(&target, content),
        way => write_through(way, path, content),
    };
    written.map_err(|error| Failure::write(path, error))
}

/// Into what is no file.
fn write_through(way: Way, path: &Path, content: &[u8]) -> std::io::Result<()> {
    if let Way::Stdout = way {
        let mut stdout = std::io::stdout().lock();
        return trouble::write("stdout-write", &mut stdout, content).and_then(|()| stdout.flush());
    }
    let mut stream = File::options().write(true).open(path)?;
    trouble::write("stream-write", &mut stream, content)
}

/// Writes a result whose report is still to come. One that is there tells of another result, and goes. What the result names beside it
/// is there before it.
pub fn write_before_report(output: &Path, result: &Encoded, report: Option<&Path>) -> Result<(), Failure> {
    let _complete = interrupt::shield();
    if interrupt::asked() {
        return Err(Failure::Cancelled);
    }
    result.write_beside(output).map_err(|error| Failure::write(&files::folder_of(output).join(BESIDE), error))?;
    write(output, &result.bytes)?;
    let Some((path, Way::File(old))) = report.map(|path| (path, Way::to(path))) else { return Ok(()) };
    match std::fs::remove_file(old) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(Failure::write(path, error)),
        _ => Ok(()),
    }
}

/// Writes result and report: both or none.
pub fn write_result(output: &Path, result: &[u8], report: Option<(&Path, String)>) -> Result<(), Failure> {
    let _complete = interrupt::shield();
    if interrupt::asked() {
        return Err(Failure::Cancelled);
    }
    // All that takes room is on the disk before anything has its name: where there is none, what was there stays.
    let (mut files, mut streams) = (Vec::new(), Vec::new());
    let parts = report.iter().map(|(path, text)| (*path, text.as_bytes())).chain([(output, result)]);
    for (path, content) in parts {
        match Way::to(path) {
            Way::File(target) => {
                files.push((path, Staged::write(&target, content).map_err(|error| Failure::write(path, error))?));
            }
            way => streams.push((way, path, content)),
        }
    }
    for (way, path, content) in streams {
        write_through(way, path, content).map_err(|error| Failure::write(path, error))?;
    }
    let mut named = Vec::new();
    for (path, file) in files {
        named.push(file.publish().map_err(|error| {
            // A report of a result that is not there would mislead.
            named.iter().for_each(|before: &PathBuf| drop(std::fs::remove_file(before)));
            Failure::write(path, error)
        })?);
    }
    for path in named {
        files::sync_folder(files::folder_of(&path)).map_err(|error| Failure::write(&path, error))?;
    }
    Ok(())
}
