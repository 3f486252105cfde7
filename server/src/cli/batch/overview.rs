//! The progress and the outcomes of a batch.

use super::process_pool::BakeEnd;
use crate::batch::Variant;
use crate::cli;
use crate::cli::progress::{Display, Mode, openjd};
use cairn_job::report::ReportFile;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Shows the progress of all bakes together.
pub struct BatchProgress {
    display: Display<ProgressBar>,
    bakes: usize,
    ended: usize,
    failed: usize,
    /// Progress of the running bakes.
    fractions: BTreeMap<usize, f64>,
    shown: Option<Instant>,
}

/// Units of the bar for each bake.
const PARTS: f64 = 100.0;

impl BatchProgress {
    pub fn new(mode: Mode, bakes: usize) -> BatchProgress {
        let bar = || {
            let style = ProgressStyle::with_template("{bar:24} {percent:>3} %  {msg}  {elapsed}, {eta} left");
            ProgressBar::with_draw_target(Some((bakes as f64 * PARTS) as u64), ProgressDrawTarget::stderr())
                .with_style(style.expect("the template is valid"))
        };
        let display = mode.display(bar);
        BatchProgress { display, bakes, ended: 0, failed: 0, fractions: BTreeMap::new(), shown: None }
    }

    pub fn update(&mut self, task: usize, fraction: f64) {
        self.fractions.insert(task, fraction);
        let pause = match &self.display {
            Display::Bar(_) | Display::Json => Duration::from_millis(100),
            Display::Openjd => Duration::from_secs(1),
            Display::Plain | Display::Nothing => Duration::MAX,
        };
        if self.shown.is_none_or(|shown| shown.elapsed() >= pause) {
            self.show();
        }
    }

    pub fn end(&mut self, task: usize, end: &BakeEnd, name: &str) {
        self.fractions.remove(&task);
        self.ended += 1;
        self.failed += usize::from(!matches!(end, BakeEnd::Done));
        if let (BakeEnd::Failed(_, why), Display::Bar(bar)) = (end, &self.display) {
            bar.println(format!("{name}: failed: {why}"));
        }
        if let Display::Plain = self.display {
            let how = match end {
                BakeEnd::Done => "baked".to_owned(),
                BakeEnd::Cancelled => "cancelled".to_owned(),
                BakeEnd::Failed(_, why) => format!("failed: {why}"),
            };
            eprintln!("{}/{}  {name}: {how}", self.ended, self.bakes);
        }
        self.show();
    }

    fn show(&mut self) {
        self.shown = Some(Instant::now());
        let done = self.ended as f64 + self.fractions.values().sum::<f64>();
        let fraction = if self.bakes > 0 { done / self.bakes as f64 } else { 1.0 };
        match &self.display {
            Display::Bar(bar) => {
                let failed = if self.failed > 0 { format!(", {} failed", self.failed) } else { String::new() };
                bar.set_position((done * PARTS) as u64);
                bar.set_message(format!("{}/{} bakes{failed}", self.ended, self.bakes));
            }
            Display::Json => {
                let counts =
                    json!({ "fraction": fraction, "done": self.ended, "failed": self.failed, "of": self.bakes });
                eprintln!("{counts}");
            }
            Display::Openjd => {
                openjd("progress", &format!("{:.1}", fraction * 100.0));
                openjd("status", &format!("{} of {} bakes, {} failed", self.ended, self.bakes, self.failed));
            }
            Display::Plain | Display::Nothing => {}
        }
    }

    pub fn finish(&self) {
        if let Display::Bar(bar) = &self.display {
            bar.finish_and_clear();
        }
    }
}

/// The outcome of a variant.
pub enum VariantOutcome {
    /// It was finished before.
    Skipped,
    Baked,
    Failed(String),
    /// The batch was cancelled first.
    NotBaked,
}

impl VariantOutcome {
    /// Its result is there.
    fn is_there(&self) -> bool {
        matches!(self, VariantOutcome::Skipped | VariantOutcome::Baked)
    }
}

/// The report of a variant whose result is there.
fn report(variant: &Variant, outcome: &VariantOutcome) -> Option<ReportFile> {
    let read = || serde_json::from_slice(&std::fs::read(variant.report()).ok()?).ok();
    outcome.is_there().then(read).flatten()
}

/// The same as JSON.
pub fn json(rows: &[(&Variant, VariantOutcome)]) -> Value {
    let row = |(variant, outcome): &(&Variant, VariantOutcome)| {
        let (state, error) = match outcome {
            VariantOutcome::Skipped => ("finished before", None),
            VariantOutcome::Baked => ("baked", None),
            VariantOutcome::Failed(why) => ("failed", Some(why)),
            VariantOutcome::NotBaked => ("not baked", None),
        };
        let report = report(variant, outcome);
        json!({
            "index": variant.index,
            "result": variant.output,
            "state": state,
            "error": error,
            "bodies": report.as_ref().and_then(|report| report.bodies),
            "shape_iou": report.as_ref().and_then(|report| *report.measures.get("shape_iou")?),
            "kept_shape": report.as_ref().and_then(|report| *report.measures.get("kept_shape")?),
            "cpu_seconds": report.as_ref().and_then(|report| report.cpu_seconds),
        })
    };
    rows.iter().map(row).collect()
}

/// A table with a row for each variant.
pub fn table(rows: &[(&Variant, VariantOutcome)]) -> String {
    let row = |(variant, outcome): &(&Variant, VariantOutcome)| {
        let state = match outcome {
            VariantOutcome::Skipped => "finished before".to_owned(),
            VariantOutcome::Baked => "baked".to_owned(),
            VariantOutcome::Failed(why) => format!("FAILED: {}", why.lines().next().unwrap_or_default()),
            VariantOutcome::NotBaked => "not baked".to_owned(),
        };
        let report = report(variant, outcome);
        let figure = |get: fn(&ReportFile) -> Option<f64>, digits| {
            report.as_ref().and_then(get).map_or(String::new(), |value| format!("{value:.digits$}"))
        };
        vec![
            variant.output.display().to_string(),
            state,
            figure(|report| report.bodies, 0),
            figure(|report| *report.measures.get("shape_iou")?, 3),
            figure(|report| *report.measures.get("kept_shape")?, 3),
            figure(|report| report.cpu_seconds, 1),
        ]
    };
    let header = ["result", "", "bodies", "match", "kept shape", "CPU s"].map(str::to_owned).into();
    let mut text = cli::table(header, rows.iter().map(row));
    let count = |is: fn(&VariantOutcome) -> bool| rows.iter().filter(|(_, outcome)| is(outcome)).count();
    let counts = [
        (count(|outcome| matches!(outcome, VariantOutcome::Baked)), "baked"),
        (count(|outcome| matches!(outcome, VariantOutcome::Skipped)), "finished before"),
        (count(|outcome| matches!(outcome, VariantOutcome::Failed(_))), "failed"),
        (count(|outcome| matches!(outcome, VariantOutcome::NotBaked)), "not baked"),
    ];
    let counts = counts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
    text += &format!("{}\n", counts.collect::<Vec<_>>().join(", "));
    text
}
