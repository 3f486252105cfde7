//! Reads the results of a folder, and ranks them by the figures of their reports.

use cairn_export::Format;
use cairn_files::problem::{Problem, nearest};
use cairn_job::report::ReportFile;
use std::borrow::Cow;
use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// A result with its report.
pub struct Candidate {
    /// File name without the extension.
    pub name: String,
    pub path: PathBuf,
    pub bytes: Vec<u8>,
    pub figures: BTreeMap<String, f64>,
}

impl Candidate {
    /// A figure as text.
    pub fn formatted(&self, figure: &str) -> Option<String> {
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

/// A figure to sort by.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SortKey {
    pub figure: String,
    /// The smallest comes first.
    pub least: bool,
}

impl FromStr for SortKey {
    type Err = String;

    fn from_str(text: &str) -> Result<SortKey, String> {
        match text.split_once(':') {
            None | Some((_, "most")) => Ok(SortKey { figure: text.trim_end_matches(":most").to_owned(), least: false }),
            Some((figure, "least")) => Ok(SortKey { figure: figure.to_owned(), least: true }),
            Some((_, other)) => Err(format!("`{other}` is not an order; write :least or :most")),
        }
    }
}

/// The results of a folder that have a report, in ascending order of names, and the problems of unusable ones.
pub fn read(folder: &Path) -> Result<(Vec<Candidate>, Vec<Problem>), Problem> {
    const ENDING: &str = ".report.json";

    let entries = folder
        .read_dir()
        .map_err(|error| Problem::at(folder, format!("cannot be read: {error}"), "Name the folder of a batch."))?;
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
        return Err(Problem::at(folder, "the folder holds no result with a report", remedy));
    }
    Ok((found, problems))
}

fn candidate(folder: &Path, name: &str, report: &str) -> Result<Candidate, Problem> {
    let report = folder.join(report);
    let content: ReportFile = serde_json::from_slice(&cairn_files::read(&report)?)
        .map_err(|error| Problem::at(&report, format!("not a report: {error}"), "Bake the result again."))?;
    let shows = Format::ALL.into_iter().filter(|format| format.holds_models());
    let mut paths: Vec<PathBuf> = shows.map(|format| folder.join(format!("{name}.{}", format.extension()))).collect();
    // The first one is missed if there is none.
    let first = paths[0].clone();
    paths.retain(|path| path.is_file());
    if paths.is_empty() {
        paths.push(first);
    }
    for path in &paths {
        let bytes = cairn_files::read(path)?;
        if content.output_blake3 != blake3::hash(&bytes).to_hex().as_str() {
            continue;
        }
        let beside = |relative: &str| {
            let path = cairn_job::place(folder, relative).ok_or("it leads elsewhere")?;
            std::fs::read(path).map_err(|error| error.to_string())
        };
        let read = cairn_export::as_gltf(&bytes, &beside).map(Cow::into_owned);
        let bytes = read.map_err(|what| Problem::at(path, what, "Run the batch again."))?;
        return Ok(Candidate { name: name.to_owned(), path: path.clone(), bytes, figures: content.figures() });
    }
    let what = "not the result that its report describes";
    Err(Problem::at(&paths[0], what, "Run the batch again: it repairs such results."))
}

/// Sorts, best first: by the first figure, then by the next where that is equal. Candidates without the figure come
/// last.
pub fn sort(candidates: &mut [Candidate], keys: &[SortKey]) -> Result<(), Vec<Problem>> {
    let known: BTreeSet<&str> = candidates.iter().flat_map(|one| one.figures.keys()).map(String::as_str).collect();
    let unknown = keys.iter().filter(|key| !known.contains(&*key.figure)).map(|key| {
        let remedy = match nearest(&key.figure, known.iter().copied()) {
            Some(name) => format!("Did you mean `{name}`?"),
            None => format!("Known here: {}.", known.iter().copied().collect::<Vec<_>>().join(", ")),
        };
        Problem::new(format!("--by {}", key.figure), "unknown figure", remedy)
    });
    let problems: Vec<Problem> = unknown.collect();
    if !problems.is_empty() {
        return Err(problems);
    }
    let order =
        |key: &SortKey, a: &Candidate, b: &Candidate| match (a.figures.get(&key.figure), b.figures.get(&key.figure)) {
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
    fn the_best_is_first_and_a_missing_figure_last() {
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
        assert!("kept:best".parse::<SortKey>().is_err());
        assert_eq!(one("e", &[("x", 0.000123), ("n", 12.0)]).formatted("x").unwrap(), "1.2e-4");
    }
}
