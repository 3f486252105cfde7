//! The pile in motion. `step` is one step, named stage by stage; each stage has a file of its own.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod control;
mod events;
mod frame_publisher;
pub mod glue;
pub mod guard;
pub mod hold;
pub mod instance;
pub mod motion;
pub mod pile;
pub mod policy;
pub mod record;
pub mod step;
mod withdrawal;
