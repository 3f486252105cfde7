//! The binary form of a layer, as every USD reads it.
//!
//! Corrects three faults in the output of openusd 0.6; the versions without these faults need a newer Rust than ours.
//!
//! - The names of children and properties are marked as an array of tokens, where USD looks for a vector of tokens, and
//!   finds nothing.
//! - Lists of 4 to 15 whole numbers are compressed, where USD compresses none that is shorter than 16, and reads them
//!   wrongly.
//! - The file states the newest version of the format, and programs refuse a version newer than their own.

mod values;

use openusd::sdf::{Data, Value};
use openusd::usdc::{CrateFile, CrateWriter};
use std::io::{Cursor, Error, Result};

/// The oldest version that has everything that our layers need. USD itself writes it.
const VERSION: [u8; 3] = [0, 8, 0];
/// Offsets in the header of the version, and of the offset of the table of contents.
const VERSION_AT: usize = 8;
const CONTENTS_AT: usize = 16;
/// Bytes of an entry of that table: a name, then start and size of a section.
const ENTRY: usize = 32;
const ENTRY_NAME: usize = 16;
/// Fields that are vectors of tokens, as the format calls them.
const VECTORS: [&str; 2] = ["primChildren", "properties"];
/// Eight bits are a value's kind, the lowest 48 its place in the file; two more bits mark arrays and compressed values.
const KIND: u64 = 0xff << 48;
const PLACE: u64 = (1 << 48) - 1;
const TOKEN_VECTOR: u64 = 41 << 48;
const ARRAY: u64 = 1 << 63;
const COMPRESSED: u64 = 1 << 61;
/// Elements of the shortest list that USD compresses.
pub const SHORTEST_COMPRESSED: usize = 16;

pub fn encode(data: &Data) -> Result<Vec<u8>> {
    let mut file = Cursor::new(Vec::new());
    CrateWriter::write(data, &mut file).map_err(Error::other)?;
    let mut bytes = file.into_inner();
    // Corrected values go to the end of the file, so that nothing else moves.
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    let mut added = Vec::new();
    let mut file = CrateFile::open(Cursor::new(&bytes[..])).map_err(Error::other)?;
    let entry = file.sections.iter().position(|section| section.name() == "FIELDS");
    let entry = entry.ok_or_else(|| Error::other("the layer has no fields"))?;
    let start = file.sections[entry].start as usize;
    let mut values = Vec::with_capacity(8 * file.fields.len());
    for field in std::mem::take(&mut file.fields) {
        let mut value = field.value_rep.0;
        if VECTORS.contains(&file.tokens[field.token_index].as_str()) {
            value = value & PLACE | TOKEN_VECTOR;
        } else if value & COMPRESSED != 0 && number(&bytes, (value & PLACE) as usize) < SHORTEST_COMPRESSED {
            let list = plain(&file.value(field.value_rep).map_err(Error::other)?)?;
            value = value & KIND | ARRAY | (bytes.len() + added.len()) as u64;
            added.extend(list);
            added.resize(added.len().next_multiple_of(8), 0);
        }
        values.extend(value.to_le_bytes());
    }

    // The section: the number of fields; the size of the list of their names, and that list; the values likewise.
    let which = start + 16 + number(&bytes, start + 8);
    let mut section = bytes[start..which].to_vec();
    // A compressed block of one part begins with a zero.
    let compressed = lz4_flex::compress(&values);
    section.extend((1 + compressed.len() as u64).to_le_bytes());
    section.push(0);
    section.extend(compressed);

    let at = number(&bytes, CONTENTS_AT) + 8 + ENTRY * entry + ENTRY_NAME;
    let place = [bytes.len() + added.len(), section.len()].map(|size| (size as u64).to_le_bytes());
    bytes[at..at + 16].copy_from_slice(&place.concat());
    bytes[VERSION_AT..VERSION_AT + 3].copy_from_slice(&VERSION);
    bytes.extend(added);
    bytes.extend(section);
    Ok(bytes)
}

/// Numbers that one byte may hold at most: four of two bits each, compressed 255 times.
const MOST: usize = 4 * 255;

/// Whether the sizes that a file states fit into the file. The crate allocates the stated sizes before it reads, and
/// follows values within values without an end. It may panic.
pub fn is_sound(bytes: &[u8]) -> bool {
    has_sound_tables(bytes) && values::are_sound(bytes)
}

fn has_sound_tables(bytes: &[u8]) -> bool {
    /// For each section, how many numbers it begins with, and how many compressed blocks follow, each behind its size.
    const SECTIONS: [(&[u8], usize, usize); 6] = [
        (b"TOKENS", 2, 1),
        (b"STRINGS", 1, 0),
        (b"FIELDS", 1, 2),
        (b"FIELDSETS", 1, 1),
        (b"PATHS", 2, 3),
        (b"SPECS", 1, 3),
    ];
    let word = |at: usize| -> Option<usize> {
        let word: [u8; 8] = bytes.get(at..at.checked_add(8)?)?.try_into().ok()?;
        usize::try_from(u64::from_le_bytes(word)).ok().filter(|word| word / MOST <= bytes.len())
    };
    let section = |entry: usize| -> Option<()> {
        let name = bytes.get(entry..entry + ENTRY_NAME)?.split(|byte| *byte == 0).next()?;
        let (start, size) = (word(entry + ENTRY_NAME)?, word(entry + ENTRY_NAME + 8)?);
        let end = (start + size <= bytes.len()).then_some(start + size)?;
        let Some((_, numbers, blocks)) = SECTIONS.iter().find(|(known, ..)| *known == name) else { return Some(()) };
        let mut at = start;
        for _ in 0..*numbers {
            (word(at)? <= MOST * size).then_some(())?;
            at += 8;
        }
        for _ in 0..*blocks {
            at += 8 + word(at)?;
        }
        (at <= end).then_some(())
    };
    let contents = || -> Option<()> {
        let contents = word(CONTENTS_AT)?;
        (0..word(contents)?.min(bytes.len())).try_for_each(|number| section(contents + 8 + ENTRY * number))
    };
    contents().is_some()
}

/// A list as it stands in the file where it is not compressed: how many, and each.
fn plain(list: &Value) -> Result<Vec<u8>> {
    let (count, numbers): (usize, Vec<u8>) = match list {
        Value::IntVec(all) => (all.len(), all.iter().flat_map(|number| number.to_le_bytes()).collect()),
        Value::Int64Vec(all) => (all.len(), all.iter().flat_map(|number| number.to_le_bytes()).collect()),
        _ => return Err(Error::other("a compressed list that is none of whole numbers")),
    };
    Ok([(count as u64).to_le_bytes().to_vec(), numbers].concat())
}

fn number(bytes: &[u8], at: usize) -> usize {
    u64::from_le_bytes(std::array::from_fn(|i| bytes[at + i])) as usize
}
