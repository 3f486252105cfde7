//! The output of Cairn: files and pictures.

mod collection;
mod export;
mod files;
mod glue;
mod reader;
mod render;
mod usd;
