//! All tests of the program and its service, in one executable: it is linked once.

mod architecture;
mod assets;
mod cli;
mod fuzz;
mod hard;
mod output;
mod schema;
mod service;
mod words;
