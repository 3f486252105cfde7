//! Everything before the first step: what is wrong with a scene, collision shapes and container, what will be simulated and
//! what that costs.

pub mod check;
pub mod container;
pub mod effects;
pub mod estimate;
pub(crate) mod extremes;
pub mod packing;
pub mod plan;
pub mod shape;
