//! What would be simulated, told before anything runs.

use crate::observer::Stage;

/// The stages that a bake will run and the effects that are switched on, each with its reason.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Plan {
    /// Bodies expected, from the volumes and the packing that the fill usually reaches.
    pub expected_bodies: usize,
    /// Simulation steps expected over all stages.
    pub expected_steps: usize,
    /// Length unit d: the median prop diameter, m.
    pub prop_diameter: f64,
    /// Natural time sqrt(d / g), s.
    pub natural_time: f64,
    pub stages: Vec<Stage>,
    pub effects: Vec<Effect>,
    /// What the user should know before baking: open props, bases that are not flat, ...
    pub warnings: Vec<String>,
}

/// Something that costs time and may be left out.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Effect {
    pub name: &'static str,
    pub on: bool,
    /// One sentence.
    pub reason: String,
}
