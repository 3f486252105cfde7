//! The local and the global equilibrium analysis against exact physics, against Clarabel, and against bad input.

mod agreement;
mod generator;
mod global;
