//! The method of Hsu & Keyser (2012) and its measures: meshes and parameters in, poses and figures out.
//!
//! Synchronous and pure: no files, no clock, no wire, no global randomness.

pub mod asset;
pub mod mesh;
pub mod params;
pub mod pose;
pub mod scene;
pub mod topology;
mod weld;
