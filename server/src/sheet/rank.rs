//! Results in a folder, by the figures of their reports.

use crate::files;
use crate::problem::{Problem, nearest};
use serde::Deserialize;
use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// A result with its report.
pub struct Candidate {
    /// Its file's name without the ending.
    pub name: String,
    pub path: PathBuf,
    pub bytes: Vec<u8>,
    pub figures: BTreeMap<String, f64>,
}

impl Candidate {
    /// A figure for a person.
    pub fn told(&self, figure: &str) -> Option<String> {
        let value = *self.figures.get(figure)?;
        let size = value.abs();
        Some(match figure {
            _ if value.fract() == 0.0 && size < 1e15 => format!("{value:.0}"),
            _ if size < 1e-3 => format!("{value:.1e}"),
            _ if size < 10.0 => format!("{value:.3}"),
            _ => format!("{value:.1}"),
        })
    }
}

/// A figure to order by.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Key {
    pub figure: String,
    /// The smallest comes first.
    pub least: bool,
}

impl FromStr for Key {
    type Err = String;

    fn from_str(text: &str) -> Result<Key, String> {
        match text.split_once(':') {
            None | Some((_, "most")) => Ok(Key { figure: text.trim_end_matches(":most").to_owned(), least: false }),
            Some((figure, "least")) => Ok(Key { figure: figure.to_owned(), least: true }),
            Some((_, other)) => Err(format!("`{other}` is no order; write :least or :most")),
        }
    }
}

#[derive(Deserialize)]
struct Report {
    output_blake3: String,
    seed: Option<f64>,
    bodies: Option<f64>,
    cpu_seconds: Option<f64>,
    #[serde(default)]
    measures: BTreeMap<String, Option<f64>>,
    #[serde(default)]
    counts: BTreeMap<String, f64>,
}

impl Report {
    fn figures(self) -> BTreeMap<String, f64> {
        let own = [("seed", self.seed), ("bodies", self.bodies), ("cpu_seconds", self.cpu_seconds)];
        let own = own.into_iter().map(|(name, value)| (name.to_owned(), value));
        let all = own.chain(self.measures).filter_map(|(name, value)| Some((name, value?)));
        all.chain(self.counts).collect()
    }
}

/// The results of a folder that have a report, by name, and what is wrong with others.
pub fn read(folder: &Path) -> Result<(Vec<Candidate>, Vec<Problem>), Problem> {
    const ENDING: &str = ".report.json";
    let place = folder.display().to_string();
    let entries = folder
        .read_dir()
        .map_err(|error| Problem::new(&place, format!("cannot be read: {error}"), "Name the folder of a batch."))?;
    let names: BTreeSet<String> =
        entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    let (mut found, mut problems) = (Vec::new(), Vec::new());
    for name in names.iter().filter_map(|name| name.strip_suffix(ENDING)) {
        match candidate(folder, name, &format!("{name}{ENDING}")) {
            Ok(candidate) => found.push(candidate),
            Err(problem) => problems.push(problem),
        }
    }
    if found.is_empty() && problems.is_empty() {
        let remedy = "Name a folder that `cairn batch ... -o out/{seed}.glb` has filled.";
        return Err(Problem::new(place, "there is no result with a report", remedy));
    }
    Ok((found, problems))
}

fn candidate(folder: &Path, name: &str, report: &str) -> Result<Candidate, Problem> {
    let (path, report) = (folder.join(format!("{name}.glb")), folder.join(report));
    let told: Report = serde_json::from_slice(&files::read(&report)?).map_err(|error| {
        Problem::new(report.display().to_string(), format!("not a report: {error}"), "Bake the result again.")
    })?;
    let bytes = files::read(&path)?;
    if told.output_blake3 != blake3::hash(&bytes).to_hex().as_str() {
        let what = "not the result that its report tells of";
        return Err(Problem::new(path.display().to_string(), what, "Run the batch again: it bakes what is not whole."));
    }
    Ok(Candidate { name: name.to_owned(), path, bytes, figures: told.figures() })
}

/// Puts the best first: by the first figure, where that is equal by the next, and so on. What lacks a figure comes last.
pub fn sort(candidates: &mut [Candidate], keys: &[Key]) -> Result<(), Vec<Problem>> {
    let known: BTreeSet<&str> = candidates.iter().flat_map(|one| one.figures.keys()).map(String::as_str).collect();
    let unknown = keys.iter().filter(|key| !known.contains(&*key.figure)).map(|key| {
        let remedy = match nearest(&key.figure, known.iter().copied()) {
            Some(name) => format!("Did you mean `{name}`?"),
            None => format!("Known here: {}.", known.iter().copied().collect::<Vec<_>>().join(", ")),
        };
        Problem::new(format!("--by {}", key.figure), "no report has this figure", remedy)
    });
    let problems: Vec<Problem> = unknown.collect();
    if !problems.is_empty() {
        return Err(problems);
    }
    let order = |key: &Key, a: &Candidate, b: &Candidate| match (a.figures.get(&key.figure), b.figures.get(&key.figure))
    {
        (Some(a), Some(b)) if key.least => a.total_cmp(b),
        (Some(a), Some(b)) => b.total_cmp(a),
        (a, b) => b.is_some().cmp(&a.is_some()),
    };
    candidates.sort_by(|a, b| {
        let by_figures = keys.iter().map(|key| order(key, a, b)).find(|order| order.is_ne());
        by_figures.unwrap_or(Ordering::Equal).then_with(|| a.name.cmp(&b.name))
    });
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_first_and_what_lacks_a_figure_last() {
        let one = |name: &str, figures: &[(&str, f64)]| Candidate {
            name: name.into(),
            path: PathBuf::new(),
            bytes: Vec::new(),
            figures: figures.iter().map(|(name, value)| (name.to_string(), *value)).collect(),
        };
        let mut all = [
            one("a", &[("kept", 0.5), ("cost", 3.0)]),
            one("b", &[("cost", 1.0)]),
            one("c", &[("kept", 0.9), ("cost", 2.0)]),
            one("d", &[("kept", 0.9), ("cost", 1.0)]),
        ];
        let keys = ["kept", "cost:least"].map(|key| key.parse().unwrap());
        sort(&mut all, &keys).unwrap();
        assert_eq!(all.each_ref().map(|one| &*one.name), ["d", "c", "a", "b"]);
        let wrong = sort(&mut all, &["kepd".parse().unwrap()]).unwrap_err();
        assert!(wrong[0].to_string().contains("Did you mean `kept`?"));
        assert!("kept:best".parse::<Key>().is_err());
        assert_eq!(one("e", &[("x", 0.000123), ("n", 12.0)]).told("x").unwrap(), "1.2e-4");
    }
}
