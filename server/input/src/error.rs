//! Why a scene cannot be baked, or a bake did not finish.

pub use cairn_geometry::counted;
use std::fmt;

/// The reason for which a scene cannot be baked, or a bake did not finish.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene or its parameters are at fault: every problem, each naming its place and the remedy.
    #[error("{}", .0.iter().map(SceneProblem::to_string).collect::<Vec<_>>().join("\n"))]
    Invalid(Vec<SceneProblem>),
    #[error("cancelled")]
    Cancelled,
    /// A fault of the program.
    #[error("internal error: {0}")]
    Internal(String),
}

/// One thing wrong with a scene or its parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneProblem {
    /// The scene's field at fault: `control_mesh`, `props.0.weight`.
    pub field: String,
    /// A sentence for a person: place, fault and remedy.
    pub text: String,
}

impl SceneProblem {
    pub fn new(field: impl Into<String>, text: impl Into<String>) -> SceneProblem {
        SceneProblem { field: field.into(), text: text.into() }
    }
}

impl fmt::Display for SceneProblem {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.text)
    }
}
