//! The service of `proto/cairn/v1`, as the build makes it: its client, and what a server implements.

include!(concat!(env!("OUT_DIR"), "/cairn.v1.rs"));
