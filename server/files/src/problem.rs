//! Problems in a user's input.

use cairn_input::asset::ProblemKind;
use std::fmt;
use std::path::Path;

/// One problem of the input: its place, the fault and the remedy.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Problem {
    /// The scene field at fault (`props.0.weight`), if any. Programs read it; messages do not show it.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub field: String,
    /// A file, with a line, a node or a field where known; or a flag.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub place: String,
    pub what: String,
    /// What the user can do: a sentence, or empty.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub remedy: String,
    #[serde(skip)]
    pub cause: Cause,
}

/// The kind of a problem, for programs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Cause {
    /// The input is wrong.
    #[default]
    Given,
    /// The named asset was not uploaded yet.
    NotUploaded,
}

impl Problem {
    pub fn new(place: impl Into<String>, what: impl Into<String>, remedy: impl Into<String>) -> Problem {
        Problem {
            field: String::new(),
            place: place.into(),
            what: what.into(),
            remedy: remedy.into(),
            cause: Cause::Given,
        }
    }

    /// A problem of a file or a folder.
    pub fn at(path: &Path, what: impl Into<String>, remedy: impl Into<String>) -> Problem {
        Problem::new(path.display().to_string(), what, remedy)
    }

    pub fn of_field(mut self, field: &str) -> Problem {
        self.field = field.to_owned();
        self
    }

    /// With a further sentence after the remedy.
    pub fn and(mut self, sentence: &str) -> Problem {
        self.remedy = format!("{} {sentence}", self.remedy);
        self
    }

    pub fn of_cause(mut self, cause: Cause) -> Problem {
        self.cause = cause;
        self
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        if !self.place.is_empty() {
            write!(f, "{}: ", self.place)?;
        }
        f.write_str(&self.what)?;
        if self.remedy.is_empty() { Ok(()) } else { write!(f, ". {}", self.remedy) }
    }
}

/// The core puts place, fault and remedy into one sentence.
impl From<cairn_input::error::SceneProblem> for Problem {
    fn from(problem: cairn_input::error::SceneProblem) -> Problem {
        Problem::from(problem.text).of_field(&problem.field)
    }
}

impl From<String> for Problem {
    fn from(sentence: String) -> Problem {
        Problem::new("", sentence, "")
    }
}

impl From<cairn_input::asset::AssetProblem> for Problem {
    fn from(problem: cairn_input::asset::AssetProblem) -> Problem {
        let place =
            if problem.place.is_empty() { problem.file } else { format!("{}: {}", problem.file, problem.place) };
        let mut remedy = problem.remedy;
        // The reader knows no flags.
        if matches!(problem.what, ProblemKind::Limit { what: "triangles", .. }) {
            remedy = "Use a simpler file, or raise --max-triangles.".to_owned();
        }
        Problem::new(place, problem.what.to_string(), remedy)
    }
}

/// The candidate most similar to `name`, if it is similar enough to be a misspelling.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    /// Similarity, 0 to 1: accepts two typing errors in a word of five letters, and no unrelated word.
    const ALIKE: f64 = 0.6;
    candidates
        .into_iter()
        .map(|candidate| (strsim::normalized_damerau_levenshtein(name, candidate), candidate))
        .filter(|(alike, _)| *alike >= ALIKE)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, candidate)| candidate)
}
