//! Gathers everything that is wrong with a file. A [`Reported`] in a `Result` says that the reason is already in the
//! [`Log`].

use crate::problem::{AssetProblem, ProblemKind};
use crate::remedy;
use std::collections::{BTreeMap, BTreeSet};

/// Problems reported of one file; the rest is counted. A broken exporter repeats itself, and nobody reads further.
const MOST_PROBLEMS: usize = 40;

/// An error whose reason is already in the log.
#[derive(Clone, Copy, Debug)]
pub struct Reported;

pub type Logged<T> = Result<T, Reported>;

/// "1 body" or "2 bodies", for messages.
pub fn counted(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

/// Everything found in one file so far.
pub struct Log {
    file: String,
    /// Extensions reported already: one that every primitive uses is one reason.
    extensions: BTreeSet<String>,
    problems: Vec<AssetProblem>,
    more: usize,
    notes: BTreeMap<&'static str, (usize, String)>,
}

impl Log {
    pub fn new(file: &str) -> Log {
        Log {
            file: file.to_owned(),
            extensions: BTreeSet::new(),
            problems: Vec::new(),
            more: 0,
            notes: BTreeMap::new(),
        }
    }

    /// Adds a problem: the file is refused.
    pub fn refuse(&mut self, place: impl Into<String>, what: ProblemKind) -> Reported {
        if let ProblemKind::Extension { name } = &what
            && !self.extensions.insert(name.clone())
        {
            return Reported;
        }
        if self.problems.len() < MOST_PROBLEMS {
            let remedy = remedy::of(&what);
            self.problems.push(AssetProblem { file: self.file.clone(), place: place.into(), what, remedy });
        } else {
            self.more += 1;
        }
        Reported
    }

    /// Adds a note of something that is not read as it stands in the file. The same `what` makes one note, with the
    /// first place and a count.
    pub fn note(&mut self, what: &'static str, place: &str) {
        self.notes.entry(what).or_insert_with(|| (0, place.to_owned())).0 += 1;
    }

    /// There is a problem: the file is refused.
    pub fn any(&self) -> bool {
        !self.problems.is_empty()
    }

    /// Problems so far, including those that are only counted.
    pub(crate) fn count(&self) -> usize {
        self.problems.len() + self.more
    }

    /// Whether further problems are only counted.
    pub(crate) fn is_full(&self) -> bool {
        self.problems.len() >= MOST_PROBLEMS
    }

    /// The notes in the order of their text, one sentence each.
    pub fn notes(&self) -> Vec<String> {
        let sentence = |(what, (count, place)): (&&str, &(usize, String))| match (count, place.is_empty()) {
            (_, true) => (*what).to_owned(),
            (1, false) => format!("{place}: {what}"),
            (n, false) => format!("{place} and {} more: {what}", n - 1),
        };
        self.notes.iter().map(sentence).collect()
    }

    pub fn into_problems(mut self) -> Vec<AssetProblem> {
        if self.more > 0 {
            let what = ProblemKind::More { count: self.more };
            let remedy = remedy::of(&what);
            self.problems.push(AssetProblem { file: self.file.clone(), place: String::new(), what, remedy });
        }
        self.problems
    }
}
