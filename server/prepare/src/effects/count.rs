//! The counts of a report.

use std::borrow::Borrow;

/// A count of the report, by its name in snake case; ordered by that name, so that a map is searched by name, too.
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
pub enum Count {
    Analyses,
    BodiesEmitted,
    BodiesGone,
    BodiesKept,
    BodiesLost,
    BodiesMoved,
    BodiesNew,
    BodiesPlaced,
    BouncingBodies,
    BreakChecks,
    Candidates,
    CcdBodySteps,
    ControlCycles,
    CoreTriangles,
    DepenetrationSteps,
    EntranceBodies,
    EntranceBounces,
    FillBodySteps,
    FillContactLooks,
    FillContactSkips,
    FillPairSteps,
    FillSteps,
    FillStepsRecalled,
    Frames,
    FramesTrimmed,
    FreeStandingSteps,
    GlueClusters,
    GlueDots,
    GlueDotsBroken,
    GlueIterations,
    GlueLoads,
    GlueProofSteps,
    GuardBraked,
    GuardCalmed,
    GuardRetries,
    GuardSteps,
    GuardStiffened,
    HeldAtRest,
    HeldPeak,
    HoldsBroken,
    HoveringLeftOut,
    HoveringLowered,
    ImpactLooks,
    NailsBroken,
    NailsDriven,
    PicturesMeasured,
    PropsAsPrimitives,
    PropsSplit,
    RegionTests,
    ReleaseLayers,
    ReleasedEarly,
    RemovedCutting,
    RemovedEscaped,
    RemovedOverlapping,
    RemovedStickingOut,
    ResistedBodySteps,
    RockingLooks,
    RollingBodySteps,
    SceneryPartSteps,
    SceneryPieces,
    SeparationCut,
    SeparationMoved,
    SeparationPairs,
    ShakeSteps,
    Shaken,
    ShapesMeasured,
    SpeculativeBodySteps,
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
    VisiblePairs,
    WallTrianglesSaved,
    WithdrawalSteps,
}

impl Count {
    pub fn name(self) -> &'static str {
        self.into()
    }
}

impl Borrow<str> for Count {
    fn borrow(&self) -> &str {
        self.name()
    }
}

#[cfg(test)]
#[test]
fn the_order_is_that_of_the_names() {
    use strum::VariantArray;
    assert!(Count::VARIANTS.is_sorted_by_key(|count| count.name()));
}
