//! The messages and the service of `proto/cairn/v1`, as the build makes them.

include!(concat!(env!("OUT_DIR"), "/cairn.v1.rs"));
