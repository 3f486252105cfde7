//! What is wrong with a scene or its parameters.

use std::fmt;

/// One thing wrong with what a bake was given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// The scene's field at fault: `control_mesh`, `props.0.weight`.
    pub field: String,
    /// A sentence for a person: place, fault and remedy.
    pub text: String,
}

impl Problem {
    pub fn new(field: impl Into<String>, text: impl Into<String>) -> Problem {
        Problem { field: field.into(), text: text.into() }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.text)
    }
}
