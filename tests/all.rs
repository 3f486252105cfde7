//! All tests of the program and its service, in one executable: it is linked once. What counts allocations has its own,
//! `live_bytes.rs`.

mod architecture;
mod assets;
mod cli;
mod fuzz;
mod hard;
mod output;
mod schema;
mod service;
mod words;
