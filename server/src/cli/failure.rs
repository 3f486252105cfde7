//! Failures of commands, and their exit codes.

use super::interrupt;
use cairn_export::ExportError;
use cairn_files::problem::Problem;
use cairn_job::{JobError, Refused};
use cairn_service::listen::BindError;
use std::io::ErrorKind;
use std::path::Path;
use std::process::ExitCode;

/// A command's failure. The exit codes are those of `sysexits.h`: scripts and render farms can distinguish input to
/// correct, faults to report and commands to repeat.
#[derive(Debug)]
pub enum Failure {
    /// The command line is wrong.
    Usage(Vec<Problem>),
    /// The scene or one of its files is wrong, or the result cannot be written there.
    Input(Vec<Problem>),
    /// The same, with notes about the files, which are often the reason.
    Refused(Refused),
    /// Another program uses what a server needs: its address, or its data directory.
    Unavailable(Vec<Problem>),
    /// The settings of a server are wrong.
    Settings(Vec<Problem>),
    /// A fault in Cairn.
    Internal(String),
    /// The result could not be written; the scene is fine.
    TryAgain(Problem),
    /// The user pressed Ctrl-C, or a system sent SIGTERM.
    Cancelled,
    /// Already printed; this is the exit code.
    Reported(u8),
}

impl Failure {
    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Failure::Usage(_) => 2,
            Failure::Input(_) | Failure::Refused(_) => 65,
            Failure::Unavailable(_) => 69,
            Failure::Settings(_) => 78,
            Failure::Internal(_) => 70,
            Failure::TryAgain(_) => interrupt::TRY_AGAIN,
            Failure::Cancelled => interrupt::code(),
            Failure::Reported(code) => *code,
        })
    }

    /// The messages, one per problem.
    pub fn messages(&self) -> Vec<String> {
        let all = |problems: &[Problem]| problems.iter().map(Problem::to_string).collect();
        match self {
            Failure::Usage(problems)
            | Failure::Input(problems)
            | Failure::Unavailable(problems)
            | Failure::Settings(problems) => all(problems),
            Failure::Refused(refused) => all(&refused.problems),
            Failure::TryAgain(problem) => vec![problem.to_string()],
            Failure::Internal(what) => vec![format!(
                "internal error: {what}. This is a fault in Cairn, not in your scene. Send whoever gave you Cairn this \
                 message, the scene and its files, and the version: {}.",
                cairn_files::version::VERSION
            )],
            Failure::Cancelled if interrupt::is_from_outside() => {
                vec!["stopped from outside (SIGTERM); nothing was written; run the command again".into()]
            }
            Failure::Cancelled => vec!["cancelled; nothing was written".into()],
            Failure::Reported(_) => Vec::new(),
        }
    }

    /// What was noted of the scene's files.
    pub fn notes(&self) -> &[String] {
        match self {
            Failure::Refused(refused) => &refused.notes,
            _ => &[],
        }
    }

    /// With notes about the scene's files, if the scene is refused.
    pub fn with_notes(self, notes: &[String]) -> Failure {
        match self {
            Failure::Input(problems) => Failure::Refused(Refused { problems, notes: notes.to_vec() }),
            other => other,
        }
    }

    /// A file that could not be written. What may pass is to be tried again; what does not is the input's fault.
    pub fn write(path: &Path, error: &std::io::Error) -> Failure {
        let (may_pass, remedy) = match error.kind() {
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
                (true, "Make room on the disk, and run the command again.")
            }
            ErrorKind::NotFound | ErrorKind::NotADirectory => {
                (true, "Make sure that the folder exists, and run the command again.")
            }
            ErrorKind::InvalidFilename => (false, "Choose a shorter name, without characters that the disk refuses."),
            ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
                (false, "Change its permissions, or choose another folder.")
            }
            ErrorKind::IsADirectory => (false, "Choose another name."),
            ErrorKind::FileTooLarge => {
                (false, "Bake fewer frames or bodies, or choose a disk that holds larger files.")
            }
            _ => (true, "Check the disk, and run the command again."),
        };
        let problem = Problem::at(path, format!("cannot be written: {}", cairn_files::plain_reason(error)), remedy);
        if may_pass { Failure::TryAgain(problem) } else { Failure::input(problem) }
    }

    /// One problem of the command line.
    pub fn usage(place: impl Into<String>, what: impl Into<String>, remedy: impl Into<String>) -> Failure {
        Failure::Usage(vec![Problem::new(place, what, remedy)])
    }

    /// One problem of the input.
    pub fn input(problem: Problem) -> Failure {
        Failure::Input(vec![problem])
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

impl From<Refused> for Failure {
    fn from(refused: Refused) -> Failure {
        Failure::Refused(refused)
    }
}

impl From<BindError> for Failure {
    fn from(error: BindError) -> Failure {
        let kind = if error.is_taken { Failure::Unavailable } else { Failure::Settings };
        kind(error.problems)
    }
}

impl From<JobError> for Failure {
    fn from(error: JobError) -> Failure {
        match error {
            JobError::Bake(error) => error.into(),
            JobError::Export(error) => error.into(),
        }
    }
}

impl From<ExportError> for Failure {
    fn from(error: ExportError) -> Failure {
        match &error {
            ExportError::UnknownFormat(_) => Failure::Usage(vec![error.to_string().into()]),
            ExportError::IsDirectory(_)
            | ExportError::NoFolder(_)
            | ExportError::Source { .. }
            | ExportError::Pack(_)
            | ExportError::TooLarge => Failure::Input(vec![error.to_string().into()]),
            ExportError::NotFinite { .. } => Failure::Internal(error.to_string()),
            ExportError::Write { path, error } => Failure::write(path, error),
            ExportError::Io(error) => Failure::Internal(error.to_string()),
        }
    }
}
