//! The file of the lines: they come in their order, each whole; one that was cut off is taken away.

use cairn_files::failpoints;
use serde::Deserialize;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Result, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// The name of the file of all layouts, or of a part.
pub fn name(part: Option<(u64, u64)>) -> String {
    part.map_or("layouts.jsonl".into(), |(first, last)| format!("layouts-{first:06}-{last:06}.jsonl"))
}

pub struct LinesFile {
    path: PathBuf,
    file: File,
    next: u64,
    /// Of this run.
    pub spent: Spent,
}

/// What layouts took.
#[derive(Clone, Copy, Default)]
pub struct Spent {
    /// CPU time.
    pub seconds: f64,
    /// Layouts.
    pub made: u64,
    /// Peak of a process's memory, bytes.
    pub memory: Option<u64>,
    /// Collision shapes that were not in the cache: made by this process or by another one.
    pub new_shapes: usize,
}

#[derive(Deserialize)]
struct Numbered {
    layout: u64,
}

impl LinesFile {
    /// Opens the file behind its last whole line. `first`: the number of its first line.
    pub fn open(path: &Path, first: u64) -> Result<LinesFile> {
        failpoints::at("clutter-open")?;
        let mut file = OpenOptions::new().create(true).truncate(false).read(true).write(true).open(path)?;
        let (mut next, mut end) = (first, 0);
        let mut reader = BufReader::new(&file);
        let mut line = Vec::new();
        loop {
            line.clear();
            let length = reader.read_until(b'\n', &mut line)?;
            let is_whole = line.ends_with(b"\n");
            let is_next = serde_json::from_slice(&line).is_ok_and(|found: Numbered| found.layout == next);
            if !is_whole || !is_next {
                break;
            }
            (next, end) = (next + 1, end + length as u64);
        }
        file.set_len(end)?;
        file.seek(SeekFrom::Start(end))?;
        Ok(LinesFile { path: path.to_owned(), file, next, spent: Spent::default() })
    }

    /// The number of the next line.
    pub fn next(&self) -> u64 {
        self.next
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    pub fn write(&mut self, line: &str) -> Result<()> {
        failpoints::write("clutter-write", &mut self.file, format!("{line}\n").as_bytes())?;
        self.next += 1;
        Ok(())
    }
}
