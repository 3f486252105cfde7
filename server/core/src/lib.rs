//! The method of Hsu & Keyser (2012) and its measures: meshes and parameters in, poses and figures out.
//!
//! Synchronous and pure: no files, no clock, no wire, no global randomness.

pub mod bake;
pub mod container;
pub mod equilibrium;
pub mod asset;
pub mod fill;
pub mod mesh;
pub mod observer;
pub mod params;
pub mod plan;
pub mod pose;
pub mod region;
pub mod report;
pub mod scene;
pub mod shape;
pub mod world;

use bake::Bake;
use observer::Observer;
use params::Params;
use plan::Plan;
use scene::Scene;

/// Why a scene cannot be baked, or a bake did not finish.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene or its parameters are at fault: every problem, each naming its place and the remedy.
    #[error("{}", .0.join("\n"))]
    Invalid(Vec<String>),
    #[error("cancelled")]
    Cancelled,
    /// Our fault.
    #[error("internal error: {0}")]
    Internal(String),
}

/// Checks the scene and tells what would be simulated; simulates nothing.
pub fn plan(_scene: &Scene, _params: &Params) -> Result<Plan, Error> {
    Err(Error::Internal("not built yet".into()))
}

/// Fills, turns over, releases and holds: the whole method.
pub fn bake(_scene: &Scene, _params: &Params, _observer: &mut dyn Observer) -> Result<Bake, Error> {
    Err(Error::Internal("not built yet".into()))
}
mod weld;
