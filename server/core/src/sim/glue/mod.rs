//! Glue: dots that join bodies of a pile, or a body and the ground.

mod problem;

pub use problem::Sites;
