//! The gRPC service: a server, its jobs, and each bake in a process of its own.

// The server's own process uses nothing of `worker`: it decodes no model and runs no physics.
mod calls;
pub mod config;
mod deadline;
mod event_log;
mod folder;
mod jobs;
pub mod news;
mod process;
pub mod serve;
mod status;
mod store;
pub mod telemetry;
pub mod worker;
