//! The gRPC service: a server, its jobs, and a worker process for each bake; and its client ([`client`]).
//!
//! The server's own process must never decode a model or run physics: it uses neither [`analysis`] nor [`worker`],
//! which run in processes of their own.
//!
//! Invariants: everything is bounded (places, streams, uploads, memory and time of a bake, bytes and age of the store);
//! each fault becomes a gRPC status in [`status`] alone; the same request is the same bake, by a hash.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

// The server's own process does not use `analysis` and `worker`: it decodes no model and runs no physics.
mod accepting;
mod access;
mod accounts;
pub mod analysis;
pub mod api;
mod asset_owners;
mod audit;
mod blocking;
mod bounds;
mod calls;
pub mod client;
pub mod codec;
pub mod config;
mod connections;
mod deadline;
mod earlier_pile;
mod encryption;
mod event_log;
mod folder;
pub mod heap;
mod hook;
#[cfg(feature = "failpoints")]
pub mod in_process;
mod incoming;
mod jobs;
pub mod listen;
mod memory;
mod metrics;
pub mod priority;
mod process;
mod quotas;
pub mod sandbox;
mod scheduler;
mod seal;
pub mod secrets;
pub mod serve;
pub mod status;
pub mod status_json;
mod store;
mod store_clock;
pub mod telemetry;
#[cfg(unix)]
mod unix;
mod users;
pub mod worker;
pub mod worker_message;
