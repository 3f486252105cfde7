//! The counts of a bake.

use super::inputs::ReportInputs;
use cairn_engine::shape::ShapeKind;
use cairn_engine::world::WorldCounters;
use cairn_motion::step::Simulation;
use cairn_prepare::effects::{Count, EffectName};
use std::collections::BTreeMap;

/// All counts. `freed_steps`: of the further simulation without control.
pub fn counts(inputs: &ReportInputs, sim: &Simulation, freed_steps: u64) -> BTreeMap<Count, u64> {
    let (scene, pile) = (inputs.scene, &sim.pile);
    let filled = inputs.filled.map(|(_, filled)| filled);
    let (tally, pile_counters, world) = (pile.control.counters(), pile.counters, &pile.world);
    let glue = pile.glue.tally;
    let of_kind = |is: fn(ShapeKind) -> bool| pile.shapes.iter().filter(|s| is(s.solid.kind())).count() as u64;
    let steps_if = |on: bool| if on { pile.step } else { 0 };
    let removed = filled.map(|filled| filled.removed).unwrap_or_default();
    let both = |of: fn(&WorldCounters) -> u64| of(&world.counters) + filled.map_or(0, |filled| of(&filled.counters));
    let frames = inputs.entrance.map_or(pile.recorder.frames.len(), |entrance| entrance.last + 1);
    let entrance = inputs.entrance.map(|entrance| entrance.figures).unwrap_or_default();
    BTreeMap::from([
        (Count::FillSteps, filled.map_or(0, |filled| filled.steps)),
        (Count::FillBodySteps, filled.map_or(0, |filled| filled.counters.awake_body_steps)),
        (Count::FillContactLooks, filled.map_or(0, |filled| filled.counters.contact_looks)),
        (Count::FillContactSkips, filled.map_or(0, |filled| filled.counters.contact_skips)),
        (Count::FillPairSteps, filled.map_or(0, |filled| filled.counters.pair_steps)),
        (Count::FillStepsRecalled, 0),
        (Count::ShakeSteps, filled.and_then(|filled| filled.shaken).map_or(0, |shaken| shaken.steps)),
        (Count::DepenetrationSteps, filled.map_or(0, |filled| filled.depenetration_steps)),
        (Count::Steps, pile.step),
        (Count::StepsRecalled, 0),
        (Count::RemovedStickingOut, removed.sticking_out as u64),
        (Count::RemovedOverlapping, removed.overlapping as u64),
        (Count::RemovedEscaped, removed.escaped as u64),
        (Count::RemovedCutting, removed.cutting as u64),
        (Count::BodiesLost, sim.guard.actions.aside.len() as u64),
        (Count::GuardRetries, sim.guard.actions.retries),
        (Count::GuardBraked, sim.guard.actions.braked),
        (Count::GuardCalmed, world.counters.calmed),
        (Count::GuardStiffened, sim.guard.actions.stiffened),
        (Count::ControlCycles, tally.cycles),
        (Count::Analyses, tally.analyses),
        (Count::VerdictsKept, tally.verdicts_kept),
        (Count::VerdictsStable, tally.stable),
        (Count::VerdictsUnstable, tally.unstable),
        (Count::VerdictsUndecided, tally.undecided),
        (Count::Candidates, tally.candidates),
        (Count::NailsDriven, tally.nails_driven),
        (Count::NailsBroken, tally.nails_broken),
        (Count::HeldAtRest, tally.held_at_rest),
        (Count::HeldPeak, tally.held_peak),
        (Count::HoldsBroken, tally.holds_broken),
        (Count::Unjammed, tally.unjammed),
        (Count::Shaken, tally.shaken),
        (Count::Frames, if pile.recorder.keeps() { frames as u64 } else { 0 }),
        (Count::EntranceBodies, entrance.bodies),
        (Count::EntranceBounces, entrance.bounces),
        (Count::FramesTrimmed, pile.recorder.trimmed as u64),
        (Count::CoreTriangles, inputs.core.map_or(0, |core| core.mesh.triangles.len() as u64)),
        (Count::WallTrianglesSaved, filled.map_or(0, |filled| filled.wall_triangles_saved as u64)),
        (Count::PropsAsPrimitives, of_kind(ShapeKind::is_primitive)),
        (Count::PropsSplit, of_kind(|kind| kind == ShapeKind::Parts)),
        (Count::ReleaseLayers, pile_counters.layers),
        (Count::ReleasedEarly, pile_counters.released_early),
        (Count::HoveringLowered, pile_counters.hovering_lowered),
        (Count::HoveringLeftOut, pile_counters.hovering_left_out),
        (Count::SceneryPieces, scene.statics.len() as u64),
        (Count::BodiesPlaced, scene.bodies.len() as u64),
        (Count::BodiesKept, inputs.outcome.map_or(0, |outcome| outcome.delivered.len() as u64)),
        (Count::BodiesMoved, inputs.outcome.map_or(0, |outcome| outcome.moved as u64)),
        (Count::BodiesNew, inputs.outcome.map_or(0, |outcome| outcome.added as u64)),
        (Count::BodiesGone, inputs.outcome.map_or(0, |outcome| outcome.gone as u64)),
        (Count::BodiesEmitted, pile_counters.bodies_emitted),
        (Count::BouncingBodies, pile_counters.bouncing_bodies),
        (Count::WithdrawalSteps, pile.withdrawal.steps),
        (Count::FreeStandingSteps, freed_steps),
        (Count::StepsWithStiffContacts, steps_if(inputs.resolved.is_on(EffectName::StiffContacts))),
        (Count::StepsWithFrictionPerPoint, steps_if(world.has_friction_per_point())),
        (Count::SpeculativeBodySteps, both(|w| w.speculative_body_steps)),
        (Count::CcdBodySteps, both(|w| w.ccd_body_steps)),
        (Count::RollingBodySteps, world.counters.rolling_body_steps),
        (Count::ResistedBodySteps, world.counters.resisted_body_steps),
        (Count::SceneryPartSteps, world.counters.scenery_part_steps),
        (Count::RockingLooks, world.counters.rocking_looks),
        (Count::GuardSteps, sim.guard.actions.steps),
        (Count::RegionTests, tally.region_tests),
        (Count::BreakChecks, tally.break_checks),
        (Count::ImpactLooks, tally.impact_looks),
        (Count::GlueDots, inputs.glued.map_or(0, |glued| glued.joints.len() as u64)),
        (Count::GlueClusters, glue.clusters),
        (Count::GlueIterations, inputs.glued.map_or(0, |glued| glued.iterations)),
        (Count::GlueProofSteps, inputs.glued.map_or(0, |glued| glued.proof_steps)),
        (Count::GlueLoads, glue.looks),
        (Count::GlueDotsBroken, glue.broken),
    ])
}
