//! Meshes and poses, and computations on them without physics.

pub mod closed;
pub mod contact;
pub mod mesh;
pub mod pose;
pub mod raster;
pub mod rectangle;
pub mod region;
pub mod topology;
pub(crate) mod weld;

pub use closed::Closed;
