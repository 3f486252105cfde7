//! The pile in motion. `step` is one step, named stage by stage; each stage has a file of its own.

pub mod control;
mod events;
mod frame_publisher;
pub mod glue;
pub mod guard;
pub mod instance;
pub mod motion;
pub mod pile;
pub mod pile_equilibrium;
pub mod policy;
pub mod record;
pub mod step;
mod withdrawal;
