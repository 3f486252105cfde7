//! Everything before the first step: dense props made light, checks of the scene, the inside of containers, the scenery
//! around the shape, collision shapes and container, the effects, the plan, the estimate.

pub mod check;
pub mod container;
pub mod dense;
pub mod effects;
pub mod estimate;
pub(crate) mod extremes;
pub mod inside;
pub mod packing;
pub mod plan;
pub mod shape;
pub(crate) mod stable_pose;
pub mod surroundings;
pub mod units;
