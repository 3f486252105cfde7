//! The messages of `proto/cairn/v1`, as the build makes them. They are decoded from `Bytes` alone: for
//! each other kind of buffer the program would have all decoders once more.

// The comments are those of the schema, for every language.
#![allow(rustdoc::broken_intra_doc_links, rustdoc::invalid_rust_codeblocks)]

include!(concat!(env!("OUT_DIR"), "/cairn.v1.rs"));
