//! The messages of `cairn.v1`, all conversion between them and the core's types, and scene files held against the
//! schema ([`scene_file`]).
//!
//! It must never know tonic: what bakes does not know who asks. It alone converts between messages and parameters.
//!
//! Invariants: the effective scene has every default filled in and bakes to the same result; counts fit the wire.

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
