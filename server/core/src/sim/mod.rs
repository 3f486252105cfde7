//! The pile in motion. `step` is one step, named stage by stage; each stage has a file of its own.

pub mod control;
mod events;
mod gentle_stop;
pub mod glue;
pub mod guard;
pub mod instance;
pub mod pile;
pub mod policy;
pub mod record;
mod show;
pub mod step;
pub mod whole;
