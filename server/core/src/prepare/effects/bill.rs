//! What each effect did in a bake, and what it cost.

use super::{Count, Effect, EffectName};
use std::collections::BTreeMap;

/// What an effect did in a bake, and what it cost.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Charge {
    pub name: EffectName,
    pub on: bool,
    /// CPU seconds; `None` where it is part of the engine's steps or of another stage.
    pub seconds: Option<f64>,
    /// Of the bake's CPU seconds.
    pub share: Option<f64>,
    /// Its counters.
    pub counts: BTreeMap<Count, u64>,
}

/// The bill of a bake: each effect with its counts, and the CPU seconds that are its own. `total`: of the whole bake.
pub fn bill(
    effects: &[Effect],
    counts: &BTreeMap<Count, u64>,
    seconds: &BTreeMap<EffectName, f64>,
    total: f64,
) -> Vec<Charge> {
    let charge = |effect: &Effect| {
        let own = seconds.get(&effect.name).copied().filter(|_| effect.on);
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
