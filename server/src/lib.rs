//! Cairn around its core: the wire, files and the command line.

/// The messages of `proto/cairn/v1`.
pub mod proto {
    include!(concat!(env!("OUT_DIR"), "/cairn.v1.rs"));
}
//! Cairn: bakes piles of props in the shape of a control mesh.

pub mod document;
pub mod export;
