//! The values of a file, held against its size before they are read.

use super::{ARRAY, COMPRESSED, KIND, MOST, PLACE};
use openusd::usdc::CrateFile;
use std::io::Cursor;

/// A value that lies within its own eight bytes.
const INLINED: u64 = 1 << 62;
/// Levels of dictionaries.
const MOST_LEVELS: usize = 16;

/// Whether all values of a file are sound.
pub fn are_sound(bytes: &[u8]) -> bool {
    let Ok(file) = CrateFile::open(Cursor::new(bytes)) else { return false };
    // Values may share their places.
    let mut check = ValueCheck { bytes, left: 16 * bytes.len() };
    file.fields.iter().all(|field| check.value(field.value_rep.0, 0).is_some())
}

struct ValueCheck<'a> {
    bytes: &'a [u8],
    /// Values that may still be looked at.
    left: usize,
}

impl ValueCheck<'_> {
    fn word(&self, at: usize) -> Option<u64> {
        let word = self.bytes.get(at..at.checked_add(8)?)?;
        Some(u64::from_le_bytes(word.try_into().ok()?))
    }

    /// The place to which an offset leads.
    fn follow(&self, at: usize) -> Option<usize> {
        at.checked_add_signed(isize::try_from(self.word(at)? as i64).ok()?)
    }

    /// A number of elements, of which so many fit into a byte.
    fn count(&self, at: usize, in_a_byte: usize) -> Option<usize> {
        let count = usize::try_from(self.word(at)?).ok()?;
        (count / in_a_byte <= self.bytes.len()).then_some(count)
    }

    fn value(&mut self, value: u64, level: usize) -> Option<()> {
        self.left = self.left.checked_sub(1)?;
        let (place, kind) = ((value & PLACE) as usize, (value & KIND) >> 48);
        if value & INLINED != 0 {
            return Some(());
        }
        if value & ARRAY != 0 {
            return if place == 0 { Some(()) } else { self.array(place, kind, value & COMPRESSED != 0) };
        }
        match kind {
            // A dictionary: keys, and offsets to values.
            31 => {
                let mut at = place.checked_add(8)?;
                for _ in 0..self.count(place, 1)? {
                    let own = self.follow(at.checked_add(4)?)?;
                    (level < MOST_LEVELS).then(|| self.word(own))?.and_then(|value| self.value(value, level + 1))?;
                    at = own.checked_add(8)?;
                }
                Some(())
            }
            // Lists of changes of lists: which there are, and each with its length. Those of references are longer.
            32..=39 | 54 | 55 => {
                let lists = (self.bytes.get(place)? & !1).count_ones();
                let size = if matches!(kind, 37 | 39) { 8 } else { 4 };
                if matches!(kind, 35 | 55) && lists > 1 {
                    return None;
                }
                let mut at = place + 1;
                for _ in 0..lists {
                    at = self.count(at, 1)?.checked_mul(size)?.checked_add(at + 8)?;
                }
                Some(())
            }
            // Plain lists.
            40 | 41 | 45 | 48..=50 => self.count(place, 1).map(drop),
            // Samples: an offset to the list of times, then one to the values.
            46 => {
                let times = (level == 0).then(|| self.follow(place))??;
                self.value(self.word(times)?, MOST_LEVELS)?;
                let values = self.follow(times.checked_add(8)?)?;
                for number in 0..self.count(values, 1)? {
                    let own = values.checked_add(8 * (number + 1))?;
                    self.value(self.word(own)?, MOST_LEVELS)?;
                }
                Some(())
            }
            _ => Some(()),
        }
    }

    fn array(&self, place: usize, kind: u64, is_compressed: bool) -> Option<()> {
        let version: [u8; 3] = self.bytes.get(8..11)?.try_into().ok()?;
        if version < [0, 7, 0] {
            // Shorter numbers, the oldest ones behind another one.
            let at = if version < [0, 5, 0] { place.checked_add(4)? } else { place };
            return (self.word(at)? as u32 as usize / MOST <= self.bytes.len()).then_some(());
        }
        self.count(place, if is_compressed { MOST } else { 1 })?;
        if !is_compressed {
            return Some(());
        }
        // Behind the number is the size of the compressed block; of floats, their form and perhaps a table come first.
        let at = place.checked_add(8)?;
        let block = match (kind, self.bytes.get(at)?) {
            (7..=9, b't') => {
                let table = self.word(at + 1)? as u32 as usize;
                let size = [2, 4, 8][kind as usize - 7];
                (table <= self.bytes.len()).then(|| at + 5 + size * table)?
            }
            (7..=9, _) => at + 1,
            _ => at,
        };
        self.count(block, 1).map(drop)
    }
}
