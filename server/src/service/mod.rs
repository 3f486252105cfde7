//! The gRPC service: a server, its jobs, and each bake in a process of its own.

// The server's own process uses nothing of `worker`: it decodes no model and runs no physics.
mod access;
mod audit;
mod calls;
pub mod config;
mod deadline;
mod encryption;
mod event_log;
mod folder;
#[cfg(feature = "failpoints")]
pub mod in_process;
mod jobs;
pub mod listen;
pub mod news;
mod process;
pub mod secrets;
pub mod serve;
mod shares;
mod status;
mod store;
pub mod telemetry;
mod turns;
#[cfg(unix)]
mod unix;
pub mod worker;
