//! The figures of a study: medians over seeds, errors, and the variants that are not dominated.

use super::figures::{self, APPENDIX, Figure, HEADLINE};
use super::{REFERENCE, Record, StudyVariant, VariantKind};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Median and range over the seeds.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct MedianRange {
    pub low: f64,
    pub median: f64,
    pub high: f64,
}

/// Seeds without which no two ranges are distinguished: of three and three values, one order of twenty has all of one
/// below all of the other.
const ENOUGH_SEEDS: usize = 3;

impl MedianRange {
    /// `None` for no values.
    pub fn of(mut values: Vec<f64>) -> Option<MedianRange> {
        values.sort_by(f64::total_cmp);
        let (&low, &high) = (values.first()?, values.last()?);
        let half = values.len() / 2;
        let median = if values.len() % 2 == 1 { values[half] } else { (values[half - 1] + values[half]) / 2.0 };
        Some(MedianRange { low, median, high })
    }
}

/// Cost and errors of a variant.
#[derive(Clone, Debug, serde::Serialize)]
pub struct StudyRow {
    pub variant: String,
    pub kind: VariantKind,
    pub seeds: Vec<u64>,
    pub bodies: MedianRange,
    /// CPU seconds, without the measures.
    pub cost: MedianRange,
    /// Solver substeps over all stages.
    pub substeps: MedianRange,
    /// By name: the measured value, or its distance from the reference's median ([`Figure`]).
    pub errors: BTreeMap<&'static str, MedianRange>,
    /// All measured values.
    pub measures: BTreeMap<String, MedianRange>,
    /// Figures for which no variant has a smaller error in less time.
    pub best_in: Vec<&'static str>,
}

/// All rows, in the order of the variants.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Study {
    pub scene: String,
    pub machine: String,
    pub version: &'static str,
    /// The variant that shape errors refer to.
    pub reference: String,
    pub rows: Vec<StudyRow>,
    /// Variants and seeds beyond the budget.
    pub left_out: Vec<String>,
}

impl Study {
    pub fn new(scene: String, machine: String, runs: &[(StudyVariant, Vec<Record>)], left_out: Vec<String>) -> Study {
        let measured = |name: &str, records: &[Record]| {
            MedianRange::of(records.iter().filter_map(|r| r.measures.get(name).copied()).collect())
        };
        let baked = || runs.iter().filter(|(_, records)| !records.is_empty());
        // Without it, the most accurate baked preset is the reference.
        let of_name = baked().find(|(variant, _)| variant.name == REFERENCE);
        let reference = of_name.or_else(|| baked().rfind(|(variant, _)| variant.kind == VariantKind::Preset));
        let over = |figure: &Figure, records: &[Record]| {
            MedianRange::of(records.iter().filter_map(|r| figure.of(&r.measures)).collect())
        };
        let truth = |figure: &Figure| reference.and_then(|(_, records)| over(figure, records)).map(|s| s.median);
        let row = |(variant, records): &(StudyVariant, Vec<Record>)| {
            let counted = |f: &dyn Fn(&Record) -> f64| MedianRange::of(records.iter().map(f).collect());
            let error = |figure: &Figure| {
                let truth = if figure.from_reference { truth(figure)? } else { 0.0 };
                let distance = |r: &Record| Some((figure.of(&r.measures)? - truth).abs());
                Some((figure.name, MedianRange::of(records.iter().filter_map(distance).collect())?))
            };
            let names: std::collections::BTreeSet<&String> = records.iter().flat_map(|r| r.measures.keys()).collect();
            Some(StudyRow {
                variant: variant.name.clone(),
                kind: variant.kind,
                seeds: records.iter().map(|r| r.seed).collect(),
                bodies: counted(&|r| r.bodies as f64)?,
                cost: counted(&Record::cost)?,
                substeps: counted(&|r| r.substeps as f64)?,
                errors: figures::all().filter_map(error).collect(),
                measures: names.into_iter().filter_map(|n| Some((n.clone(), measured(n, records)?))).collect(),
                best_in: Vec::new(),
            })
        };
        let mut rows: Vec<StudyRow> = runs.iter().filter_map(row).collect();
        for figure in figures::all() {
            for i in front(&rows, figure.name) {
                rows[i].best_in.push(figure.name);
            }
        }
        let reference = reference.map_or(String::new(), |(variant, _)| variant.name.clone());
        Study { scene, machine, version: cairn_files::version::VERSION, reference, rows, left_out }
    }

    /// Whether the presets can be ranked by a figure: the first and the last of them differ beyond their seeds, or no
    /// preset differs from another at all.
    pub fn is_ranked(&self, figure: &str) -> bool {
        let presets = self.rows.iter().filter(|row| row.kind == VariantKind::Preset);
        let known: Vec<_> = presets.filter_map(|row| Some((row.seeds.len(), row.errors.get(figure)?))).collect();
        let [(first_seeds, first), .., (last_seeds, last)] = &known[..] else { return true };
        let are_apart = first.high < last.low || last.high < first.low;
        let are_equal = known.iter().all(|(_, error)| *error == known[0].1 && error.low == error.high);
        are_equal || are_apart && (*first_seeds).min(*last_seeds) >= ENOUGH_SEEDS
    }

    /// The headline figures by which the presets cannot be ranked.
    pub fn unranked(&self) -> Vec<&'static str> {
        HEADLINE.iter().map(|figure| figure.name).filter(|name| !self.is_ranked(name)).collect()
    }

    /// Tables in Markdown: the headline figures, and the others.
    pub fn markdown(&self) -> String {
        let mut text = format!(
            "# What accuracy costs: {}\n\n{}CPU seconds without measures, on {}; medians over seeds, with ranges in \
             parentheses. Bold: no cheaper variant has a smaller error; nothing is bold where the presets differ by no \
             more than seeds do.\n\n",
            self.scene,
            self.advice().map_or(String::new(), |advice| advice + "\n\n"),
            self.machine
        );
        self.table(&HEADLINE, &mut text);
        for figure in &HEADLINE {
            let _ = write!(text, "\n- {}", figure.title);
        }
        let _ = write!(
            text,
            "\n\n## Appendix\n\nDistances from `{}`: kept_shape, height_p95_rel, silhouette_iou.\n\n",
            self.reference
        );
        self.table(&APPENDIX, &mut text);
        if !self.left_out.is_empty() {
            let _ = writeln!(text, "\nNot baked within the budget: {}.", self.left_out.join(", "));
        }
        text
    }

    fn table(&self, columns: &[Figure], text: &mut String) {
        let names: Vec<&str> = columns.iter().map(|figure| figure.name).collect();
        let _ = writeln!(text, "| variant | seeds | bodies | CPU s | {} |", names.join(" | "));
        let _ = writeln!(text, "|{}", " --- |".repeat(columns.len() + 4));
        for row in &self.rows {
            let cell = |name: &&str| {
                let Some(error) = row.errors.get(name) else { return String::from("-") };
                let mark = if row.best_in.contains(name) && self.is_ranked(name) { "**" } else { "" };
                format!("{mark}{}{mark} ({} to {})", short(error.median), short(error.low), short(error.high))
            };
            let cells: Vec<String> = names.iter().map(cell).collect();
            let (name, seeds, bodies) = (&row.variant, row.seeds.len(), row.bodies.median);
            let cost = format!("{:.2} ({:.2} to {:.2})", row.cost.median, row.cost.low, row.cost.high);
            let _ = writeln!(text, "| {name} | {seeds} | {bodies} | {cost} | {} |", cells.join(" | "));
        }
    }
}

/// Two significant digits.
pub fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let digits = (1.0 - libm::log10(value.abs()).floor()).clamp(0.0, 6.0) as usize;
    if value.abs() < 1e-4 { format!("{value:.1e}") } else { format!("{value:.digits$}") }
}

/// The Pareto front: rows for which no other row has a smaller error at the same or a lower cost, cheapest first.
pub fn front(rows: &[StudyRow], name: &str) -> Vec<usize> {
    let mut order: Vec<(f64, f64, usize)> = rows
        .iter()
        .enumerate()
        .filter_map(|(i, row)| Some((row.cost.median, row.errors.get(name)?.median, i)))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut least = f64::INFINITY;
    order.retain(|&(_, error, _)| {
        let better = error < least;
        least = least.min(error);
        better
    });
    order.into_iter().map(|(_, _, i)| i).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_prepare::estimate::Workload;

    const WORKLOAD: Workload = Workload {
        bodies: 10.0,
        filled: 10.0,
        corners: 8.0,
        parts: 1.0,
        slenderness: 2.0,
        walls: 12.0,
        times: 10.0,
        step_rate: 20.0,
        substeps: 8.0,
        fill_cost_factor: 1.0,
        glue_cost_factor: 1.0,
        coulomb: false,
        glued: false,
        room: 0.0,
        packing: [0.0; 7],
        primitive: 0.0,
    };

    fn run(name: &str, cost: f64, error: f64, kept: f64) -> (StudyVariant, Vec<Record>) {
        let record = |seed: u64| Record {
            key: String::new(),
            variant: name.into(),
            seed,
            bodies: 10,
            substeps: 100,
            workload: WORKLOAD,
            seconds: [("fill".to_owned(), cost), ("measure".to_owned(), 50.0)].into(),
            measures: [("visible_depth_p95_rel".to_owned(), error * seed as f64), ("shape_iou".to_owned(), kept)]
                .into(),
        };
        let variant = StudyVariant { name: name.into(), kind: VariantKind::Preset, set: Vec::new() };
        (variant, [1, 2, 3].map(record).into())
    }

    #[test]
    fn medians_ranges_reference_and_front() {
        let runs = [run("draft", 1.0, 0.2, 0.8), run("worse", 2.0, 0.3, 0.9), run("reference", 4.0, 0.05, 0.95)];
        let study = Study::new("x".into(), "y".into(), &runs, Vec::new());
        let draft = &study.rows[0];
        assert_eq!(draft.cost, MedianRange { low: 1.0, median: 1.0, high: 1.0 });
        assert_eq!(draft.errors["overlap"].median, 0.4);
        assert!((draft.errors["shape"].median - 0.15).abs() < 1e-12);
        assert_eq!(front(&study.rows, "overlap"), [0, 2]);
        assert_eq!(study.rows[1].best_in, ["shape"]);
        assert!(study.markdown().contains("| draft | 3 | 10 | 1.00 (1.00 to 1.00) |"));
    }

    #[test]
    fn what_differs_by_no_more_than_seeds_is_not_ranked() {
        // Errors of the seeds 1 to 3 are 1, 2 and 3 times as large.
        let study = |errors: [f64; 2], seeds: usize| {
            let mut runs = [run("draft", 1.0, errors[0], 0.8), run("reference", 4.0, errors[1], 0.8)];
            runs.iter_mut().for_each(|(_, records)| records.truncate(seeds));
            Study::new("x".into(), "y".into(), &runs, Vec::new())
        };
        assert!(study([0.4, 0.1], 3).is_ranked("overlap"), "0.4 to 1.2, and 0.1 to 0.3");
        let alike = study([0.4, 0.2], 3);
        assert_eq!(alike.unranked(), ["overlap"], "0.4 to 1.2, and 0.2 to 0.6");
        assert!(alike.advice().unwrap().contains("too few seeds to rank the presets by overlap"));
        assert!(!alike.markdown().contains("| **0.40** |"));
        assert!(!study([0.4, 0.1], 2).is_ranked("overlap"), "two seeds");
        // The shape of the only pile of the reference is no truth.
        let mut runs = [run("draft", 1.0, 0.0, 0.8), run("reference", 4.0, 0.0, 0.9)];
        assert!(Study::new("x".into(), "y".into(), &runs, Vec::new()).advice().unwrap().contains("Choose `reference`"));
        runs[1].1.truncate(1);
        assert!(Study::new("x".into(), "y".into(), &runs, Vec::new()).advice().unwrap().contains("Choose `draft`"));
        assert!(study([0.0, 0.0], 3).is_ranked("overlap"), "equal");
    }

    #[test]
    fn the_most_accurate_preset_replaces_a_missing_reference() {
        let runs = [run("draft", 1.0, 0.2, 0.8), run("fine", 2.0, 0.1, 0.9)];
        assert_eq!(Study::new("x".into(), "y".into(), &runs, vec!["reference".into()]).reference, "fine");
    }
}
