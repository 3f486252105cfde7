//! The pile in motion, from turning over to rest. [`step`] is one step, named stage by stage; each stage has a file of
//! its own. [`hold`] steps until all rest; [`glue`] has joints and the sites where joints may be.
//!
//! It must never decide where to glue or how to fill: callers bring the joints and the bodies.
//!
//! Invariants: role, resistance and friction of a body have one writer, [`policy`]; a pile is held by the control or it
//! is glued, never both; a step that gains energy is repeated in smaller ones ([`guard`]).

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod carried;
pub mod control;
mod events;
mod frame_publisher;
pub mod glue;
pub mod guard;
mod hanging;
pub mod hold;
pub mod instance;
pub mod motion;
pub mod pile;
pub mod policy;
pub mod record;
pub mod step;
mod withdrawal;
