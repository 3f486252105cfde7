//! Collision shapes, and the world that the engine steps, in its own units.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod invariants;
mod platform;
pub mod shape;
pub mod units;
pub mod world;
