//! Many bakes of one scene: which there are, which are finished, and which fill they share.

pub mod finished;
mod matrix;

pub use matrix::{Matrix, Seeds, Span, Variant, Vary};
