//! The figures that a study compares: three headline figures, and an appendix.

use std::collections::BTreeMap;

/// An error measure: 0 is perfect.
pub struct Figure {
    pub name: &'static str,
    /// Title with unit.
    pub title: &'static str,
    /// Computes it from a report's measures by name.
    of: fn(&BTreeMap<String, f64>) -> Option<f64>,
    /// Whether the error is the distance from the value of `reference`.
    pub from_reference: bool,
}

impl Figure {
    /// The value of a run, before the comparison with the reference.
    pub fn of(&self, measures: &BTreeMap<String, f64>) -> Option<f64> {
        (self.of)(measures)
    }
}

/// The errors that an artist sees.
pub const HEADLINE: [Figure; 3] = [
    Figure {
        name: "overlap",
        title: "overlap: mean over contact pairs, in thicknesses",
        of: |measures| measures.get("penetration_mean_rel").copied(),
        from_reference: false,
    },
    Figure {
        name: "imbalance",
        title: "imbalance: share of bodies that move once all are released",
        of: |measures| Some(1.0 - measures.get("free_standing_fraction")?),
        from_reference: false,
    },
    Figure {
        name: "shape",
        title: "shape: distance of the IoU from the reference's",
        of: |measures| measures.get("shape_iou").copied(),
        from_reference: true,
    },
];

/// Further figures of a report.
pub const APPENDIX: [Figure; 9] = [
    measured("penetration_p95_rel", |m| m.get("penetration_p95_rel").copied()),
    measured("penetration_max_rel", |m| m.get("penetration_max_rel").copied()),
    measured("equilibrium_residual_p95", |m| m.get("equilibrium_residual_p95").copied()),
    measured("friction_violation_mean", |m| m.get("friction_violation_mean").copied()),
    measured("energy_gain_rel", |m| m.get("energy_gain_rel").copied()),
    measured("unsupported_fraction", |m| m.get("unsupported_fraction").copied()),
    distance("kept_shape", |m| m.get("kept_shape").copied()),
    distance("height_p95_rel", |m| m.get("height_p95_rel").copied()),
    distance("silhouette_iou", |m| m.get("silhouette_iou").copied()),
];

const fn measured(name: &'static str, of: fn(&BTreeMap<String, f64>) -> Option<f64>) -> Figure {
    Figure { name, title: name, of, from_reference: false }
}

const fn distance(name: &'static str, of: fn(&BTreeMap<String, f64>) -> Option<f64>) -> Figure {
    Figure { name, title: name, of, from_reference: true }
}

/// All of them.
pub fn all() -> impl Iterator<Item = &'static Figure> {
    HEADLINE.iter().chain(&APPENDIX)
}
