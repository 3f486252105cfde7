//! The figures that a study compares: three headline figures, and an appendix.

use std::collections::BTreeMap;

/// An error measure: 0 is perfect.
pub struct Figure {
    pub name: &'static str,
    /// Title with unit.
    pub title: &'static str,
    /// The name of the report's measure.
    measure: &'static str,
    /// Whether the value is 1 minus the measure.
    is_complement: bool,
    /// Whether the error is the distance from the value of `reference`.
    pub from_reference: bool,
}

impl Figure {
    const fn new(name: &'static str, title: &'static str, measure: &'static str, from_reference: bool) -> Figure {
        Figure { name, title, measure, is_complement: false, from_reference }
    }

    /// The value of a run, before the comparison with the reference. `measures`: of its report, by name.
    pub fn of(&self, measures: &BTreeMap<String, f64>) -> Option<f64> {
        let value = *measures.get(self.measure)?;
        Some(if self.is_complement { 1.0 - value } else { value })
    }
}

/// The errors that an artist sees.
pub const HEADLINE: [Figure; 3] = [
    Figure {
        name: "overlap",
        title: "overlap: 95 of 100 pairs of touching meshes overlap by no more, in thicknesses",
        measure: "visible_depth_p95_rel",
        is_complement: false,
        from_reference: false,
    },
    Figure {
        name: "imbalance",
        title: "imbalance: share of bodies that move once all are released",
        measure: "free_standing_fraction",
        is_complement: true,
        from_reference: false,
    },
    Figure::new("shape", "shape: distance of the IoU from the reference's", "shape_iou", true),
];

/// Further figures of a report.
pub const APPENDIX: [Figure; 9] = [
    measured("penetration_p95_rel"),
    measured("penetration_max_rel"),
    measured("equilibrium_residual_p95"),
    measured("friction_violation_mean"),
    measured("energy_gain_rel"),
    measured("unsupported_fraction"),
    distance("kept_shape"),
    distance("height_p95_rel"),
    distance("silhouette_iou"),
];

const fn measured(name: &'static str) -> Figure {
    Figure::new(name, name, name, false)
}

const fn distance(name: &'static str) -> Figure {
    Figure::new(name, name, name, true)
}

/// All of them.
pub fn all() -> impl Iterator<Item = &'static Figure> {
    HEADLINE.iter().chain(&APPENDIX)
}
