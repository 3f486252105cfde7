//! The reader on small files built here.

mod fuzz;
mod model;
mod reads;
mod refuses;
