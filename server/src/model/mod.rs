//! glTF files as artists have them: written without a loss, and rendered. `cairn-gltf` reads them.

pub mod analysis;
pub mod arrays;
pub mod export;
pub mod render;
pub mod resting;
