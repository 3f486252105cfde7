//! The request of a bake and its observer: plain values, no files.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod asset;
pub mod error;
pub mod observer;
pub mod params;
pub mod scene;
#[cfg(test)]
#[path = "../../testing/messages.rs"]
mod testing;

pub use error::Error;
