//! Every effect, a row each, in the order of the stages: its name, the switch that forces it, the counts that show what
//! it did, and whether a scene calls for it, with the reason. `seconds` follows where an effect has CPU time of its
//! own.

use super::Decision::{self, No, Useless, Yes};
use super::ForcedBy::{self, By, ByValue, Never};
use super::{Count, Count::*, EffectDefinition, EffectInputs, EffectName, EffectName::*, OwnSeconds};
use crate::container;
use cairn_engine::shape::ShapeKind;
use cairn_input::observer::Stage;
use cairn_input::params::{ControlMode, EntranceKind, FrictionCone, FrictionModel, GlueMode};
use cairn_input::params::{ReleaseOrder, Switch};
use strum::VariantArray;

pub(super) const ROWS: &[EffectDefinition] = &[
    row(Primitives, By("effects.primitives", |c| c.engine.primitives), &[PropsAsPrimitives], |c| {
        c.some_props("box or ball: ", "no prop is a box or a ball", |i| c.summaries[i].kind.is_primitive())
    }),
    row(Decomposition, By("effects.decomposition", |c| c.engine.decomposition), &[PropsSplit], |c| {
        match c.some_props("nonconvex: ", "", |i| c.summaries[i].kind == ShapeKind::Parts) {
            Yes(props) => yes(format!("{props}; at most {} parts each", c.params.physics.max_parts)),
            _ => no("one convex shape is close enough to each prop"),
        }
    })
    .seconds(|spent| spent.of(Stage::Shape)),
    row(
        Fill,
        ByValue("fill.method"),
        &[FillSteps, FillBodySteps, FillPairSteps, FillContactLooks, FillContactSkips],
        |c| match c.params.fill.method.traits() {
            _ if c.scene.control.is_none() => no("there is no control mesh"),
            method if method.fills => yes(method.summary),
            _ => no("the scene switches it off"),
        },
    )
    .seconds(|spent| spent.of(Stage::Fill)),
    row(Core, ByValue("fill.shell"), &[CoreTriangles], |c| match (c.params.fill.shell, &c.checked.core) {
        _ if c.scene.control.is_none() => no("there is no control mesh"),
        (None, _) => no("props fill all of the control mesh"),
        (Some(d), Some(_)) => yes(format!("props lie no deeper than {d} d below the control mesh's surface")),
        (Some(d), None) => no(format!("no place of the control mesh is deeper than {d} d")),
    }),
    row(WallSimplification, ByValue("fill.wall_tolerance"), &[WallTrianglesSaved], |c| match &c.checked.control {
        Some(closed) if c.fills => match c.params.fill.wall_tolerance {
            _ if !container::has_fine_walls(&closed.topology, c.checked.diameter) => {
                no("the control mesh is not finer than the props need")
            }
            0.0 => no("fill.wall_tolerance is 0"),
            d => yes(format!("the control mesh is finer than the props need: the container is within {d} d of it")),
        },
        _ => no("there is no fill"),
    }),
    row(Depenetration, ByValue("fill.residual_overlap"), &[DepenetrationSteps], |c| {
        match c.params.fill.residual_overlap {
            _ if !c.fills => no("there is no fill"),
            1.0 => no("bodies that overlap after the fill stay so"),
            share => {
                yes(format!("bodies that overlap by more than {}% after the fill are pushed apart", share * 100.0))
            }
        }
    }),
    row(TurnOver, Never, &[FillSteps], |c| match c.fills {
        true => yes("the container is filled upside down"),
        false => no("there is no fill"),
    }),
    row(Glue, ByValue("glue.mode"), &[GlueIterations, GlueDots, GlueClusters, HoveringLowered, HoveringLeftOut], |c| {
        match c.glue_bound {
            0.0 if c.params.glue.mode == GlueMode::Natural => no("the scene asks for a natural pile"),
            0.0 if c.params.glue.strength == Some(0.0) => no("glue.strength is 0"),
            0.0 => no("glue.mode is auto, and no filled pile is held"),
            f64::INFINITY => yes("bodies are glued where friction cannot carry them: the pile stands as modelled"),
            most => yes(format!("bodies are glued where joints of at most {most} weights carry them; the others fall")),
        }
    })
    .seconds(|spent| spent.of(Stage::Glue) - spent.glue_proof),
    row(GlueProof, ByValue("glue.proof"), &[GlueProofSteps], |c| match c.glues() {
        true if c.params.glue.proof == Switch::Off => no("the scene switches it off"),
        true => yes("the glued pile is released on trial first, to check that it stands"),
        false => no("nothing is glued"),
    })
    .seconds(|spent| spent.glue_proof),
    row(StagedRelease, ByValue("release.order"), &[ReleaseLayers, ReleasedEarly], |c| match c.params.release.order {
        _ if c.glues() => no(GLUED),
        ReleaseOrder::BottomUp => yes("layers are released from the bottom to the top"),
        ReleaseOrder::TopDown => yes("layers are released from the top to the bottom"),
        ReleaseOrder::AtOnce => no("all bodies are released at frame 0"),
    }),
    row(Scenery, Never, &[SceneryPieces, SceneryPartSteps], |c| {
        match c.scene.statics.iter().filter(|m| !m.keys.is_empty()).count() {
            _ if c.scene.statics.is_empty() => no("there is no geometry besides the ground"),
            moving => yes(format!("geometry besides the ground: {}, of which {moving} moving", c.scene.statics.len())),
        }
    }),
    row(Bodies, Never, &[BodiesPlaced], |c| match c.scene.bodies.len() {
        0 => no("no body is placed by hand"),
        n => yes(format!("placed by hand: {n}")),
    }),
    row(Emitters, Never, &[BodiesEmitted], |c| match c.scene.emitters.len() {
        0 => no("there is no emitter"),
        n => yes(format!("emitters: {n}")),
    }),
    row(
        ContinuousCollision,
        By("effects.continuous_collision", |c| c.engine.continuous_collision),
        &[SpeculativeBodySteps, CcdBodySteps],
        |_| {
            yes("a body that moves by more than half of its thickness in a step is swept along its path; the contacts \
                 of one of several parts are found a step ahead")
        },
    ),
    row(FrictionPerPoint, ByValue("physics.friction_model"), &[StepsWithFrictionPerPoint], |c| {
        match c.params.physics.friction_model {
            FrictionModel::Simplified => no("one friction force per contact patch is enough at this accuracy"),
            FrictionModel::Coulomb => yes("one friction force per contact point"),
        }
    }),
    row(Restitution, By("effects.restitution", |c| c.engine.restitution), &[BouncingBodies], |c| {
        c.some_props("bounces: ", "no prop bounces", |i| c.scene.props[i].restitution > 0.0)
    }),
    row(
        RollingResistance,
        By("effects.rolling_resistance", |c| c.engine.rolling_resistance),
        &[RollingBodySteps],
        |c| match c.some_props("round: ", "no prop is round", |i| c.checked.sizes[i].round.is_some()) {
            Yes(_) if c.params.physics.rolling_resistance == 0.0 => no("physics.rolling_resistance is 0"),
            Yes(props) => yes(format!("{props}; rolling resistance {}", c.params.physics.rolling_resistance)),
            none => none,
        },
    ),
    row(ContactResistance, ByValue("control.resistance"), &[ResistedBodySteps], |c| {
        match (c.params.release.resistance, c.params.control.resistance) {
            (0.0, share) if c.control == ControlMode::Off || share == 0.0 => {
                yes("late in the hold, contacts resist what still rolls or rocks")
            }
            (0.0, share) => {
                yes(format!("contacts of slow bodies that are not held resist by {share} of their friction"))
            }
            (share, _) => yes(format!("contacts of all released bodies resist by {share} of their friction")),
        }
    }),
    row(StiffContacts, By("effects.stiff_contacts", |c| c.engine.stiff_contacts), &[StepsWithStiffContacts], |c| {
        let (ratio, frequency, substeps) = (c.mass_ratio, c.physics.contact_frequency, c.physics.substeps);
        match format!("the masses of the pile differ by {ratio:.0}:1") {
            differ if c.stiffens => yes(format!("{differ}: contact frequency {frequency:.0}, {substeps} substeps")),
            _ if ratio < 1.5 => no("the bodies of the pile have about the same mass"),
            differ => no(format!("{differ}, which the contacts carry as they are")),
        }
    }),
    row(
        Guard,
        By("effects.guard", |c| c.effects.guard),
        &[GuardSteps, GuardRetries, GuardBraked, GuardStiffened, GuardCalmed],
        |_| yes("every step is checked, in less than one percent of the time"),
    ),
    row(SameOnAllMachines, Never, &[], |_| yes("the engine's arithmetic is the same on every processor")),
    row(Control, ByValue("control.mode"), &[ControlCycles, HeldAtRest], |c| match c.control {
        _ if c.glues() => no(GLUED),
        ControlMode::Off => no("the scene switches it off"),
        ControlMode::Nails => yes("certified pairs are nailed together until the next verdict"),
        ControlMode::Hold => yes("certified bodies are held until the next verdict"),
    })
    .seconds(|spent| spent.control),
    row(Analysis, ByValue("control.friction_cone"), &[Analyses], |c| match c.params.control.friction_cone {
        _ if c.glues() => no(GLUED),
        _ if c.control == ControlMode::Off => no(NO_CONTROL),
        FrictionCone::Pyramid => yes("four-sided friction pyramid, as in the paper"),
        FrictionCone::Cone => yes("exact friction cone"),
    }),
    row(KeptVerdicts, By("effects.kept_verdicts", |c| c.effects.kept_verdicts), &[VerdictsKept], |c| match c.control {
        _ if c.glues() => useless(GLUED),
        ControlMode::Off => useless(NO_CONTROL),
        ControlMode::Nails => useless(NO_HOLD),
        ControlMode::Hold => yes("a verdict holds until a body that this one rests on changes"),
    }),
    row(Region, By("effects.region", |c| c.effects.region), &[RegionTests], |c| match c.scene.target() {
        _ if c.control == ControlMode::Off && !c.glues() => useless(NO_CONTROL),
        Some(_) => yes("bodies outside are neither judged nor glued"),
        None => useless("there is no region: the control acts everywhere"),
    }),
    row(Nails, ByValue("control.mode"), &[NailsDriven], |c| match c.control {
        ControlMode::Off => no(NO_CONTROL),
        ControlMode::Nails => yes("certified pairs are nailed together until the next verdict"),
        ControlMode::Hold => no("bodies are held, not nailed"),
    }),
    row(
        Breaking,
        By("effects.breaking", |c| c.effects.breaking),
        &[BreakChecks, NailsBroken, HoldsBroken, GlueLoads, GlueDotsBroken],
        |c| match c.params.control.kappa {
            _ if c.glues() && c.scene.something_hits() => yes("something hits the pile: overloaded glue joints break"),
            _ if c.glues() => no("nothing hits the glued pile"),
            _ if c.control == ControlMode::Off => useless(NO_CONTROL),
            kappa => yes(format!("holds and nails that carry more than kappa = {kappa} N s per kg break")),
        },
    ),
    row(Impact, By("effects.impact", |c| c.effects.impact), &[ImpactLooks, Shaken], |c| match c.control {
        ControlMode::Off => useless(NO_CONTROL),
        ControlMode::Nails => useless(NO_HOLD),
        _ if c.scene.something_hits() => yes("a body flies, falls or moves, or kept bodies are released"),
        ControlMode::Hold => no("no body flies in, falls or moves"),
    }),
    row(Stand, By("control.stand", |c| c.params.control.stand), &[WithdrawalSteps], |c| match c.control {
        ControlMode::Off => useless(NO_CONTROL),
        ControlMode::Nails => no(NO_HOLD),
        // A later event needs the control until then.
        _ if c.params.control.until.is_some() || c.scene.something_hits() => no("a later event needs the hold"),
        ControlMode::Hold if c.fills => {
            yes("the control is withdrawn, from the bottom to the top: the pile stands by itself")
        }
        ControlMode::Hold => no("nothing is filled"),
    }),
    row(Separation, By("hold.separate", |c| c.params.hold.separate), &[SeparationPairs, SeparationMoved], |c| match c
        .params
        .accuracy
        .traits()
        .separates
    {
        true => yes("bodies whose visible meshes cut each other in the end are moved apart until none do"),
        false => no(NOT_AT_THIS_ACCURACY),
    })
    .seconds(|spent| spent.separation),
    row(Entrance, ByValue("entrance.kind"), &[EntranceBodies, EntranceBounces], |c| match c.params.entrance.kind {
        EntranceKind::None => no("the frames show the release"),
        _ if c.effects.frames == Switch::Off => no("switched off by effects.frames"),
        EntranceKind::Rain => yes("bodies rain into their places: planned back from the finished pile"),
        EntranceKind::Pour => yes("bodies pour into their places: planned back from the finished pile"),
        EntranceKind::Throw => yes("bodies are thrown into their places: planned back from the finished pile"),
        EntranceKind::Assemble => yes("bodies leap into their places: planned back from the finished pile"),
    })
    .seconds(|spent| spent.entrance),
    row(EffectName::Frames, By("effects.frames", |c| c.effects.frames), &[Count::Frames], |c| {
        yes(format!("{} per second; without them, the result is the final pose", c.params.output.fps))
    })
    .seconds(|spent| spent.frames),
    row(Trim, ByValue("output.trim"), &[FramesTrimmed], |c| match c.params.output.trim {
        _ if c.params.entrance.kind != EntranceKind::None => no("an entrance ends with the pile at rest"),
        true => yes("the last frames are left out where nothing is to be seen"),
        false => no("the scene does not ask for it"),
    }),
    row(ShapeFigures, By("report.shape", |c| c.params.report.shape), &[ShapesMeasured], |c| match c.scene.target() {
        Some(_) => yes("the pile is compared with the control mesh"),
        None => useless("there is no control mesh to compare with"),
    })
    .seconds(|spent| spent.shape_figures),
    row(PictureFigures, By("report.pictures", |c| c.params.report.pictures), &[PicturesMeasured], |c| {
        match c.scene.target() {
            None => useless("there is no control mesh to compare with"),
            _ if c.params.report.shape == Switch::Off => useless("switched off by report.shape"),
            _ if !c.params.accuracy.traits().measures_pictures => no(NOT_AT_THIS_ACCURACY),
            _ => yes("the pile is compared with the control mesh as a camera sees them"),
        }
    })
    .seconds(|spent| spent.pictures),
    row(VisibleFigures, By("report.visible", |c| c.params.report.visible), &[VisiblePairs], |_| {
        yes("the meshes of neighbours are held against each other, as a camera sees them")
    })
    .seconds(|spent| spent.visible),
    row(SupportFigures, By("report.support", |c| c.params.report.support), &[SupportIterations], |c| {
        match c.params.output.free_standing {
            false if c.glues() => no("the equilibrium of the glued pile is certified already"),
            false if !c.params.accuracy.traits().measures_support => no(NOT_AT_THIS_ACCURACY),
            _ => yes("the forces at all contacts of the pile are solved for at the end"),
        }
    })
    .seconds(|spent| spent.support),
    row(FreeStanding, ByValue("output.free_standing"), &[FreeStandingSteps], |c| {
        further_simulation(c.params.output.free_standing)
    })
    .seconds(|spent| spent.free_standing),
    row(FreePour, ByValue("output.free_pour"), &[], |c| further_simulation(c.params.output.free_pour)),
];

const _: () = {
    assert!(ROWS.len() == EffectName::VARIANTS.len());
    let mut row = 0;
    while row < ROWS.len() {
        assert!(ROWS[row].name as usize == row, "the rows are in the order of `EffectName`, one for each");
        row += 1;
    }
};

const NO_CONTROL: &str = "nothing is controlled";
const NO_HOLD: &str = "no body is held";
const GLUED: &str = "glued bodies stand without being held, and are all released at once";
const NOT_AT_THIS_ACCURACY: &str = "not at this accuracy, unless the scene asks for it";

const fn row(
    name: EffectName,
    switch: ForcedBy,
    counts: &'static [Count],
    decide: fn(&EffectInputs) -> Decision,
) -> EffectDefinition {
    EffectDefinition { name, switch, counts, decide, seconds: None }
}

impl EffectDefinition {
    const fn seconds(self, seconds: fn(&OwnSeconds) -> f64) -> EffectDefinition {
        EffectDefinition { seconds: Some(seconds), ..self }
    }
}

fn yes(reason: impl Into<String>) -> Decision {
    Yes(reason.into())
}

fn no(reason: impl Into<String>) -> Decision {
    No(reason.into())
}

fn useless(reason: &str) -> Decision {
    Useless(reason.into())
}

fn further_simulation(is_on: bool) -> Decision {
    match is_on {
        true => yes("the scene asks for it: a further simulation"),
        false => no("only on request: it is a further simulation"),
    }
}

impl EffectInputs<'_> {
    fn glues(&self) -> bool {
        self.glue_bound > 0.0
    }

    /// For props of a kind, with their names after `some`: "round: a, b, c and 3 more". Not without such a prop.
    fn some_props(&self, some: &str, none: &str, is: impl Fn(usize) -> bool) -> Decision {
        const SHOWN: usize = 3;
        let props = self.scene.props.iter().enumerate().filter(|(i, _)| is(*i));
        let names: Vec<&str> = props.map(|(_, prop)| &*prop.model.name).collect();
        let shown = names[..names.len().min(SHOWN)].join(", ");
        match names.len() {
            0 => no(none),
            n if n > SHOWN => yes(format!("{some}{shown} and {} more", n - SHOWN)),
            _ => yes(format!("{some}{shown}")),
        }
    }
}
