//! The bill of a bake: the counts of each effect, and its CPU time.

use super::table::ROWS;
use super::{Count, Effect, EffectName, OwnSeconds};
use std::collections::BTreeMap;

/// An effect's part in a bake.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Charge {
    pub name: EffectName,
    pub on: bool,
    /// CPU seconds; `None` where it is part of the engine's steps or of another stage.
    pub seconds: Option<f64>,
    /// Of the bake's CPU seconds.
    pub share: Option<f64>,
    /// Its counts.
    pub counts: BTreeMap<Count, u64>,
}

/// The bill of a bake: each of its effects with its counts, and the CPU seconds that are its own.
pub fn bill(effects: &[Effect], counts: &BTreeMap<Count, u64>, spent: &OwnSeconds) -> Vec<Charge> {
    let total: f64 = spent.stages.values().sum();
    let charge = |effect: &Effect| {
        let own = ROWS[effect.name as usize].seconds.filter(|_| effect.on).map(|seconds| seconds(spent));
        let count = |&count: &Count| Some((count, *counts.get(&count)?));
        Charge {
            name: effect.name,
            on: effect.on,
            seconds: own,
            share: own.filter(|_| total > 0.0).map(|own| own / total),
            counts: effect.counters.iter().filter_map(count).collect(),
        }
    };
    effects.iter().map(charge).collect()
}
