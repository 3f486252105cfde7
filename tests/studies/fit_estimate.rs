//! Fits the model behind the estimate of a bake's CPU time, and prints how far it is from what it was fitted to:
//! `cargo study fit_estimate -- runs.jsonl...`.
//!
//! The runs are those of `cairn cost` and of the example `pairs`. Least squares of the logarithms, each file with the
//! same weight: how far the present exponents of `server/prepare/src/estimate/model.rs` have to move, which counts
//! against it as much as a few files do; printed as its constants. Only exponents that differ enough between piles
//! move. The cost is taken to grow as the number of bodies: a file has about one number, so that an exponent could not
//! be separated from what else distinguishes the files. Figures are those of `cairn cost`, which measures more than a
//! bake does: their time is no part of it.

use anyhow::{Context, ensure};
use cairn::cost::Record;
use cairn_core::calibrate::calibrate;
use cairn_prepare::estimate::{CostExponents, FEATURES, GLUED_RELEASE, LAWS};
use cairn_prepare::packing;
use clap::Parser;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A bake, of the file with this number.
struct Run {
    of: usize,
    weight: f64,
    record: Record,
}

/// Fits the model of a bake's CPU time to measured bakes.
#[derive(Parser)]
struct Arguments {
    /// Files of runs, as `cairn cost` and the example `pairs` leave them
    #[arg(required = true)]
    runs: Vec<PathBuf>,
}

/// Of the packing's exponents, against a weight of 1 for each fill.
const RIDGE: f64 = 1e-3;
/// A change of an exponent by 1 counts as much as so many files that are off by a factor of e.
const INERTIA: f64 = 3.0;
/// The exponents that move. The first one is the factor, which moves freely.
const MOVES: [&str; 3] = ["1", "corners", "parts"];
/// Shorter stages are noise, s.
const SHORTEST: f64 = 0.02;
/// The stages of the laws, in the order of [`LAWS`], by the names of the constants.
const STAGES: [(&str, &[&str]); 3] =
    [("FILL", &["fill"]), ("GLUE", &["glue"]), ("RELEASE_AND_HOLD", &["release", "hold"])];

fn main() -> anyhow::Result<()> {
    let mut runs: Vec<Run> = Vec::new();
    let paths = Arguments::parse().runs;
    for (of, path) in paths.iter().enumerate() {
        let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
        let records: Vec<Record> = text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
        ensure!(!records.is_empty(), "{}: no run of this version is in it", path.display());
        tell_kept(&records);
        // Their laws are of bakes as the accuracy has them.
        let records: Vec<Record> =
            records.into_iter().filter(|r| r.variant != "natural" && !r.variant.starts_with("tacky")).collect();
        let weight = 1.0 / records.len() as f64;
        runs.extend(records.into_iter().map(|record| Run { of, weight, record }));
    }
    println!(
        "pub const CALIBRATION_SECONDS: f64 = {:.4};",
        calibrate(cairn_job::machine::cpu_seconds)? * cairn_prepare::estimate::CALIBRATION_SECONDS
    );
    let laws = fit_all(&runs.iter().collect::<Vec<_>>());
    for ((name, _), law) in STAGES.iter().zip(&laws) {
        let numbers: Vec<String> = law.iter().map(|w| format!("{w:.3}")).collect();
        println!("/// Of {}.\npub const {name}: CostExponents = [{}];", FEATURES.join(", "), numbers.join(", "));
    }
    let filled: Vec<&Record> = runs.iter().map(|run| &run.record).filter(|r| r.workload.room > 0.0).collect();
    let reached = |r: &Record| (r.bodies as f64 / r.workload.room).ln();
    let a = DMatrix::from_fn(filled.len(), packing::FEATURES.len(), |i, j| filled[i].workload.packing[j]);
    let b = DVector::from_fn(filled.len(), |i, _| reached(filled[i]));
    let law = least_deviations(&a, &b);
    // Each fill by the law of all others.
    let alone = |i: usize| {
        let law = least_deviations(&a.clone().remove_row(i), &b.clone().remove_row(i));
        ((a.row(i) * law)[0] - b[i]).abs().exp()
    };
    let mut off: Vec<f64> = (0..filled.len()).map(alone).collect();
    off.sort_by(f64::total_cmp);
    println!(
        "/// Of {}; of fills that it was not fitted to, {:.0} % within 20 %, nine of ten within a factor of {:.2}.\n\
         const PACKING: Weights = [{}];\npub const FACTOR: f64 = {:.2};",
        packing::FEATURES.join(", "),
        100.0 * off.iter().filter(|e| **e <= 1.2).count() as f64 / off.len() as f64,
        off[(off.len() - 1) * 9 / 10],
        law.iter().map(|w| format!("{w:.3}")).collect::<Vec<_>>().join(", "),
        off[(off.len() - 1) * 9 / 10]
    );
    let dots =
        |r: &Record| Some(r.measures.get("touches")? * r.measures.get("glued_touch_fraction")? / r.bodies as f64);
    let mut dots: Vec<f64> = runs.iter().filter_map(|run| dots(&run.record)).collect();
    dots.sort_by(f64::total_cmp);
    println!("/// Median over the bakes.\npub const DOTS_PER_BODY: f64 = {:.2};", dots[dots.len() / 2]);
    print_present(&runs);
    for (number, path) in paths.iter().enumerate() {
        let of = |own: bool| runs.iter().filter(move |run| (run.of == number) == own);
        let others: Vec<&Run> = of(false).collect();
        print_error(&format!("{}, by its own law", path.display()), &laws, of(true));
        if !others.is_empty() {
            print_error(&format!("{}, by the law of the other files", path.display()), &fit_all(&others), of(true));
        }
    }
    Ok(())
}

/// The law with the least sum of deviations: single odd fills do not bend it. By weighted least squares, again and
/// again.
fn least_deviations(a: &DMatrix<f64>, b: &DVector<f64>) -> DVector<f64> {
    /// Below this, a deviation weighs by its square.
    const SMALL: f64 = 0.05;
    const ROUNDS: usize = 40;
    let mut weights = DVector::from_element(b.len(), 1.0);
    let mut law = DVector::zeros(a.ncols());
    for _ in 0..ROUNDS {
        let weighted = DMatrix::from_diagonal(&weights) * a;
        let normal = a.transpose() * &weighted + DMatrix::identity(a.ncols(), a.ncols()) * RIDGE;
        law = normal.cholesky().expect("a ridge makes it positive definite").solve(&(weighted.transpose() * b));
        weights = (a * &law - b).map(|e| 1.0 / e.abs().max(SMALL));
    }
    law
}

/// What is kept with glue of each strength that was tried, and how many dots that takes.
fn tell_kept(records: &[Record]) {
    let mut by_strength = BTreeMap::<&str, (Vec<f64>, Vec<f64>)>::new();
    for record in records.iter().filter(|r| records.iter().any(|o| o.key == r.key && o.variant == "natural")) {
        let figure = |name: &str| record.measures.get(name).copied();
        if let Some(kept) = figure("kept_shape") {
            let (shapes, shares) = by_strength.entry(&record.variant).or_default();
            shapes.push(kept);
            shares.push(figure("glued_touch_fraction").unwrap_or(0.0));
        }
    }
    for (variant, (mut shapes, mut shares)) in by_strength {
        shapes.sort_by(f64::total_cmp);
        shares.sort_by(f64::total_cmp);
        let at = |all: &[f64], tenths: usize| all[(all.len() - 1) * tenths / 10];
        println!(
            "// {variant}: {} pairs, kept {:.2}, {:.2}, {:.2}; of the touches {:.3} glued",
            shapes.len(),
            at(&shapes, 1),
            at(&shapes, 5),
            at(&shapes, 9),
            at(&shares, 5)
        );
    }
}

fn predict(law: &CostExponents, record: &Record) -> f64 {
    record.workload.features().iter().zip(law).map(|(f, w)| f * w).sum::<f64>().exp()
}

/// What a stage of the law took.
fn seconds(record: &Record, stages: &[&str]) -> f64 {
    stages.iter().filter_map(|stage| record.seconds.get(*stage)).sum()
}

/// How much longer than at `standard` the record's accuracy takes for these stages: the laws are of `standard`, and of
/// piles that are not glued.
fn care(record: &Record, stages: &[&str]) -> f64 {
    match stages {
        ["fill"] => record.workload.fill_cost_factor,
        ["glue"] => record.workload.glue_cost_factor,
        _ if record.workload.glued => GLUED_RELEASE,
        _ => 1.0,
    }
}

fn fit_all(runs: &[&Run]) -> Vec<CostExponents> {
    STAGES.iter().zip(&LAWS).map(|((_, stages), present)| fit(runs, stages, present)).collect()
}

/// Prints how far laws are from these runs.
fn print_error<'r>(of: &str, laws: &[CostExponents], runs: impl Iterator<Item = &'r Run>) {
    let far = |Run { record, .. }: &Run| {
        let stages = STAGES.iter().zip(laws).filter(|((_, stages), _)| seconds(record, stages) > 0.0);
        let (expected, taken) = stages.fold((0.0, 0.0), |(expected, taken), ((_, stages), law)| {
            (expected + care(record, stages) * predict(law, record), taken + seconds(record, stages))
        });
        (expected / taken).ln().abs().exp()
    };
    print_within(of, runs.map(far).collect());
}

fn print_within(of: &str, mut far: Vec<f64>) {
    far.sort_by(f64::total_cmp);
    let at = |share: f64| far[((far.len() - 1) as f64 * share) as usize];
    let (half, most, all) = (at(0.5), at(0.9), at(1.0));
    println!("// {of}: {} runs within a factor of {half:.2} (half), {most:.2} (90 %), {all:.2} (all)", far.len());
}

/// Prints how far the present laws are from these runs, but for one factor, that of the machine.
fn print_present(runs: &[Run]) {
    let off = |Run { record, .. }: &Run| {
        let [fill, glue, release, _] = record.workload.stage_seconds();
        (seconds(record, &["fill", "glue", "release", "hold"]) / (fill + glue + release)).ln()
    };
    let mut offs: Vec<f64> = runs.iter().map(off).collect();
    offs.sort_by(f64::total_cmp);
    let machine = offs[offs.len() / 2];
    let of = format!("all files, by the present laws times {:.2}", machine.exp());
    print_within(&of, offs.iter().map(|off| (off - machine).abs().exp()).collect());
}

/// Weighted least squares of the logarithm of the seconds, from the present exponents on. A glued pile hardly moves:
/// its release is no part of that law.
fn fit(runs: &[&Run], stages: &[&str], present: &CostExponents) -> CostExponents {
    let is_used = |run: &&&Run| {
        let is_glue = stages == ["glue"];
        seconds(&run.record, stages) > SHORTEST && (stages == ["fill"] || run.record.workload.glued == is_glue)
    };
    let used: Vec<&&Run> = runs.iter().filter(is_used).collect();
    let columns: Vec<usize> = (0..FEATURES.len()).filter(|&i| MOVES.contains(&FEATURES[i])).collect();
    let row = |i: usize, j: usize| used[i].weight.sqrt() * used[i].record.workload.features()[columns[j]];
    let a = DMatrix::from_fn(used.len(), columns.len(), row);
    let b = DVector::from_fn(used.len(), |i, _| {
        let record = &used[i].record;
        let expected = care(record, stages) * predict(present, record);
        used[i].weight.sqrt() * (seconds(record, stages) / expected).ln()
    });
    let inertia = |i: usize, j: usize| if i == j && FEATURES[columns[i]] != "1" { INERTIA } else { 0.0 };
    let normal = a.transpose() * &a + DMatrix::from_fn(columns.len(), columns.len(), inertia);
    let moved = normal.lu().solve(&(a.transpose() * b)).unwrap_or_else(|| DVector::zeros(columns.len()));
    let mut law = *present;
    columns.iter().zip(moved.iter()).for_each(|(&i, by)| law[i] += by);
    law
}
