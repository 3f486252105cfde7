//! What a bake may leave out: every effect, whether the scene calls for it, and the user's word on it.
//!
//! [`Resolved`] decides once; the stages obey it, and the plan tells it with [`Effect::reason`]. An effect that is off costs
//! nothing: its counters in the report are 0. A new effect is a variant of [`EffectName`]: the compiler then asks for its row here, its
//! decision and switch in `resolve`, its reason in `reasons`, and its counts where they arise.

mod bill;
mod count;
mod reasons;
mod resolve;

pub use bill::{Charge, bill};
pub use count::Count;
pub use resolve::Resolved;

use crate::input::params::{Params, Switch};
use crate::input::scene::Scene;
use crate::prepare::check::CheckedScene;
use crate::prepare::shape::ShapeSummary;
use reasons::Reasons;
use strum::VariantArray;

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
    Frames,
    ShapeFigures,
    PictureFigures,
    SupportFigures,
    FreeStanding,
    FreePour,
}

impl EffectName {
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The field of the scene that forces it, and the counts that tell what it did.
    const fn row(self) -> (Option<&'static str>, &'static [Count]) {
        use Count::*;
        match self {
            EffectName::Primitives => (Some("effects.primitives"), &[PropsAsPrimitives]),
            EffectName::Decomposition => (Some("effects.decomposition"), &[PropsSplit]),
            EffectName::Fill => (Some("fill.method"), &[FillSteps, FillBodySteps, FillPairSteps]),
            EffectName::Core => (Some("fill.shell"), &[CoreTriangles]),
            EffectName::WallSimplification => (Some("fill.wall_tolerance"), &[WallTrianglesSaved]),
            EffectName::Depenetration => (Some("fill.residual_overlap"), &[DepenetrationSteps]),
            EffectName::TurnOver => (None, &[FillSteps]),
            EffectName::Glue => (Some("glue.mode"), &[GlueIterations, GlueDots, GlueClusters]),
            EffectName::GlueProof => (Some("glue.proof"), &[GlueProofSteps]),
            EffectName::StagedRelease => (Some("release.order"), &[ReleaseLayers]),
            EffectName::Scenery => (None, &[SceneryPieces]),
            EffectName::Bodies => (None, &[BodiesPlaced]),
            EffectName::Emitters => (None, &[BodiesEmitted]),
            EffectName::ContinuousCollision => {
                (Some("effects.continuous_collision"), &[SpeculativeBodySteps, CcdBodySteps])
            }
            EffectName::FrictionPerPoint => (Some("physics.friction_model"), &[StepsWithFrictionPerPoint]),
            EffectName::Restitution => (Some("effects.restitution"), &[BouncingBodies]),
            EffectName::RollingResistance => (Some("effects.rolling_resistance"), &[RollingBodySteps]),
            EffectName::StiffContacts => (Some("effects.stiff_contacts"), &[StepsWithStiffContacts]),
            EffectName::Guard => (Some("effects.guard"), &[GuardSteps, GuardRetries, GuardStiffened, GuardCalmed]),
            EffectName::SameOnAllMachines => (None, &[]),
            EffectName::Control => (Some("control.mode"), &[ControlCycles]),
            EffectName::Analysis => (Some("control.friction_cone"), &[Analyses]),
            EffectName::KeptVerdicts => (Some("effects.kept_verdicts"), &[VerdictsKept]),
            EffectName::Region => (Some("effects.region"), &[RegionTests]),
            EffectName::Nails => (Some("control.mode"), &[NailsDriven]),
            EffectName::Breaking => {
                (Some("effects.breaking"), &[BreakChecks, NailsBroken, HoldsBroken, GlueLoads, GlueDotsBroken])
            }
            EffectName::Impact => (Some("effects.impact"), &[ImpactLooks, Shaken]),
            EffectName::Stand => (Some("control.stand"), &[StandSteps]),
            EffectName::Frames => (Some("effects.frames"), &[Frames]),
            EffectName::ShapeFigures => (Some("report.shape"), &[ShapesMeasured]),
            EffectName::PictureFigures => (Some("report.pictures"), &[PicturesMeasured]),
            EffectName::SupportFigures => (Some("report.support"), &[SupportIterations]),
            EffectName::FreeStanding => (Some("output.free_standing"), &[FreeStandingSteps]),
            EffectName::FreePour => (Some("output.free_pour"), &[]),
        }
    }

    /// The field of the scene that forces it, and the value that switches it off; `None`: nothing does.
    pub const fn switch(self) -> Option<&'static str> {
        self.row().0
    }

    /// The counts of the report that tell what it did: all 0 where it is off.
    pub const fn counters(self) -> &'static [Count] {
        self.row().1
    }
}

/// Something that costs time and may be left out: whether it is on, and why.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Effect {
    pub name: EffectName,
    pub on: bool,
    /// One sentence.
    pub reason: String,
    /// [`EffectName::switch`].
    pub switch: Option<String>,
    /// [`EffectName::counters`].
    pub counters: Vec<Count>,
}

/// All effects of a checked scene, as they were resolved. `summaries`: one per prop.
pub fn all(
    scene: &Scene,
    params: &Params,
    checked: &CheckedScene,
    summaries: &[ShapeSummary],
    resolved: &Resolved,
) -> Vec<Effect> {
    let reasons = Reasons { scene, params, checked, summaries, resolved };
    let effect = |&name: &EffectName| {
        let (switch, counters) = name.row();
        let field = switch.unwrap_or_default();
        let reason = match resolved.word(name) {
            Switch::Auto => reasons.of(name),
            Switch::On => format!("switched on by {field}"),
            Switch::Off => format!("switched off by {field}"),
        };
        let on = resolved.is_on(name);
        Effect { name, on, reason, switch: switch.map(str::to_owned), counters: counters.to_vec() }
    };
    EffectName::VARIANTS.iter().map(effect).collect()
}
