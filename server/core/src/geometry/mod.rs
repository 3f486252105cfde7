//! Meshes and poses, and computations on them without physics.

pub mod closed_mesh;
pub mod contact;
pub mod interior;
pub mod mesh;
pub mod pose;
pub mod raster;
pub mod rectangle;
pub mod topology;
pub(crate) mod weld;

pub use closed_mesh::ClosedMesh;
