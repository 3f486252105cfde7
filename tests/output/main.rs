//! What leaves Cairn: files and pictures.

mod export;
mod files;
mod reader;
mod render;
