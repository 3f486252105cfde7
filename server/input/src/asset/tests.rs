//! The reader on small files built here.

mod compressed;
mod fuzz;
mod model;
mod reads;
mod refuses;
