//! The fitted numbers; those of the accuracies are in [`cairn_input::params::Accuracy::traits`]. `cargo run --release
//! --package cairn-studies --example fit_estimate -- RUNS...` prints them.

use super::CostExponents;

/// CPU seconds of the calibration on the machine that the runs were made on.
pub const CALIBRATION_SECONDS: f64 = 0.0581;
/// Nine of ten bakes of the study's piles are within this factor of laws that were fitted to the other piles, half of
/// them within 1.4.
pub const FACTOR: f64 = 2.7;

/// The control's share of the CPU time of release and hold: median over the study's scenes.
pub const CONTROL_SHARE: f64 = 0.36;

/// Exponents of the fill's CPU time, for [`super::FEATURES`].
pub const FILL: CostExponents = [-5.193, 1.000, 0.228, 0.543, 0.000, 0.000, 0.000, 0.000, 0.083, 0.000];
/// The same for glue and its proof.
pub const GLUE: CostExponents = [-6.433, 1.000, 0.460, 0.324, -0.152, 0.022, 0.204, 0.000, 0.000, 0.000];
/// Glue joints for each body: median over the bakes.
pub const DOTS_PER_BODY: f64 = 0.45;
/// With glue joints up to a strength, in weights of the median prop: `kept_shape`, below which one, five and nine of
/// ten bakes are. The first row is of piles without glue, the last one without a bound. Of 46 pairs, at `draft`, of
/// props and control meshes of others, most of which hang over. The number of joints at a bounded strength varies too
/// much for an estimate: at 8, between 0.006 and 1.1 for a body.
pub const KEPT: [(f64, [f64; 3]); 6] = [
    (0.05, [0.05, 0.25, 0.49]),
    (0.5, [0.05, 0.19, 0.82]),
    (2.0, [0.05, 0.2, 1.0]),
    (8.0, [0.09, 0.87, 1.0]),
    (32.0, [0.16, 1.0, 1.0]),
    (128.0, [0.997, 1.0, 1.004]),
];

/// [`KEPT`] for a strength: between rows, by its logarithm.
pub fn expected_kept_shape(strength: f64) -> [f64; 3] {
    let [first, .., last] = KEPT;
    let above = KEPT.iter().position(|row| strength < row.0);
    let (low, high) = match above {
        Some(0) => (first, first),
        Some(n) => (KEPT[n - 1], KEPT[n]),
        None => (last, last),
    };
    let share = if low.0 == high.0 { 0.0 } else { libm::log(strength / low.0) / libm::log(high.0 / low.0) };
    std::array::from_fn(|n| low.1[n] + share * (high.1[n] - low.1[n]))
}

/// The same for release and hold.
pub const RELEASE_AND_HOLD: CostExponents = [-12.259, 1.000, 0.805, 0.193, -0.173, 0.068, 0.784, 0.519, 0.221, 0.080];
/// The same for shapes and measures, which take most of a small bake.
pub const MEASURE: CostExponents = [-2.5, 0.5, 0.000, 0.000, 0.000, 0.000, 0.000, 0.000, 0.000, 0.000];
/// CPU time of release and hold of a glued pile over that of a held one: median over the bakes.
pub const GLUED_RELEASE: f64 = 0.044;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_glue_keeps_more() {
        for (strength, shape) in KEPT {
            assert_eq!(expected_kept_shape(strength), shape, "as measured");
        }
        assert_eq!(
            (expected_kept_shape(0.0), expected_kept_shape(f64::INFINITY)),
            (expected_kept_shape(KEPT[0].0), expected_kept_shape(128.0))
        );
        let shares: Vec<[f64; 3]> = (0..100).map(|n| expected_kept_shape(0.5 * 1.06f64.powi(n))).collect();
        assert!(shares.windows(2).all(|pair| pair[0][1] <= pair[1][1]));
        assert!(shares.iter().all(|[low, middle, high]| low <= middle && middle <= high));
    }
}
