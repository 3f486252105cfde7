//! What a report counts.

use std::borrow::Borrow;
use std::cmp::Ordering;

/// A count of the report, by its name in snake case. Ordered by that name, and found by it, too.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize, strum::IntoStaticStr, strum::Display,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Count {
    Analyses,
    BodiesEmitted,
    BodiesLost,
    BodiesPlaced,
    BouncingBodies,
    BreakChecks,
    Candidates,
    CcdBodySteps,
    ControlCycles,
    CoreTriangles,
    DepenetrationSteps,
    FillBodySteps,
    FillPairSteps,
    FillSteps,
    FillStepsRecalled,
    Frames,
    FreeStandingSteps,
    GlueClusters,
    GlueDots,
    GlueDotsBroken,
    GlueIterations,
    GlueLoads,
    GlueProofSteps,
    GuardCalmed,
    GuardRetries,
    GuardSteps,
    GuardStiffened,
    HeldPeak,
    HoldsBroken,
    ImpactLooks,
    NailsBroken,
    NailsDriven,
    PicturesMeasured,
    PropsAsPrimitives,
    PropsSplit,
    RegionTests,
    ReleaseLayers,
    RemovedEscaped,
    RemovedOverlapping,
    RemovedStickingOut,
    RockingLooks,
    RollingBodySteps,
    SceneryPieces,
    ShakeSteps,
    Shaken,
    ShapesMeasured,
    SpeculativeBodySteps,
    StandSteps,
    Steps,
    StepsRecalled,
    StepsWithFrictionPerPoint,
    StepsWithStiffContacts,
    SupportIterations,
    Unjammed,
    VerdictsKept,
    VerdictsStable,
    VerdictsUndecided,
    VerdictsUnstable,
    WallTrianglesSaved,
}

impl Count {
    pub fn name(self) -> &'static str {
        self.into()
    }
}

impl Ord for Count {
    fn cmp(&self, other: &Count) -> Ordering {
        self.name().cmp(other.name())
    }
}

impl PartialOrd for Count {
    fn partial_cmp(&self, other: &Count) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Equal and ordered as the names are, so that a map is searched by name.
impl Borrow<str> for Count {
    fn borrow(&self) -> &str {
        self.name()
    }
}
