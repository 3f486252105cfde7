//! The command line, and what it does by itself: many bakes, what accuracy costs, contact sheets.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod batch;
pub mod cli;
pub mod cost;
mod sheet;
