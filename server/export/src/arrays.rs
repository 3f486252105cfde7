//! Arrays for programs that learn or measure: an archive `.npz`, as NumPy reads it.
//!
//! Each array is a file `.npy` of version 1.0: a header of text, and the numbers in C order, low bytes first.

use crate::archive;
use zip::CompressionMethod;

/// A kind of number.
pub trait Element: Copy {
    /// As NumPy names it.
    const KIND: &'static str;
    fn write(self, to: &mut Vec<u8>);
}

impl Element for i32 {
    const KIND: &'static str = "<i4";
    fn write(self, to: &mut Vec<u8>) {
        to.extend(self.to_le_bytes());
    }
}

impl Element for f32 {
    const KIND: &'static str = "<f4";
    fn write(self, to: &mut Vec<u8>) {
        to.extend(self.to_le_bytes());
    }
}

impl Element for f64 {
    const KIND: &'static str = "<f8";
    fn write(self, to: &mut Vec<u8>) {
        to.extend(self.to_le_bytes());
    }
}

impl Element for bool {
    const KIND: &'static str = "|b1";
    fn write(self, to: &mut Vec<u8>) {
        to.push(u8::from(self));
    }
}

/// An archive in the making.
#[derive(Default)]
pub struct Arrays {
    files: Vec<(String, Vec<u8>)>,
}

/// The header's length is a multiple of this.
const ALIGNED: usize = 64;

impl Arrays {
    /// Adds an array; the last axis of `shape` runs fastest.
    pub fn add<T: Element>(&mut self, name: &str, shape: &[usize], values: &[T]) {
        debug_assert_eq!(shape.iter().product::<usize>(), values.len(), "{name}");
        // A tuple of one has a comma.
        let shape: String = shape.iter().map(|length| format!("{length}, ")).collect();
        let mut header = format!("{{'descr': '{}', 'fortran_order': False, 'shape': ({shape}), }}", T::KIND);
        const BEGIN: &[u8] = b"\x93NUMPY\x01\x00";
        let unpadded = BEGIN.len() + 2 + header.len() + 1;
        header.extend(std::iter::repeat_n(' ', unpadded.next_multiple_of(ALIGNED) - unpadded));
        header.push('\n');
        let mut bytes = BEGIN.to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        values.iter().for_each(|value| value.write(&mut bytes));
        self.files.push((format!("{name}.npy"), bytes));
    }

    /// The archive; the same bytes everywhere.
    pub fn finish(self) -> std::io::Result<Vec<u8>> {
        let files = self.files.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice()));
        archive::zip(CompressionMethod::Deflated, files)
    }
}
