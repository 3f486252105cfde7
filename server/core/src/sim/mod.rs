//! The pile in motion: one step, what it consists of, and the control.

pub mod control;
pub mod events;
pub mod guard;
pub mod record;
