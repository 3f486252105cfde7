//! The local and the global equilibrium analysis against exact physics, against Clarabel, and against bad input.

mod agreement;
mod candidates;
mod generator;
mod global;
mod glue;
mod input;
mod limit;
mod physics;
mod removal;
mod wall;
