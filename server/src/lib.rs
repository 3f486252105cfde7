//! Cairn around its core: the wire, files and the command line.

pub mod cli;
pub mod document;
pub mod export;
pub mod files;
pub mod from_proto;
pub mod job;
pub mod problem;
pub mod render;
pub mod scene_file;
pub mod to_proto;

/// The messages of `proto/cairn/v1`.
pub mod proto {
    include!(concat!(env!("OUT_DIR"), "/cairn.v1.rs"));
}
