//! Everything before the first step: dense props made light, checks of the scene, the inside of containers, the scenery
//! around the shape, the container, the effects, the plan, the estimate.
//!
//! It must never step a world. What is known here is an error or a warning before the bake, never after it.
//!
//! Invariants: all problems are found at once; an effect is decided once, by [`effects::Resolved`], which later rooms
//! obey.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod changes;
pub mod check;
pub mod container;
pub mod dense;
pub mod effects;
pub mod estimate;
pub mod extremes;
pub mod inside;
pub mod packing;
pub mod plan;
pub mod stable_pose;
pub mod surroundings;
#[cfg(test)]
#[path = "../../testing/messages.rs"]
mod testing;
mod thin;
