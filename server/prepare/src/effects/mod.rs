//! Effects: the parts of a bake that may be left out; whether the scene calls for each, and the user's switch.
//!
//! [`Resolved`] decides once; the stages obey it, and the plan prints it with [`Effect::reason`]. An effect that is off
//! costs nothing: its counts in the report are 0. A new effect is a variant of [`EffectName`], its row in `table`, and
//! the code that obeys it; a new count is a variant of [`Count`].

mod bill;
mod count;
mod resolve;
mod table;

pub use bill::{Charge, bill};
pub use count::Count;
pub use resolve::Resolved;

use crate::check::CheckedScene;
use cairn_engine::shape::ShapeSummary;
use cairn_input::observer::Stage;
use cairn_input::params::{ControlMode, Effects, Params, Physics, PhysicsSwitches, Switch};
use cairn_input::scene::Scene;
use std::collections::BTreeMap;

/// All effects, in the order of the stages. A report calls each by its name in snake case.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    serde::Serialize,
    serde::Deserialize,
    strum::IntoStaticStr,
    strum::Display,
    strum::VariantArray,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum EffectName {
    Primitives,
    Decomposition,
    Fill,
    Core,
    WallSimplification,
    Depenetration,
    TurnOver,
    Glue,
    GlueProof,
    StagedRelease,
    Scenery,
    Bodies,
    Emitters,
    ContinuousCollision,
    FrictionPerPoint,
    Restitution,
    RollingResistance,
    ContactResistance,
    StiffContacts,
    Guard,
    SameOnAllMachines,
    Control,
    Analysis,
    KeptVerdicts,
    Region,
    Nails,
    Breaking,
    Impact,
    Stand,
    Separation,
    Entrance,
    Frames,
    Trim,
    ShapeFigures,
    PictureFigures,
    VisibleFigures,
    SupportFigures,
    FreeStanding,
    FreePour,
}

impl EffectName {
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// The definition of an effect.
struct EffectDefinition {
    name: EffectName,
    switch: ForcedBy,
    /// Counts of its work in the report: all 0 if it is off.
    counts: &'static [Count],
    /// Decides whether the scene and its parameters call for it.
    decide: fn(&EffectInputs) -> Decision,
    /// `None`: its CPU time is part of the engine's steps or of another effect's.
    seconds: Option<fn(&OwnSeconds) -> f64>,
}

/// The field of the scene that forces an effect.
enum ForcedBy {
    /// There is none.
    Never,
    /// The field's own value decides, with the rest of the scene.
    ByValue(&'static str),
    /// A field that takes "auto", "on" and "off", and how it is read.
    By(&'static str, fn(&EffectInputs) -> Switch),
}

/// Whether a scene calls for an effect, and why: one sentence.
enum Decision {
    Yes(String),
    No(String),
    /// The scene cannot use it: the switch is ignored.
    Useless(String),
}

/// Something that costs time and may be left out: whether it is on, and why.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Effect {
    pub name: EffectName,
    pub on: bool,
    /// One sentence.
    pub reason: String,
    /// The field of the scene that forces it; `None`: nothing does.
    pub switch: Option<String>,
    /// Counts of its work in the report: all 0 if it is off.
    pub counters: Vec<Count>,
}

/// The facts on which effects are decided.
struct EffectInputs<'a> {
    scene: &'a Scene,
    params: &'a Params,
    /// The user's switches of shapes and engine.
    engine: &'a PhysicsSwitches,
    /// The user's switches of the other effects.
    effects: &'a Effects,
    checked: &'a CheckedScene,
    /// One per prop.
    summaries: &'a [ShapeSummary],
    /// The control mesh is filled.
    fills: bool,
    /// Off where the pile is glued, too: then it stands without being held.
    control: ControlMode,
    /// As in [`Resolved`].
    glue_bound: f64,
    /// As in [`Resolved`].
    physics: &'a Physics,
    /// As in [`Resolved`].
    mass_ratio: f64,
    /// The masses ask for stiffer contacts than the parameters give.
    stiffens: bool,
}

/// CPU seconds of a bake: of its stages, and of effects within them.
#[derive(Clone, Debug, Default)]
pub struct OwnSeconds {
    pub stages: BTreeMap<Stage, f64>,
    pub glue_proof: f64,
    pub control: f64,
    pub frames: f64,
    pub shape_figures: f64,
    pub pictures: f64,
    pub visible: f64,
    pub separation: f64,
    pub entrance: f64,
    pub support: f64,
    pub free_standing: f64,
}

impl OwnSeconds {
    pub fn of(&self, stage: Stage) -> f64 {
        self.stages.get(&stage).copied().unwrap_or(0.0)
    }
}
