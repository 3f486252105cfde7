//! Clutter: settled layouts of props on trays, in bins, on shelves and tables, one after another, for those who train
//! robots and vision models.
//!
//! A [`Catalogue`] says which props and places there are, and what a layout may have. [`Library`] is all that is read
//! and prepared once: collision shapes, worlds with their scenery, surfaces on which bodies may begin. Layout number n
//! is then drawn ([`draw`]), put above its place ([`arrange`]), and let fall until it rests ([`settle`]); single bodies
//! that do not stay go (`pile`, `proof`), a camera may look at it (`view`), and it becomes one [`Line`]:
//!
//! ```text
//!   catalogue, seed, n  ->  draw  ->  arrange  ->  settle  ->  trial  ->  line n
//!                            ^                                   |
//!                            +---- with the next attempt --------+  too few stay, or its looks are wrong
//! ```
//!
//! It must never know a process, a clock or which layouts were made before: a line is a function of the catalogue with
//! its files and of its number.
//!
//! Invariants: SI and glTF's axes in every line; poses are from a prop's own frame, scaled, to that of the place's
//! file; what a line says of a layout was found in the layout that it shows.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod arrange;
pub mod assets;
pub mod catalogue;
pub mod draw;
#[cfg(test)]
mod example;
mod height_map;
mod library;
pub mod line;
mod model;
mod pile;
mod proof;
pub mod settle;
mod surfaces;
mod view;

pub use catalogue::Catalogue;
pub use library::Library;
pub use line::Line;
pub use model::model;
