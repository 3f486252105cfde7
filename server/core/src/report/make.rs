//! Measures the pile, and gathers the warnings.

use super::inputs::{NamedFigures, PhysicsAlone, ReportInputs};
use super::{Name, Report, contacts, counts, entrance, glue, limits, motion, shape, tidiness, visible, warnings};
use crate::keep::Outcome;
use cairn_geometry::contact::REAL_CONTACT;
use cairn_geometry::thickness::Part;
use cairn_input::error::Error;
use cairn_input::observer::{Observer, Stage, observe};
use cairn_motion::step::Simulation;
use cairn_prepare::effects::{Count, EffectName, OwnSeconds, bill};
use std::collections::BTreeMap;

/// What is measured of the pile as it was left.
pub struct MeasuredPile {
    figures: NamedFigures,
    counts: [(Count, u64); 4],
    /// The bodies behind `unsupported_fraction`.
    unsupported: Vec<usize>,
    empty_parts: Vec<Part>,
    notes: Vec<String>,
    own: OwnSeconds,
}

/// Measures the pile as it was left, before physics alone moves it.
pub fn measure(
    inputs: &ReportInputs,
    sim: &mut Simulation,
    observer: &mut dyn Observer,
) -> Result<MeasuredPile, Error> {
    let ReportInputs { shapes, filled, resolved, .. } = *inputs;
    observe(observer, &inputs.progress(0.0))?;
    let mut own = OwnSeconds::default();
    let mut notes = inputs.plan.warnings.clone();
    notes.extend(filled.map_or(Vec::new(), |(container, filled)| warnings::container(inputs, container, filled)));
    notes.append(&mut sim.pile.notes);
    let begin = observer.cpu_seconds();
    let shape = match inputs.target {
        Some(target) if resolved.is_on(EffectName::ShapeFigures) => {
            shape::figures(inputs, target, &sim.pile, observer)?
        }
        Some(_) => shape::Measured::nothing(),
        None => shape::Measured::default(),
    };
    own.pictures = shape.picture_seconds;
    own.shape_figures = observer.cpu_seconds() - begin - own.pictures;
    let mut figures = shape.figures;
    if let Some(first) = &shape.first {
        if let Some((container, filled)) = filled {
            notes.extend(warnings::fill(inputs, container, filled, first));
        }
        notes.extend(warnings::empty_parts(&shape.empty_parts, first.shape_iou.value));
        notes.extend(first.caveats(|prop| &inputs.scene.props[prop].model.name));
    }
    let gap = contacts::widest_gap(&sim.pile.world);
    let pairs = sim.pile.world.contact_pairs(gap);
    if resolved.is_on(EffectName::ShapeFigures) {
        // With a wider gap, a pair may have more points.
        let real = (gap > REAL_CONTACT).then(|| sim.pile.world.contact_pairs(REAL_CONTACT));
        figures.extend(tidiness::figures(&sim.pile.world, shapes, real.as_ref().unwrap_or(&pairs)));
    }
    if let Some((_, filled)) = filled {
        figures.insert("pocket_fraction", Some(filled.pockets));
        figures.insert("wall_deviation_rel", Some(filled.wall_deviation));
    }
    if let Some(glued) = inputs.glued {
        figures.extend(glue::figures(glued, sim));
        notes.extend(glue::warnings(glued, inputs.plan.prop_diameter, inputs.resolved.glue_bound));
        own.glue_proof = glued.proof_seconds;
    }
    observe(observer, &inputs.progress(0.8))?;
    figures.extend(contacts::figures(&sim.pile.world, &pairs));
    let begin = observer.cpu_seconds();
    let (seen, visible_pairs) = match resolved.is_on(EffectName::VisibleFigures) {
        true => visible::figures(inputs, &sim.pile.world, &pairs),
        false => (visible::nothing(), 0),
    };
    figures.extend(seen);
    own.visible = observer.cpu_seconds() - begin;
    // What a removal or a collapse moves does not lean on what is new.
    let is_still = inputs.scene.removals.is_empty() && inputs.scene.collapse.is_none();
    figures.insert("stayed_fraction", inputs.outcome.filter(|_| is_still).and_then(Outcome::stayed));
    let separation = inputs.separation;
    figures.insert("separation_max_rel", separation.map(|found| found.farthest));
    figures.extend(inputs.entrance.map(entrance::figures).unwrap_or_default());
    own.entrance = inputs.entrance.map_or(0.0, |entrance| entrance.seconds);
    own.separation = separation.map_or(0.0, |found| found.seconds);
    let begin = observer.cpu_seconds();
    let support = match resolved.is_on(EffectName::SupportFigures) {
        true => contacts::support(&sim.pile.world, &mut || observer.progress(&inputs.progress(0.9)))?,
        false => contacts::PileSupport::default(),
    };
    figures.insert("unsupported_fraction", support.unsupported);
    own.support = observer.cpu_seconds() - begin;
    figures.extend(motion::figures(inputs, &sim.pile));
    figures.extend(motion::control(sim));
    let counts = [
        (Count::ShapesMeasured, shape.shapes),
        (Count::PicturesMeasured, shape.pictures),
        (Count::SupportIterations, support.iterations),
        (Count::VisiblePairs, visible_pairs),
    ];
    Ok(MeasuredPile { figures, counts, unsupported: support.bodies, empty_parts: shape.empty_parts, notes, own })
}

/// The report of a measured pile, which physics alone may have moved since. `spent`: CPU seconds by stage so far; those
/// since are of the measures.
pub fn report(
    inputs: &ReportInputs,
    sim: &Simulation,
    measured: MeasuredPile,
    alone: PhysicsAlone,
    mut spent: super::clock::Clock,
    observer: &mut dyn Observer,
) -> Report {
    let ReportInputs { params, shapes, separation, .. } = *inputs;
    let MeasuredPile { figures: mut measures, counts: measured, unsupported, empty_parts, mut notes, mut own } =
        measured;
    measures.extend(alone.figures);
    own.free_standing = alone.seconds;
    notes.extend(warnings::end(sim, inputs.held, &measures));
    notes.extend(limits::warnings(&measures));
    notes.extend(warnings::cuts(inputs, sim));
    notes.extend(separation.and_then(warnings::separation));
    notes.extend(inputs.entrance.map(|found| entrance::warnings(&found.figures, &params.entrance)).unwrap_or_default());
    let error_sources = motion::error_sources(inputs, &sim.pile.world, &measures);
    let limited_by = error_sources.iter().max_by(|a, b| a.1.total_cmp(b.1)).map(|(&name, _)| name.into());
    let mut counts = counts::counts(inputs, sim, alone.steps);
    counts.extend(measured);
    counts.extend([
        (Count::SeparationPairs, separation.map_or(0, |found| found.pairs)),
        (Count::SeparationMoved, separation.map_or(0, |found| found.moved)),
        (Count::SeparationCut, separation.map_or(0, |found| found.cut)),
    ]);
    (own.control, own.frames) = (sim.seconds.control(), sim.seconds.frames());
    spent.lap(Stage::Measure, observer);
    own.stages = spent.into_seconds();
    Report {
        seed: params.seed,
        bodies: inputs.pile.bodies.len(),
        plan: inputs.plan.clone(),
        params: params.clone(),
        measures: named(measures),
        error_sources: named(error_sources),
        limited_by,
        bill: bill(&inputs.plan.effects, &counts, &own),
        counts,
        shapes: shapes.iter().map(|s| s.report.clone()).collect(),
        seconds: own.stages,
        unsupported,
        empty_parts,
        removals: Vec::new(),
        collapse: None,
        warnings: notes,
    }
}

fn named<T>(values: BTreeMap<&'static str, T>) -> BTreeMap<Name, T> {
    values.into_iter().map(|(name, value)| (name.into(), value)).collect()
}
