//! Cairn around its core: the wire, files and the command line.

// The layers, lowest first. A module uses only those before it:
// problem, files, wire, scene_file, model, job, cost, client, service, cli
pub mod cli;
pub mod client;
pub mod cost;
pub mod files;
pub mod job;
pub mod model;
pub mod problem;
pub mod scene_file;
mod service;
pub mod wire;

/// The version as reports tell it: what decides a result.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The version as `--version` tells it: a released program also knows the commit that it was built from.
pub const BUILD: &str = env!("CAIRN_BUILD");
