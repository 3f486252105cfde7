//! Output files of commands: checked before any work, written complete or not at all.

use super::{Failure, interrupt};
use cairn_export::{Encoded, SIDECAR_FOLDER};
use cairn_files::Staged;
use cairn_files::failpoints;
use cairn_files::problem::Problem;
use cairn_job::machine;
use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::MutexGuard;

/// The kind of destination that a path names.
enum Destination {
    /// The path is `-`.
    Stdout,
    /// A FIFO or a device.
    Stream,
    /// An existing or a new file; links are resolved.
    File(PathBuf),
}

/// Whether a path means the standard output.
pub fn is_stdout(path: &Path) -> bool {
    path == Path::new("-")
}

impl Destination {
    fn to(path: &Path) -> Destination {
        /// Longest chain of links, as in operating systems.
        const MOST_LINKS: usize = 40;
        if is_stdout(path) {
            return Destination::Stdout;
        }
        if std::fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir()) {
            return Destination::Stream;
        }
        let mut path = path.to_owned();
        for _ in 0..MOST_LINKS {
            let Ok(target) = path.read_link() else { break };
            path = cairn_files::folder_of(&path).join(target);
        }
        Destination::File(path)
    }
}

/// Checks that a file can be written to this path and would not replace an input. Removes temporary files of killed
/// commands beside it.
pub fn check(path: &Path, inputs: &[PathBuf]) -> Result<(), Failure> {
    let refuse = |what: String, remedy: &str| Err(Failure::input(Problem::at(path, what, remedy)));
    if path.is_dir() {
        return refuse("a folder, not a file".into(), "Name a file in it.");
    }
    let Destination::File(target) = Destination::to(path) else { return Ok(()) };
    let folder = cairn_files::folder_of(&target);
    cairn_files::remove_abandoned(folder);
    if !folder.is_dir() {
        return refuse(format!("there is no folder {}", folder.display()), "Create it first.");
    }
    if let Err(error) = failpoints::at("output-folder").and_then(|()| tempfile::tempfile_in(folder).map(drop)) {
        let reason = cairn_files::plain_reason(&error);
        return refuse(format!("nothing can be written in {}: {reason}", folder.display()), "Choose another folder.");
    }
    match std::fs::metadata(&target) {
        Ok(found) if found.permissions().readonly() => {
            return refuse("the file is read-only".into(), "Make it writable, or choose another name.");
        }
        // The name is too long, or has characters that the disk refuses.
        Err(error) if error.kind() != ErrorKind::NotFound => {
            let reason = cairn_files::plain_reason(&error);
            return refuse(format!("no file can have this name: {reason}"), "Choose a shorter, plain name.");
        }
        _ => {}
    }
    let own = target.canonicalize().ok();
    if own.is_some() && inputs.iter().any(|input| input.canonicalize().ok() == own) {
        return refuse("the scene reads this file".into(), "Choose another name for the result.");
    }
    Ok(())
}

/// Checks that a result of this expected size at most, or results of this size together, in bytes, has room where it
/// will be written. A larger one that has none is not lost: the cache keeps the bake.
pub fn check_room(path: &Path, most: u64) -> Result<(), Failure> {
    let Destination::File(target) = Destination::to(path) else { return Ok(()) };
    let folder = cairn_files::folder_of(&target);
    let free = match failpoints::at("output-room") {
        Ok(()) => machine::free_disk(folder),
        Err(_) => Some(0),
    };
    match free {
        Some(free) if free < most => {
            let mib = |bytes: u64| bytes.div_ceil(1 << 20);
            let what = format!(
                "up to {} MiB are expected, but the disk of {} has {} MiB left",
                mib(most),
                folder.display(),
                mib(free)
            );
            Err(Failure::input(Problem::at(path, what, "Make room there, or write elsewhere.")))
        }
        _ => Ok(()),
    }
}

/// Checks that a result can have sidecars: it must be a file, and the folder of the sidecars usable.
pub fn check_sidecars(output: &Path) -> Result<(), Failure> {
    let usage = |place: &Path, what: &str, remedy: &str| Err(Failure::Usage(vec![Problem::at(place, what, remedy)]));
    if !matches!(Destination::to(output), Destination::File(_)) {
        let what = "its textures would be files beside it, but this is not a file";
        return usage(output, what, "Use --format usdz, which holds everything.");
    }
    let folder = cairn_files::folder_of(output).join(SIDECAR_FOLDER);
    if folder.exists() && !folder.is_dir() {
        return usage(
            &folder,
            "not a folder, but the result needs a folder of this name for its textures",
            "Rename it, or write elsewhere.",
        );
    }
    Ok(())
}

/// Writes to a path. A file appears complete or not at all.
pub fn write(path: &Path, content: &[u8]) -> Result<(), Failure> {
    let written = match Destination::to(path) {
        Destination::File(target) => cairn_files::write_atomically(&target, content),
        way => write_through(way, path, content),
    };
    written.map_err(|error| Failure::write(path, &error))
}

/// Writes to a destination that is not a file.
fn write_through(way: Destination, path: &Path, content: &[u8]) -> std::io::Result<()> {
    if let Destination::Stdout = way {
        let mut stdout = std::io::stdout().lock();
        return failpoints::write("stdout-write", &mut stdout, content).and_then(|()| stdout.flush());
    }
    let mut stream = File::options().write(true).open(path)?;
    failpoints::write("stream-write", &mut stream, content)
}

/// Writes a result before its report, and removes an old report, which describes another result. The
/// sidecars are written first.
pub fn write_before_report(output: &Path, result: &Encoded, report: Option<&Path>) -> Result<(), Failure> {
    let _guard = begin()?;
    write_sidecars(output, result)?;
    write(output, &result.bytes)?;
    let Some((path, Destination::File(old))) = report.map(|path| (path, Destination::to(path))) else { return Ok(()) };
    match std::fs::remove_file(old) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(Failure::write(path, &error)),
        _ => Ok(()),
    }
}

fn write_sidecars(output: &Path, result: &Encoded) -> Result<(), Failure> {
    let folder = cairn_files::folder_of(output).join(SIDECAR_FOLDER);
    result.write_sidecars(output).map_err(|error| Failure::write(&folder, &error))
}

/// Delays the end of the process while the guard lives. Fails if the command is cancelled already.
pub fn begin() -> Result<MutexGuard<'static, ()>, Failure> {
    let guard = interrupt::shield();
    if interrupt::is_requested() { Err(Failure::Cancelled) } else { Ok(guard) }
}

/// Writes both result and report, or neither. The sidecars are written first.
pub fn write_result(output: &Path, result: &Encoded, report: Option<(&Path, String)>) -> Result<(), Failure> {
    let _guard = begin()?;
    write_sidecars(output, result)?;
    // Stage all files before any gets its name: if the disk is full, existing files stay.
    let (mut files, mut streams) = (Vec::new(), Vec::new());
    let parts = report.iter().map(|(path, text)| (*path, text.as_bytes())).chain([(output, &*result.bytes)]);
    for (path, content) in parts {
        match Destination::to(path) {
            Destination::File(target) => {
                files.push((path, Staged::write(&target, content).map_err(|error| Failure::write(path, &error))?));
            }
            way => streams.push((way, path, content)),
        }
    }
    for (way, path, content) in streams {
        write_through(way, path, content).map_err(|error| Failure::write(path, &error))?;
    }
    let mut named = Vec::new();
    for (path, file) in files {
        named.push(file.publish().map_err(|error| {
            // A report without its result would mislead.
            named.iter().for_each(|before: &PathBuf| drop(std::fs::remove_file(before)));
            Failure::write(path, &error)
        })?);
    }
    for path in named {
        cairn_files::sync_folder(cairn_files::folder_of(&path)).map_err(|error| Failure::write(&path, &error))?;
    }
    Ok(())
}
