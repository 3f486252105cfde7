//! Why a command ends without its result, and the exit code that says so.

use super::interrupt;
use crate::job;
use crate::model::export::ExportError;
use crate::problem::Problem;
use std::fmt::Display;
use std::path::Path;
use std::process::ExitCode;

/// A command's failure. The exit codes are those of `sysexits.h`, so that scripts and render farms can tell apart what
/// to correct, what to report and what to run again.
#[derive(Debug)]
pub enum Failure {
    /// The command line is wrong.
    Usage(Vec<Problem>),
    /// The scene or one of its files is wrong.
    Input(Vec<Problem>),
    /// Cairn is wrong.
    Internal(String),
    /// Nothing is wrong with the scene; the result could not be written.
    TryAgain(Problem),
    /// The user pressed Ctrl-C, or a system sent SIGTERM.
    Cancelled,
    /// It has been told, and this is its exit code.
    Told(u8),
}

impl Failure {
    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Failure::Usage(_) => 2,
            Failure::Input(_) => 65,
            Failure::Internal(_) => 70,
            Failure::TryAgain(_) => interrupt::TRY_AGAIN,
            Failure::Cancelled => interrupt::code(),
            Failure::Told(code) => *code,
        })
    }

    /// What went wrong, one entry per problem.
    pub fn messages(&self) -> Vec<String> {
        let all = |problems: &[Problem]| problems.iter().map(Problem::to_string).collect();
        match self {
            Failure::Usage(problems) | Failure::Input(problems) => all(problems),
            Failure::TryAgain(problem) => vec![problem.to_string()],
            Failure::Internal(what) => vec![format!(
                "internal error: {what}. This is a fault in Cairn, not in your scene. Please report it with this \
                 message, the scene and its files, and the version: {}.",
                crate::version::VERSION
            )],
            Failure::Cancelled if interrupt::is_from_outside() => {
                vec!["ended from outside (SIGTERM); nothing was written; run the command again".into()]
            }
            Failure::Cancelled => vec!["cancelled; nothing was written".into()],
            Failure::Told(_) => Vec::new(),
        }
    }

    /// A file that could not be written.
    pub fn write(path: &Path, error: impl Display) -> Failure {
        Failure::TryAgain(Problem::new(
            path.display().to_string(),
            format!("cannot be written: {error}"),
            "Make room on the disk, see that the folder is still there, and run the command again.",
        ))
    }
}

impl From<cairn_core::Error> for Failure {
    fn from(error: cairn_core::Error) -> Failure {
        match error {
            cairn_core::Error::Invalid(problems) => Failure::Input(problems.into_iter().map(Problem::from).collect()),
            cairn_core::Error::Cancelled => Failure::Cancelled,
            cairn_core::Error::Internal(what) => Failure::Internal(what),
        }
    }
}

impl From<job::Error> for Failure {
    fn from(error: job::Error) -> Failure {
        match error {
            job::Error::Bake(error) => error.into(),
            job::Error::Export(error) => error.into(),
        }
    }
}

impl From<ExportError> for Failure {
    fn from(error: ExportError) -> Failure {
        match &error {
            ExportError::UnknownFormat(_) | ExportError::IsDirectory(_) | ExportError::NoFolder(_) => {
                Failure::Usage(vec![error.to_string().into()])
            }
            ExportError::Source { .. } | ExportError::TooLarge => Failure::Input(vec![error.to_string().into()]),
            ExportError::NotFinite { .. } => Failure::Internal(error.to_string()),
            ExportError::Write { path, error } => Failure::write(path, error),
            ExportError::Io(error) => Failure::Internal(error.to_string()),
        }
    }
}
