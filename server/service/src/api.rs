//! The service of `proto/cairn/v1`, as the build makes it: its client, and what a server implements.

// The comments are those of the schema, for every language.
#![allow(rustdoc::broken_intra_doc_links, rustdoc::invalid_rust_codeblocks)]

include!(concat!(env!("OUT_DIR"), "/cairn.v1.rs"));
