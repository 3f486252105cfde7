//! The variants of a study: the presets, and single changed parameters.

use cairn_input::params::{Accuracy, Params};
use cairn_wire::from_proto::params_and_problems;
use cairn_wire::proto;
use cairn_wire::scene_file::SceneTree;
use cairn_wire::to_proto;

/// A variant of the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct StudyVariant {
    /// `standard`, or `physics.substeps=4`.
    pub name: String,
    pub kind: VariantKind,
    /// Assignments in the form of `--set`.
    pub set: Vec<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum VariantKind {
    Preset,
    Knob,
}

/// Parameters changed from `standard`, one list of assignments for each variant.
const KNOBS: [&[&str]; 17] = [
    &["physics.step_natural=0.1", "control.period=3"],
    &["physics.step_natural=0.025", "control.period=10"],
    &["physics.substeps=4"],
    &["physics.substeps=16"],
    &["physics.contact_frequency=10"],
    &["physics.contact_frequency=60"],
    &["physics.friction_model=coulomb"],
    &["physics.shape_tolerance=0.1", "physics.max_parts=4"],
    &["control.friction_cone=pyramid"],
    &["control=off"],
    &["fill.round=0.6"],
    &["fill.growth=0.4"],
    &["fill.growth=1.6"],
    &["fill.full_below=0.15"],
    &["fill.settle=1"],
    &["fill.residual_overlap=0.04"],
    &["fill.residual_overlap=0.003"],
];

/// The presets, cheapest first, then the changed parameters. `knobs` replaces the built-in ones; `,` separates
/// assignments.
pub fn variants(knobs: Option<&[String]>) -> Vec<StudyVariant> {
    let preset = |accuracy: &Accuracy| {
        let name = to_proto::accuracy_name(*accuracy);
        StudyVariant { set: vec![format!("accuracy={name}")], name, kind: VariantKind::Preset }
    };
    let knob = |set: Vec<String>| StudyVariant { name: set[0].clone(), kind: VariantKind::Knob, set };
    let built_in = || KNOBS.iter().map(|set| set.iter().map(|&a| a.to_owned()).collect()).collect();
    let given = |knobs: &[String]| knobs.iter().map(|k| k.split(',').map(str::to_owned).collect()).collect();
    let sets: Vec<Vec<String>> = knobs.map_or_else(built_in, given);
    Accuracy::LADDER.iter().map(preset).chain(sets.into_iter().map(knob)).collect()
}

/// Solver work per simulated second, in arbitrary units: substeps divided by the time step.
pub fn work(tree: &SceneTree) -> f64 {
    let scene: proto::Scene = tree.to_message();
    let params: Params = params_and_problems(&scene).0;
    let step = match params.physics.step {
        cairn_input::params::Time::Natural(step) | cairn_input::params::Time::Seconds(step) => step,
    };
    f64::from(params.physics.substeps) / step
}
