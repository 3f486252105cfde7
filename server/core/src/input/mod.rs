//! The request of a bake and its observer: plain values, no files.

pub mod observer;
pub mod params;
pub mod scene;
