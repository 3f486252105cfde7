//! Everything before the first step: dense props made light, checks of the scene, the inside of containers, the scenery
//! around the shape, collision shapes and container, the effects, the plan, the estimate.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

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
