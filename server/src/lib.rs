//! Cairn: bakes piles of props in the shape of a control mesh.

pub mod document;
pub mod export;
pub mod render;
