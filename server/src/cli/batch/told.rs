//! How far a batch is, and how it went.

use super::crew::End;
use crate::batch::Variant;
use crate::cli::progress::{Mode, openjd};
use comfy_table::{CellAlignment, Table, presets};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Deserialize;
use serde_json::json;
use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// Tells how far all bakes together are.
pub struct Overall {
    show: Show,
    bakes: usize,
    ended: usize,
    failed: usize,
    /// Of those that run.
    fractions: BTreeMap<usize, f64>,
    told: Option<Instant>,
}

enum Show {
    Bar(ProgressBar),
    Plain,
    Json,
    Openjd,
    Nothing,
}

/// Parts of the bar for each bake.
const PARTS: f64 = 100.0;

impl Overall {
    pub fn new(mode: Mode, bakes: usize) -> Overall {
        let bar = || {
            let style = ProgressStyle::with_template("{bar:24} {percent:>3} %  {msg}  {elapsed}, {eta} left");
            ProgressBar::with_draw_target(Some((bakes as f64 * PARTS) as u64), ProgressDrawTarget::stderr())
                .with_style(style.expect("the template is valid"))
        };
        let show = match mode {
            Mode::Auto if std::io::stderr().is_terminal() => Show::Bar(bar()),
            Mode::Auto | Mode::Plain => Show::Plain,
            Mode::Json => Show::Json,
            Mode::Openjd => Show::Openjd,
            Mode::None => Show::Nothing,
        };
        Overall { show, bakes, ended: 0, failed: 0, fractions: BTreeMap::new(), told: None }
    }

    pub fn progress(&mut self, task: usize, fraction: f64) {
        self.fractions.insert(task, fraction);
        let pause = match &self.show {
            Show::Bar(_) | Show::Json => Duration::from_millis(100),
            Show::Openjd => Duration::from_secs(1),
            Show::Plain | Show::Nothing => Duration::MAX,
        };
        if self.told.is_none_or(|told| told.elapsed() >= pause) {
            self.tell();
        }
    }

    pub fn end(&mut self, task: usize, end: &End, name: &str) {
        self.fractions.remove(&task);
        self.ended += 1;
        self.failed += usize::from(!matches!(end, End::Done));
        if let (End::Failed(_, why), Show::Bar(bar)) = (end, &self.show) {
            bar.println(format!("{name}: failed: {why}"));
        }
        if let Show::Plain = self.show {
            let how = match end {
                End::Done => "baked".to_owned(),
                End::Cancelled => "cancelled".to_owned(),
                End::Failed(_, why) => format!("failed: {why}"),
            };
            eprintln!("{}/{}  {name}: {how}", self.ended, self.bakes);
        }
        self.tell();
    }

    fn tell(&mut self) {
        self.told = Some(Instant::now());
        let done = self.ended as f64 + self.fractions.values().sum::<f64>();
        let fraction = if self.bakes > 0 { done / self.bakes as f64 } else { 1.0 };
        match &self.show {
            Show::Bar(bar) => {
                let failed = if self.failed > 0 { format!(", {} failed", self.failed) } else { String::new() };
                bar.set_position((done * PARTS) as u64);
                bar.set_message(format!("{}/{} bakes{failed}", self.ended, self.bakes));
            }
            Show::Json => {
                let counts =
                    json!({ "fraction": fraction, "done": self.ended, "failed": self.failed, "of": self.bakes });
                eprintln!("{counts}");
            }
            Show::Openjd => {
                openjd("progress", &format!("{:.1}", fraction * 100.0));
                openjd("status", &format!("{} of {} bakes, {} failed", self.ended, self.bakes, self.failed));
            }
            Show::Plain | Show::Nothing => {}
        }
    }

    pub fn finish(&self) {
        if let Show::Bar(bar) = &self.show {
            bar.finish_and_clear();
        }
    }
}

/// How a variant went.
pub enum Outcome {
    /// It was there.
    Skipped,
    Baked,
    Failed(String),
    /// The batch was ended before.
    NotBaked,
}

/// Figures of a report that the table shows.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Figures {
    bodies: Option<u64>,
    measures: BTreeMap<String, Option<f64>>,
    cpu_seconds: Option<f64>,
}

/// A row for each variant.
pub fn table(rows: &[(&Variant, Outcome)]) -> String {
    let mut table = Table::new();
    table.load_style(presets::NOTHING);
    table.set_header(["result", "", "bodies", "kept shape", "CPU s"]);
    for column in table.column_iter_mut().skip(2) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    for (variant, outcome) in rows {
        let (state, is_there) = match outcome {
            Outcome::Skipped => ("was there".to_owned(), true),
            Outcome::Baked => ("baked".to_owned(), true),
            Outcome::Failed(why) => (format!("FAILED: {}", why.lines().next().unwrap_or_default()), false),
            Outcome::NotBaked => ("not baked".to_owned(), false),
        };
        let read = || serde_json::from_slice(&std::fs::read(variant.report()).ok()?).ok();
        let figures: Figures = if is_there { read().unwrap_or_default() } else { Figures::default() };
        let number = |value: Option<f64>, digits| value.map_or(String::new(), |value| format!("{value:.digits$}"));
        table.add_row([
            variant.output.display().to_string(),
            state,
            figures.bodies.map_or(String::new(), |bodies| bodies.to_string()),
            number(figures.measures.get("kept_shape").copied().flatten(), 3),
            number(figures.cpu_seconds, 1),
        ]);
    }
    let mut text: String = table.lines().map(|line| line.trim().to_owned() + "\n").collect();
    let count = |is: fn(&Outcome) -> bool| rows.iter().filter(|(_, outcome)| is(outcome)).count();
    let counts = [
        (count(|outcome| matches!(outcome, Outcome::Baked)), "baked"),
        (count(|outcome| matches!(outcome, Outcome::Skipped)), "were there"),
        (count(|outcome| matches!(outcome, Outcome::Failed(_))), "failed"),
        (count(|outcome| matches!(outcome, Outcome::NotBaked)), "not baked"),
    ];
    let told = counts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
    text += &format!("{}\n", told.collect::<Vec<_>>().join(", "));
    text
}
