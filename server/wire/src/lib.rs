//! The messages of `cairn.v1`, and all conversion between them and the core's types.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod analysis;
pub mod digest;
pub mod effective;
pub mod frame_delta;
pub mod from_proto;
pub mod parameters;
pub mod proto;
pub mod scene_file;
pub mod to_proto;
pub mod versions;
