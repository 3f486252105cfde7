//! The method end to end, on small piles.

mod common;
mod container;
mod effects;
mod entrance;
mod events;
mod glue;
mod hanging;
mod keep;
mod known;
mod motion;
mod order;
mod pile;
mod place;
mod rest;
mod several;
mod shell;
mod still;
mod world;
