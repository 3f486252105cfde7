//! glTF files as artists have them: read and written without a loss, and shown.

mod accessor;
#[cfg(not(feature = "failpoints"))]
mod decompress;
#[cfg(feature = "failpoints")]
pub mod decompress;
pub mod document;
pub mod export;
mod instances;
mod local;
mod primitive;
pub mod render;
