//! Meshes and poses, distance fields, where meshes cross, and what a pile looks like in figures ([`measure`]).
//!
//! It must never know an engine, a scene or a file: points and triangles in, numbers out. Of other people's geometry it
//! names one function, the convex hull ([`hull`]), whose result it checks.
//!
//! Invariants: lengths are in the unit of the caller's points, double precision except in [`rays`]; equal input gives
//! equal trees, hulls and orders, on any number of threads; no result is NaN.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod closed_mesh;
pub mod contact;
pub mod crossing;
pub mod hull;
pub mod interior;
pub mod measure;
pub mod mesh;
pub mod polygon;
pub mod pose;
pub mod raster;
pub mod rays;
pub mod rectangle;
pub mod simplify;
#[cfg(test)]
#[path = "../../testing/messages.rs"]
mod testing;
pub mod thickness;
pub mod topology;
mod tree;
pub mod weld;

/// "1 body" or "2 bodies", for messages.
pub fn counted(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

/// The edge of a grid's cells: `wanted`, or enlarged by `factor` until there are no more than `most` of them. `counts`:
/// cells of an edge, along X, Y, Z. Returns those of the edge, too.
pub fn enlarged_cell(wanted: f64, factor: f64, most: f64, counts: impl Fn(f64) -> DVec3) -> (f64, DVec3) {
    let mut edge = wanted;
    while counts(edge).element_product() > most {
        edge *= factor;
    }
    (edge, counts(edge))
}

pub use closed_mesh::ClosedMesh;
use glam::DVec3;
pub use tree::Boxed;

/// Relative error of a few operations in double precision: some thousand roundings.
pub const ROUNDING: f64 = 1e-12;
/// Relative error of a long computation in double precision. What is smaller counts as zero.
pub const TOLERANCE: f64 = 1e-9;
/// Relative error of coordinates in single precision, as files have them.
pub const SINGLE_PRECISION: f64 = 1e-6;
/// The most that a few operations in single precision add to a length of about 1: 1,000 roundings.
pub const SINGLE_ROUNDING: f32 = 1e-4;
/// Bound on an iteration that converges in ten or so rounds: only rounding errors may keep it going.
pub const MOST_ITERATIONS: usize = 200;
/// Bound on the halvings of a step: the last one is 1/4096 of the first.
pub const HALVINGS: usize = 12;
/// Resolution of a pile's shape, d: of the container's distance grid, and of the figures. A cell of the figures is no
/// larger (the definition of `shape_iou`), and a centre of mass this far outside still counts as inside (that of
/// `inside_fraction`). A body that has moved by more in a trial of glue is seen to move.
pub const RESOLUTION: f64 = 0.1;
/// A mesh that encloses less than this share of its hull has no usable inside: a sheet, or an open or inverted mesh.
pub const HOLLOW: f64 = 0.01;
