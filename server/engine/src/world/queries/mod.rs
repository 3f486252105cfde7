//! Readings of the world after a step: loads, energy, and bodies that are where, or as fast as, none should be.

mod ballistics;
mod energy;
mod faults;
mod friction;
mod loads;
mod passage;

pub use friction::FrictionExcess;
pub use passage::Obstacle;
