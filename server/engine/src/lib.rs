//! Collision shapes ([`shape`]), and the world that rapier steps ([`world`]), in its own units ([`units`]).
//!
//! It alone names rapier, and the geometry library below it except for one hull. It must never know why a body is held,
//! glued or released: callers set roles, joints and friction, and read contacts and poses.
//!
//! Invariants: collision shapes hold the visible meshes; one engine unit of length is d, the median prop's diameter, of
//! time sqrt(d / g); a step gives the same bytes on any number of threads and every platform ([`platform`]).

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod invariants;
mod platform;
pub mod shape;
pub mod units;
pub mod world;
