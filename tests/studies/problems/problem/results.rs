//! What was measured, and what is on the front.

use super::Problem;
use anyhow::Context;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// `results.json`.
#[derive(Serialize, Deserialize)]
pub struct Study {
    pub machine: String,
    pub cores: u32,
    /// Smallest and largest mean number of processes that ran or waited.
    pub load: [f64; 2],
    pub problems: Vec<Measured>,
}

#[derive(Serialize, Deserialize)]
pub struct Measured {
    pub problem: String,
    pub rows: Vec<Row>,
}

/// An engine with one setting.
#[derive(Serialize, Deserialize)]
pub struct Row {
    pub engine: String,
    pub settings: String,
    pub kind: Kind,
    /// CPU milliseconds for each simulated second, round by round.
    pub cpu: Vec<f64>,
    /// `None`: it was stopped, since it took too long.
    pub error: Option<f64>,
}

#[derive(Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    Preset,
    /// A preset with the control on.
    Control,
    /// A preset with one parameter changed.
    Parameter,
    Peer,
}

/// By how much `reference` must err more than `draft` to be worse, in shares of an error that is seen.
const WORSE: f64 = 0.1;

/// Whether the most expensive preset is worse than the cheapest one.
pub fn is_worse(problem: &Problem, draft: f64, reference: f64) -> bool {
    reference.max(problem.least) > draft.max(problem.least) + WORSE * problem.seen
}

impl Row {
    /// Median of the rounds.
    pub fn cost(&self) -> f64 {
        let mut rounds = self.cpu.clone();
        rounds.sort_by(f64::total_cmp);
        rounds[rounds.len() / 2]
    }

    pub fn name(&self) -> String {
        format!("{} ({})", self.engine, self.settings)
    }
}

impl Measured {
    /// The error, at least what rounding makes of it.
    pub fn error(row: &Row, problem: &Problem) -> Option<f64> {
        row.error.map(|error| error.max(problem.least))
    }

    pub fn preset(&self, name: &str) -> &Row {
        let is_asked = |row: &&Row| row.kind == Kind::Preset && row.settings == name;
        self.rows.iter().find(is_asked).expect("every preset is measured")
    }

    /// Whether its `reference` errs more than its `draft`.
    pub fn is_out_of_order(&self, problem: &Problem) -> bool {
        let [draft, reference] =
            ["draft", "reference"].map(|name| self.preset(name).error.expect("presets are never stopped"));
        is_worse(problem, draft, reference)
    }

    /// `standard` as a bake is delivered: with its control, where something stands.
    pub fn delivered(&self, problem: &Problem) -> &Row {
        self.of_kind(Kind::Control).find(|_| problem.stands).unwrap_or_else(|| self.preset("standard"))
    }

    pub fn of_kind(&self, kind: Kind) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(move |row| row.kind == kind)
    }

    /// The peers that are both cheaper and more accurate than this row.
    pub fn beaten_by<'a>(&'a self, row: &'a Row, problem: &'a Problem) -> impl Iterator<Item = &'a Row> {
        let error = Self::error(row, problem).unwrap_or(f64::INFINITY);
        self.of_kind(Kind::Peer).filter(move |peer| {
            peer.cost() < row.cost() && Self::error(peer, problem).is_some_and(|other| other < error)
        })
    }
}

impl Study {
    pub fn read(path: &Path) -> anyhow::Result<Study> {
        let text = std::fs::read(path).with_context(|| path.display().to_string())?;
        serde_json::from_slice(&text).with_context(|| path.display().to_string())
    }

    pub fn of(&self, problem: &Problem) -> &Measured {
        self.problems.iter().find(|m| m.problem == problem.name).expect("every problem is measured")
    }
}
