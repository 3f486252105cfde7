//! What a bake is asked to do, and whom it talks to: plain values, no files.

pub mod observer;
pub mod params;
pub mod scene;
