//! The fitted numbers. `cargo run --release --example fit_estimate -- RUNS...` prints them.

use super::Weights;
use crate::params::Accuracy;

/// Of the machine that the runs were made on: CPU seconds of the calibration.
pub const CALIBRATION_SECONDS: f64 = 0.1;
/// Nine of ten of the runs are within this factor of the model.
pub const FACTOR: f64 = 2.0;

pub const FILL: Weights = [-6.0, 1.0, 0.3, 0.3, 0.2, 0.1, 0.0, 0.8, 0.5, 0.0, 0.0];
pub const RELEASE_AND_HOLD: Weights = [-9.0, 1.0, 0.3, 0.3, 0.2, 0.0, 0.5, 0.8, 0.5, 0.3, 0.2];
pub const MEASURE: Weights = [-6.0, 1.0, 0.2, 0.3, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];

/// Medians over the study's scenes: `penetration_mean_rel`, `equilibrium_residual_p95`.
pub fn errors(accuracy: Accuracy) -> [f64; 2] {
    match accuracy {
        Accuracy::Paper => [0.002, 0.001],
        Accuracy::Draft => [0.01, 0.001],
        Accuracy::Preview => [0.005, 0.001],
        Accuracy::Standard => [0.002, 0.001],
        Accuracy::Fine => [0.001, 0.001],
        Accuracy::Reference => [0.0005, 0.001],
    }
}
