//! What leaves Cairn: files and pictures.

mod collection;
mod export;
mod files;
mod reader;
mod render;
