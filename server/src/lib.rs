//! Everything of Cairn except the simulation: files, the wire format, the service and the command line.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

// The layers, lowest first. A module uses only those before it:
// version, failpoints, problem, files, wire, scene_file, model, job, cost, batch, sheet, client, service, cli
mod batch;
pub mod cli;
pub mod client;
pub mod cost;
pub mod files;
pub mod job;
pub mod model;
pub mod problem;
pub mod scene_file;
mod service;
#[cfg(feature = "failpoints")]
pub use service::in_process;
mod failpoints;
mod sheet;
pub mod version;
pub mod wire;
