//! The cost and influence of each effect: the scene as it is, and with one effect at a time switched.

use super::table::MedianRange;
use super::{Record, StudyVariant, VariantKind};
use cairn_prepare::effects::{Effect, EffectName};
use cairn_prepare::plan::Plan;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// The name of the scene as it is.
const AS_IS: &str = "as it is";
/// The figures in the table, besides the time.
const SHOWN: [&str; 4] = ["kept_shape", "penetration_mean_rel", "resting_speed_max_rel", "hanging"];

/// The scene as it is, and a variant for each effect of its plan that can be switched.
pub fn switched(plan: &Plan) -> Vec<StudyVariant> {
    let as_is = StudyVariant { name: AS_IS.into(), kind: VariantKind::Knob, set: Vec::new() };
    let other = |effect: &Effect| {
        let field = effect.switch.as_deref()?;
        let to = if effect.on { "off" } else { "on" };
        let set = match field {
            // A group with its own parameters can be switched off, but not on.
            "control.mode" if effect.name == EffectName::Control && effect.on => "control.mode=off".into(),
            _ if field.starts_with("effects.") => format!("{field}={to}"),
            _ => return None,
        };
        Some(StudyVariant { name: format!("{} {to}", effect.name), kind: VariantKind::Knob, set: vec![set] })
    };
    std::iter::once(as_is).chain(plan.effects.iter().filter_map(other)).collect()
}

/// A row of the table: medians over the seeds.
#[derive(Clone, Debug, Serialize)]
pub struct EffectRow {
    pub variant: String,
    pub seeds: usize,
    /// CPU seconds of the bake, without the measures.
    pub seconds: f64,
    /// Ratio to the scene as it is, seed by seed.
    pub ratio: f64,
    pub figures: BTreeMap<String, f64>,
}

/// One row for each variant that was baked.
pub fn rows(runs: &[(StudyVariant, Vec<Record>)]) -> Vec<EffectRow> {
    let base: BTreeMap<u64, f64> = runs.first().map_or_else(BTreeMap::new, |(_, records)| costs(records).collect());
    let row = |(variant, records): &(StudyVariant, Vec<Record>)| {
        let ratios = costs(records).filter_map(|(seed, cost)| Some(cost / base.get(&seed)?)).collect();
        let figure = |name: &str| {
            let values: Vec<f64> = records.iter().filter_map(|r| r.measures.get(name).copied()).collect();
            (!values.is_empty()).then(|| (name.to_owned(), median(values)))
        };
        EffectRow {
            variant: variant.name.clone(),
            seeds: records.len(),
            seconds: median(costs(records).map(|(_, cost)| cost).collect()),
            ratio: median(ratios),
            figures: SHOWN.into_iter().filter_map(figure).collect(),
        }
    };
    runs.iter().filter(|(_, records)| !records.is_empty()).map(row).collect()
}

/// The table, as Markdown.
pub fn markdown(rows: &[EffectRow]) -> String {
    let mut text = format!("| effect | seeds | CPU s | of as it is | {} |\n", SHOWN.join(" | "));
    text += &format!("| --- | --- | --- | --- |{}\n", " --- |".repeat(SHOWN.len()));
    for row in rows {
        let figure = |name: &&str| row.figures.get(*name).map_or("-".into(), |value| format!("{value:.4}"));
        let figures: Vec<String> = SHOWN.iter().map(figure).collect();
        let EffectRow { variant, seeds, seconds, ratio, .. } = row;
        writeln!(text, "| {variant} | {seeds} | {seconds:.2} | {ratio:.2} | {} |", figures.join(" | "))
            .expect("a string takes all");
    }
    text
}

fn costs(records: &[Record]) -> impl Iterator<Item = (u64, f64)> + '_ {
    records.iter().map(|record| (record.seed, record.cost()))
}

/// NaN where there are none.
fn median(values: Vec<f64>) -> f64 {
    MedianRange::of(values).map_or(f64::NAN, |spread| spread.median)
}
