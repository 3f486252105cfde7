//! Measures the pile, and says what a person should know.

use super::inputs::{Figures, Inputs};
use super::{Name, Report, contacts, counts, glue, motion, shape, warnings};
use crate::error::Error;
use crate::input::observer::{Observer, Progress, Stage, observe};
use crate::input::params::Accuracy;
use crate::prepare::effects::{EffectName, bill};
use crate::sim::step::Simulation;
use crate::stages::{free_pour, free_standing};
use std::collections::BTreeMap;

/// The report. `spent`: CPU seconds by stage so far, of which its own are the rest.
pub fn report(
    inputs: &Inputs,
    sim: &mut Simulation,
    mut spent: super::clock::Clock,
    observer: &mut dyn Observer,
) -> Result<Report, Error> {
    let Inputs { scene, params, shapes, filled, resolved, .. } = *inputs;
    let bodies = inputs.bodies.len();
    let progress =
        |fraction| Progress { stage: Stage::Measure, fraction, bodies, released: bodies, at_rest: 0, nails: 0 };
    observe(observer, &progress(0.0))?;
    let mut told = inputs.plan.warnings.clone();
    told.extend(filled.map_or(Vec::new(), |(container, filled)| warnings::container(inputs, container, filled)));
    told.append(&mut sim.pile.notes);
    let mut measures = Figures::new();
    if let Some(target) = inputs.target {
        let (figures, first) = shape::figures(inputs, target, &sim.pile, observer)?;
        measures.extend(figures);
        if let Some((_, filled)) = filled {
            told.extend(warnings::fill(inputs, filled, &first));
        }
        told.extend(first.caveats());
    }
    if let Some((_, filled)) = filled {
        measures.insert("pocket_fraction", Some(filled.pockets));
        measures.insert("wall_deviation_rel", Some(filled.wall_deviation));
    }
    if let Some(glued) = inputs.glued {
        measures.extend(glue::figures(glued, sim));
        told.extend(glue::warnings(inputs, glued));
    }
    observe(observer, &progress(0.8))?;
    // Glued, a pile is certified already; and a pile to shape by need not be: that takes as long as all other figures together.
    let is_rough = matches!(params.accuracy, Accuracy::Draft | Accuracy::Preview);
    let weighs = inputs.glued.is_none() && !is_rough || resolved.is_on(EffectName::FreeStanding);
    measures.extend(contacts::figures(&sim.pile.world, weighs));
    measures.extend(motion::figures(inputs, &sim.pile));
    measures.extend(motion::control(sim));
    let glue = inputs.glued.map(|_| glue::told(sim));
    let begin = observer.cpu_seconds();
    let freed = match resolved.is_on(EffectName::FreeStanding) {
        true => Some(free_standing::run(&mut sim.pile, observer)?),
        false => None,
    };
    let freed_seconds = observer.cpu_seconds() - begin;
    let freed_steps = freed.as_ref().map_or(0, |freed| freed.steps);
    measures.extend(freed.map_or(Figures::new(), |freed| freed.figures));
    if resolved.is_on(EffectName::FreePour) {
        measures.insert("free_pour_fraction", free_pour::of_props(&scene.props, shapes, params, observer)?);
    }
    told.extend(warnings::end(sim, inputs.held, &measures));
    let error_sources = motion::error_sources(inputs, &sim.pile.world, &measures);
    let limited_by = error_sources.iter().max_by(|a, b| a.1.total_cmp(b.1)).map(|(&name, _)| name.into());
    let counts = counts::counts(inputs, sim, freed_steps);
    spent.lap(Stage::Measure, observer);
    let seconds = spent.into_seconds();
    let of_stage = |stage: Stage| seconds.get(&stage).copied().unwrap_or(0.0);
    let proof_seconds = inputs.glued.map_or(0.0, |glued| glued.proof_seconds);
    let own = BTreeMap::from([
        (EffectName::Decomposition, of_stage(Stage::Shape)),
        (EffectName::Fill, of_stage(Stage::Fill)),
        (EffectName::Glue, of_stage(Stage::Glue) - proof_seconds),
        (EffectName::GlueProof, proof_seconds),
        (EffectName::Control, sim.seconds.control()),
        (EffectName::Frames, sim.seconds.frames()),
        (EffectName::FreeStanding, freed_seconds),
    ]);
    Ok(Report {
        seed: params.seed,
        bodies,
        plan: inputs.plan.clone(),
        params: params.clone(),
        measures: named(measures),
        error_sources: named(error_sources),
        limited_by,
        bill: bill(&inputs.plan.effects, &counts, &own, seconds.values().sum()),
        counts,
        shapes: shapes.iter().map(|s| s.report.clone()).collect(),
        seconds,
        glue,
        warnings: told,
    })
}

fn named<T>(values: BTreeMap<&'static str, T>) -> BTreeMap<Name, T> {
    values.into_iter().map(|(name, value)| (name.into(), value)).collect()
}
