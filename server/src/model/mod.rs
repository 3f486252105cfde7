//! glTF files as artists have them: read and written without a loss, and shown.

mod accessor;
mod decompress;
pub mod document;
pub mod export;
pub mod render;
