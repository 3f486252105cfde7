//! What a finished pile is shown doing: how it comes in ([`entrance`]), falls by design ([`collapse`]), or is taken
//! apart body by body ([`taking_apart`]).
//!
//! It must never change the pile that it shows: an entrance ends in the very poses of the finished pile.
//!
//! Invariants: what no contact gives (pushes, guided flights) is counted and reported.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod collapse;
pub mod entrance;
pub mod taking_apart;
