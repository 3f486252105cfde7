//! The output of Cairn: files and pictures.

mod collection;
mod export;
mod field_reports;
mod files;
mod glue;
mod losses;
mod mjcf;
mod pack;
mod physics;
mod reader;
mod render;
mod usd;
