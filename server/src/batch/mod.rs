//! Many bakes of one scene: lists the variants, recognizes finished ones and shared fills.

pub mod finished;
mod matrix;

pub use matrix::{Matrix, Seeds, Span, Variant, Vary};
