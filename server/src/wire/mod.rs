//! The messages of `cairn.v1`, and all conversion between them and the core's types.

pub mod analysis;
pub mod digest;
pub mod effective;
pub mod frame_delta;
pub mod from_proto;
pub mod parameters;
pub mod proto;
pub mod to_proto;
pub mod versions;
