//! Files in one zip, with the same bytes everywhere: it holds no time of its writing.

use std::io::{Cursor, Error, Result, Write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// The archive of these files, by name and content, in their order.
pub fn zip<'f>(method: CompressionMethod, files: impl IntoIterator<Item = (&'f str, &'f [u8])>) -> Result<Vec<u8>> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(method);
    for (name, content) in files {
        archive.start_file(name, options).map_err(Error::other)?;
        archive.write_all(content)?;
    }
    Ok(archive.finish().map_err(Error::other)?.into_inner())
}
