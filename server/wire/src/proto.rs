//! The messages of `proto/cairn/v1`, as the build makes them. They are decoded from `Bytes` alone: for
//! each other kind of buffer the program would have all decoders once more.

include!(concat!(env!("OUT_DIR"), "/cairn.v1.rs"));
