//! How a finished pile comes in, falls, or is taken apart.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod collapse;
pub mod entrance;
pub mod taking_apart;
