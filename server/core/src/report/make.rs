//! Measures the pile, and gathers the warnings.

use super::inputs::{NamedFigures, ReportInputs};
use super::{Name, Report, contacts, counts, glue, motion, order, shape, warnings};
use crate::error::Error;
use crate::input::observer::{Observer, Stage, observe};
use crate::prepare::effects::{Count, EffectName, OwnSeconds, bill};
use crate::sim::step::Simulation;
use crate::sim::whole::REAL_CONTACT;
use crate::stages::{free_pour, free_standing};
use std::collections::BTreeMap;

/// The report. `spent`: CPU seconds by stage so far, of which its own are the rest.
pub fn report(
    inputs: &ReportInputs,
    sim: &mut Simulation,
    mut spent: super::clock::Clock,
    observer: &mut dyn Observer,
) -> Result<Report, Error> {
    let ReportInputs { scene, params, shapes, filled, resolved, .. } = *inputs;
    observe(observer, &inputs.progress(0.0))?;
    let mut notes = inputs.plan.warnings.clone();
    notes.extend(filled.map_or(Vec::new(), |(container, filled)| warnings::container(inputs, container, filled)));
    notes.append(&mut sim.pile.notes);
    let begin = observer.cpu_seconds();
    let shape = match inputs.target {
        Some(target) if resolved.is_on(EffectName::ShapeFigures) => {
            Some(shape::figures(inputs, target, &sim.pile, observer)?)
        }
        Some(_) => Some(shape::Measured::nothing()),
        None => None,
    };
    let shape_seconds = observer.cpu_seconds() - begin;
    let mut measures = shape.as_ref().map_or(NamedFigures::new(), |shape| shape.figures.clone());
    if let Some(first) = shape.as_ref().and_then(|shape| shape.first.as_ref()) {
        if let Some((_, filled)) = filled {
            notes.extend(warnings::fill(inputs, filled, first));
        }
        notes.extend(first.caveats());
    }
    let gap = contacts::widest_gap(&sim.pile.world);
    let pairs = sim.pile.world.contact_pairs(gap);
    if resolved.is_on(EffectName::ShapeFigures) {
        // With a wider gap, a pair may have more points.
        let real = (gap > REAL_CONTACT).then(|| sim.pile.world.contact_pairs(REAL_CONTACT));
        measures.extend(order::figures(&sim.pile.world, shapes, real.as_ref().unwrap_or(&pairs)));
    }
    if let Some((_, filled)) = filled {
        measures.insert("pocket_fraction", Some(filled.pockets));
        measures.insert("wall_deviation_rel", Some(filled.wall_deviation));
    }
    if let Some(glued) = inputs.glued {
        measures.extend(glue::figures(glued, sim));
        notes.extend(glue::warnings(inputs, glued));
    }
    observe(observer, &inputs.progress(0.8))?;
    measures.extend(contacts::figures(&sim.pile.world, &pairs));
    let begin = observer.cpu_seconds();
    let support = match resolved.is_on(EffectName::SupportFigures) {
        true => contacts::support(&sim.pile.world, &mut || observer.progress(&inputs.progress(0.9)))?,
        false => contacts::PileSupport::default(),
    };
    measures.insert("unsupported_fraction", support.unsupported);
    let support_seconds = observer.cpu_seconds() - begin;
    measures.extend(motion::figures(inputs, &sim.pile));
    measures.extend(motion::control(sim));
    let begin = observer.cpu_seconds();
    let freed = match resolved.is_on(EffectName::FreeStanding) {
        true => Some(free_standing::run(&mut sim.pile, observer)?),
        false => None,
    };
    let freed_seconds = observer.cpu_seconds() - begin;
    let freed_steps = freed.as_ref().map_or(0, |freed| freed.steps);
    measures.extend(freed.map_or(NamedFigures::new(), |freed| freed.figures));
    if resolved.is_on(EffectName::FreePour) {
        measures.insert("free_pour_fraction", free_pour::of_props(&scene.props, shapes, params, observer)?);
    }
    notes.extend(warnings::end(sim, inputs.held, &measures));
    let error_sources = motion::error_sources(inputs, &sim.pile.world, &measures);
    let limited_by = error_sources.iter().max_by(|a, b| a.1.total_cmp(b.1)).map(|(&name, _)| name.into());
    let (picture_seconds, shapes_measured, pictures_measured) =
        shape.map_or((0.0, 0, 0), |shape| (shape.picture_seconds, shape.shapes, shape.pictures));
    let mut counts = counts::counts(inputs, sim, freed_steps);
    counts.extend([
        (Count::ShapesMeasured, shapes_measured),
        (Count::PicturesMeasured, pictures_measured),
        (Count::SupportIterations, support.iterations),
    ]);
    spent.lap(Stage::Measure, observer);
    let own = OwnSeconds {
        stages: spent.into_seconds(),
        glue_proof: inputs.glued.map_or(0.0, |glued| glued.proof_seconds),
        control: sim.seconds.control(),
        frames: sim.seconds.frames(),
        shape_figures: shape_seconds - picture_seconds,
        pictures: picture_seconds,
        support: support_seconds,
        free_standing: freed_seconds,
    };
    Ok(Report {
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
        unsupported: support.bodies,
        warnings: notes,
    })
}

fn named<T>(values: BTreeMap<&'static str, T>) -> BTreeMap<Name, T> {
    values.into_iter().map(|(name, value)| (name.into(), value)).collect()
}
