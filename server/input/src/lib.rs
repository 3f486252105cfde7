//! What a bake is asked: scene, parameters, the meshes of files ([`asset`]), and the observer that it calls back.
//!
//! It must never know the wire, a disk or a clock: a caller brings bytes and plain values.
//!
//! Invariants: SI units and glTF's axes; every parameter has its default and range from the comments of
//! `proto/cairn/v1` (`build.rs`); what is wrong is a list of [`error::SceneProblem`]s, each with its field and remedy.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod asset;
pub mod earlier;
pub mod error;
pub mod observer;
pub mod params;
pub mod scene;
#[cfg(test)]
#[path = "../../testing/messages.rs"]
mod testing;

pub use error::Error;
