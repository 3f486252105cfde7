//! Cairn around its core: the wire, files and the command line.

mod accessor;
pub mod cli;
pub mod client;
pub mod config;
pub mod cost;
mod deadline;
mod decompress;
pub mod document;
pub mod event_log;
pub mod export;
pub mod files;
mod frame_delta;
pub mod from_proto;
pub mod job;
pub mod jobs;
pub mod machine;
mod pace;
pub mod problem;
mod process;
pub mod render;
pub mod report;
pub mod reuse;
pub mod scene_file;
pub mod serve;
mod service;
mod status;
pub mod store;
mod telemetry;
pub mod to_proto;
mod worker;

/// The version as reports tell it: what decides a result.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The version as `--version` tells it: a released program also knows the commit that it was built from.
pub const BUILD: &str = env!("CAIRN_BUILD");

/// The messages of `proto/cairn/v1`.
pub mod proto {
    include!(concat!(env!("OUT_DIR"), "/cairn.v1.rs"));
}
