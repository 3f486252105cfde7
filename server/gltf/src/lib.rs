#![doc = include_str!("../README.md")]
// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod accessor;
mod buffer;
mod compressed;
mod container;
pub mod document;
mod gate;
mod geometry;
pub mod log;
pub mod media;
mod node;
pub mod picture;
mod problem;
mod remedy;
mod source;
mod triangulate;
pub mod uri;

pub use accessor::Elements;
pub use compressed::{DRACO, MESHOPT};
pub use document::Document;
pub use geometry::{Geometry, Primitive, UnreadExtensions};
pub use node::{INSTANCING, VISIBILITY};
pub use problem::{AssetProblem, ProblemKind, grouped};
pub use source::{Limits, Resolver, Source};
