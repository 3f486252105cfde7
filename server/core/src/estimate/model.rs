//! The fitted numbers. `cargo run --release --example fit_estimate -- RUNS...` prints them.

use super::Weights;
use crate::params::Accuracy;

/// Of the machine that the runs were made on: CPU seconds of the calibration.
pub const CALIBRATION_SECONDS: f64 = 0.0553;
/// Nine of ten bakes of props and control meshes that no study knows were within this factor of the model.
pub const FACTOR: f64 = 3.6;

/// Of the CPU time of release and hold, the control's: median over the study's scenes.
pub const CONTROL_SHARE: f64 = 0.45;

/// Of 1, bodies, corners, parts, slenderness, walls, times, step_rate, substeps, coulomb.
pub const FILL: Weights = [-5.300, 1.000, 0.434, 0.076, -0.102, 0.111, 0.000, 0.000, 0.083, 0.000];
pub const RELEASE_AND_HOLD: Weights = [-9.752, 1.000, 0.300, 0.000, -0.208, 0.175, 0.818, 0.000, 0.307, 0.000];
/// Shapes and measures.
pub const MEASURE: Weights = [-7.526, 1.000, 0.000, 0.000, 0.062, 0.205, 0.413, 0.000, 0.087, 0.617];

/// Medians over the study's scenes: `penetration_mean_rel`, `friction_violation_mean`.
pub fn errors(accuracy: Accuracy) -> [f64; 2] {
    match accuracy {
        // As standard: it is not part of the study.
        Accuracy::Paper | Accuracy::Standard => [0.010, 0.0005],
        Accuracy::Draft => [0.021, 0.0025],
        Accuracy::Preview => [0.010, 0.0015],
        Accuracy::Fine => [0.0058, 0.0],
        Accuracy::Reference => [0.011, 0.0],
    }
}
