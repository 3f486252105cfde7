//! What can be given to the crate's readers, which trust what they read: files without damage, and no larger than they
//! look.

use super::{CRATE, TEXT, ZIP, binary};
use std::io::{Cursor, Read};

pub const DAMAGED: &str = "it is damaged, or no USD";
/// Levels of brackets in a text.
const MOST_BRACKETS: usize = 256;
/// What a text may have of opening braces, one for each prim; a small text may have more.
const BYTES_OF_A_BRACE: usize = 64;
const FEW_BRACES: usize = 10_000;
/// Bytes of a file in a package.
const MOST_PACKED: u64 = 1 << 30;
/// Words in one prim: a property has two or more, and for each the reader looks through all others.
const MOST_WORDS: usize = 50_000;

/// Whether a layer can be given to the crate's readers.
pub fn is_sound(bytes: &[u8]) -> bool {
    if bytes.starts_with(CRATE) { binary::is_sound(bytes) } else { check_text(bytes).is_ok() }
}

/// Refuses a text that is none of USD, or has more levels, prims and properties than a reader has room for.
fn check_text(bytes: &[u8]) -> Result<(), String> {
    let (mut braces, mut most_words) = (0, 0);
    // The open brackets, each with the words in it.
    let mut open = vec![(b'{', 0_usize)];
    let mut before = b'\n';
    for &byte in bytes {
        match byte {
            b'{' | b'(' | b'[' if open.len() > MOST_BRACKETS => return Err(DAMAGED.into()),
            b'{' | b'(' | b'[' => {
                braces += usize::from(byte == b'{');
                open.push((byte, 0));
            }
            b'}' | b')' | b']' if open.len() > 1 => drop(open.pop()),
            b'a'..=b'z' | b'A'..=b'Z' | b'_' if before.is_ascii_whitespace() || before == b';' => {
                if let Some((b'{', words)) = open.last_mut() {
                    *words += 1;
                    most_words = most_words.max(*words);
                }
            }
            _ => {}
        }
        before = byte;
    }
    let most = FEW_BRACES + bytes.len() / BYTES_OF_A_BRACE;
    if braces > most {
        return Err(format!("it has more than {most} prims of few bytes: save it as .usdc"));
    }
    if most_words > MOST_WORDS {
        return Err(format!("one of its prims has more than {} properties: save it as .usdc", MOST_WORDS / 2));
    }
    let is_text = bytes.starts_with(TEXT) && std::str::from_utf8(bytes).is_ok();
    if is_text { Ok(()) } else { Err(DAMAGED.into()) }
}

/// Refuses what no reader has room for.
pub fn check_file(bytes: &[u8]) -> Result<(), String> {
    if bytes.starts_with(TEXT) { check_text(bytes) } else { check_package(bytes) }
}

/// Refuses a package whose files are compressed: they may unfold to any size, and USD forbids it.
fn check_package(bytes: &[u8]) -> Result<(), String> {
    if !bytes.starts_with(ZIP) {
        return Ok(());
    }
    let mut archive = open_package(bytes).ok_or(DAMAGED)?;
    for number in 0..archive.len() {
        let file = archive.by_index_raw(number).map_err(|_| DAMAGED)?;
        if file.compression() != zip::CompressionMethod::Stored || file.encrypted() {
            return Err(format!(
                "its file {} is compressed, which USD forbids in a .usdz: pack it without compression, as usdzip does",
                file.name()
            ));
        }
    }
    Ok(())
}

/// The archive that a package is.
pub fn open_package(package: &[u8]) -> Option<zip::ZipArchive<Cursor<&[u8]>>> {
    zip::ZipArchive::new(Cursor::new(package)).ok()
}

/// A file of a package.
pub fn file_in(package: &[u8], name: &str) -> Option<Vec<u8>> {
    let mut archive = open_package(package)?;
    let file = archive.by_name(name).ok()?;
    let mut bytes = Vec::new();
    file.take(MOST_PACKED).read_to_end(&mut bytes).ok()?;
    Some(bytes)
}

/// The bytes of the first file of a package, which is not compressed.
pub fn first_layer(package: &[u8]) -> Option<Vec<u8>> {
    check_package(package).ok()?;
    file_in(package, &first_file(package)?)
}

/// The first file of a package: its layer.
pub fn first_file(package: &[u8]) -> Option<String> {
    let mut archive = open_package(package)?;
    let first = archive.by_index(0).ok()?;
    Some(first.name().to_owned())
}
