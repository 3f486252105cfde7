//! The faults of the service, and the only place that converts them to gRPC statuses.
//!
//! Errors follow AIP-193: one `ErrorInfo` of the domain `cairn`, `BadRequest` with every problem of the input,
//! `RetryInfo` where a retry helps.

use cairn_files::plain_reason;
use cairn_wire::proto::{Failure, FieldProblem};
use std::time::Duration;
use tonic::{Code, Status};
use tonic_types::{ErrorDetails, StatusExt};

const DOMAIN: &str = "cairn";

/// The message about a full disk. It does not reveal the server's folders.
pub const DISK_FULL: &str =
    "the disk of its data directory is full; the operator can make room or choose a lower store_mib";

/// A fault of a call or of a bake.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    #[error("the request is wrong: {}", in_a_line(.0))]
    RequestInvalid(Vec<FieldProblem>),
    #[error("the scene cannot be baked: {}", in_a_line(.0))]
    SceneInvalid(Vec<FieldProblem>),
    #[error("assets have to be uploaded first: {}", in_a_line(.0))]
    AssetsMissing(Vec<FieldProblem>),
    #[error("{0}")]
    AssetCorrupt(String),
    #[error("the asset is larger than this server's limit of {0} bytes")]
    AssetTooLarge(u64),
    #[error("the upload stalled for too long; upload the asset again")]
    UploadStalled,
    #[error("there is no bake {0:?} on this server: it was never requested, was deleted, or is too old")]
    BakeNotFound(String),
    #[error("the bake has no result: it is not finished, or has failed; see GetBake")]
    BakeNotDone,
    #[error("the earlier bake cannot be used: {}", in_a_line(.0))]
    EarlierBake(Vec<FieldProblem>),
    #[error("{0}")]
    FormatUnavailable(String),
    #[error("all workers are busy, and the queue or your quota of it is full; try again later")]
    QueueFull { retry: Duration },
    #[error("too many calls are open; try again later")]
    TooManyCalls,
    #[error("the bake needs more memory than this server's limit of {0} MiB for each bake")]
    MemoryLimit(u64),
    #[error(
        "all bakes of this server together need more than its {0} MiB of memory, and this one had most of them; try \
         again later, or request fewer bodies"
    )]
    MemoryTogether(u64),
    #[error("the server has no space left: {0}")]
    StorageLimit(String),
    #[error(
        "the bake's process was killed from outside, most likely by the server's system when its memory ran out; \
         request fewer bodies, or ask the operator to run fewer bakes at once"
    )]
    BakeKilled,
    #[error("the bake's process could not be started: {0}; try again later, or ask the operator")]
    BakeNotStarted(String),
    #[error("the bake took longer than this server's limit of {0} s for each bake")]
    TimeLimit(u64),
    #[error("the deadline of the call has passed")]
    Deadline,
    #[error("the bake belongs to {0}; only its owner and operators may do this")]
    NotYours(String),
    #[error("{0}")]
    NotAllowed(String),
    #[error("{0}")]
    CallerLimit(String),
    #[error("the bake was cancelled")]
    BakeCancelled,
    #[error("the server's files of this bake are damaged: {0}. Request the bake again to repeat it")]
    BakeDamaged(String),
    #[error(
        "the bake's process ended unexpectedly: {0}. This is a fault in Cairn, not in your scene: inform its operator"
    )]
    BakeCrashed(String),
    #[error("the server ended while this bake ran; request it again")]
    ServerRestarted,
    #[error("the server is shutting down; finished and unfinished bakes are kept")]
    ShuttingDown,
    #[error("the header `authorization: Bearer TOKEN` is missing or its token is wrong")]
    TokenInvalid,
    #[error("{0}")]
    ProtocolMismatch(String),
    #[error("the server's data directory cannot be used: {0}; contact the operator")]
    DataDirectory(String),
    #[error(
        "the server's data directory is away, or another folder is in its place; what is finished is kept. Try again"
    )]
    DataAway,
    #[error("internal error: {0}")]
    Internal(String),
}

/// All problems in a line, for clients that do not read the details.
fn in_a_line(problems: &[FieldProblem]) -> String {
    problems.iter().map(|problem| problem.description.as_str()).collect::<Vec<_>>().join("; ")
}

impl Fault {
    fn code_and_reason(&self) -> (Code, &'static str) {
        match self {
            Fault::RequestInvalid(_) => (Code::InvalidArgument, "REQUEST_INVALID"),
            Fault::SceneInvalid(_) => (Code::InvalidArgument, "SCENE_INVALID"),
            Fault::AssetsMissing(_) => (Code::FailedPrecondition, "ASSETS_MISSING"),
            Fault::AssetCorrupt(_) => (Code::InvalidArgument, "ASSET_CORRUPT"),
            Fault::AssetTooLarge(_) => (Code::ResourceExhausted, "ASSET_TOO_LARGE"),
            Fault::UploadStalled => (Code::DeadlineExceeded, "UPLOAD_STALLED"),
            Fault::BakeNotFound(_) => (Code::NotFound, "BAKE_NOT_FOUND"),
            Fault::BakeNotDone => (Code::FailedPrecondition, "BAKE_NOT_DONE"),
            Fault::EarlierBake(_) => (Code::FailedPrecondition, "EARLIER_BAKE"),
            Fault::FormatUnavailable(_) => (Code::FailedPrecondition, "FORMAT_UNAVAILABLE"),
            Fault::QueueFull { .. } => (Code::ResourceExhausted, "QUEUE_FULL"),
            Fault::TooManyCalls => (Code::ResourceExhausted, "TOO_MANY_CALLS"),
            Fault::MemoryLimit(_) => (Code::ResourceExhausted, "MEMORY_LIMIT"),
            Fault::MemoryTogether(_) => (Code::ResourceExhausted, "MEMORY_TOGETHER"),
            Fault::StorageLimit(_) => (Code::ResourceExhausted, "STORAGE_LIMIT"),
            Fault::BakeKilled => (Code::ResourceExhausted, "BAKE_KILLED"),
            Fault::BakeNotStarted(_) => (Code::Unavailable, "BAKE_NOT_STARTED"),
            Fault::TimeLimit(_) => (Code::DeadlineExceeded, "TIME_LIMIT"),
            Fault::Deadline => (Code::DeadlineExceeded, "DEADLINE"),
            Fault::BakeCancelled => (Code::Cancelled, "BAKE_CANCELLED"),
            Fault::NotYours(_) => (Code::PermissionDenied, "NOT_YOURS"),
            Fault::NotAllowed(_) => (Code::PermissionDenied, "NOT_ALLOWED"),
            Fault::CallerLimit(_) => (Code::ResourceExhausted, "CALLER_LIMIT"),
            Fault::BakeDamaged(_) => (Code::DataLoss, "BAKE_DAMAGED"),
            Fault::BakeCrashed(_) => (Code::Internal, "BAKE_CRASHED"),
            Fault::ServerRestarted => (Code::Aborted, "SERVER_RESTARTED"),
            Fault::ShuttingDown => (Code::Unavailable, "SHUTTING_DOWN"),
            Fault::TokenInvalid => (Code::Unauthenticated, "TOKEN_INVALID"),
            Fault::ProtocolMismatch(_) => (Code::FailedPrecondition, "PROTOCOL_MISMATCH"),
            Fault::DataDirectory(_) => (Code::Internal, "DATA_DIRECTORY"),
            Fault::DataAway => (Code::Unavailable, "DATA_AWAY"),
            Fault::Internal(_) => (Code::Internal, "INTERNAL"),
        }
    }

    fn problems(&self) -> &[FieldProblem] {
        match self {
            Fault::RequestInvalid(problems)
            | Fault::SceneInvalid(problems)
            | Fault::AssetsMissing(problems)
            | Fault::EarlierBake(problems) => problems,
            _ => &[],
        }
    }

    fn retry(&self) -> Option<Duration> {
        match self {
            Fault::QueueFull { retry } => Some(*retry),
            Fault::MemoryTogether(_) => Some(Duration::from_secs(60)),
            Fault::TooManyCalls | Fault::BakeNotStarted(_) | Fault::ShuttingDown | Fault::DataAway => {
                Some(Duration::from_secs(5))
            }
            _ => None,
        }
    }

    /// One problem of a request's field.
    pub fn field(field: &str, description: impl Into<String>) -> Fault {
        Fault::RequestInvalid(vec![FieldProblem { field: field.into(), description: description.into() }])
    }
}

/// Whether the server has reached the system's limit of open files. The file itself may be fine then.
pub fn no_more_files(error: &std::io::Error) -> bool {
    const ENFILE: i32 = 23;
    const EMFILE: i32 = 24;
    cfg!(unix) && matches!(error.raw_os_error(), Some(ENFILE | EMFILE))
}

impl From<std::io::Error> for Fault {
    fn from(error: std::io::Error) -> Fault {
        use std::io::ErrorKind;
        tracing::error!(%error, "the data directory");
        if no_more_files(&error) {
            return Fault::TooManyCalls;
        }
        match error.kind() {
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge => {
                Fault::StorageLimit(DISK_FULL.into())
            }
            ErrorKind::NotConnected => Fault::DataAway,
            _ => Fault::DataDirectory(plain_reason(&error)),
        }
    }
}

/// The form that is stored with a bake.
impl From<&Fault> for Failure {
    fn from(fault: &Fault) -> Failure {
        let (code, reason) = fault.code_and_reason();
        Failure {
            code: code.into(),
            reason: reason.into(),
            message: fault.to_string(),
            problems: fault.problems().to_vec(),
        }
    }
}

impl From<Fault> for Status {
    fn from(fault: Fault) -> Status {
        status(&Failure::from(&fault), fault.retry())
    }
}

/// The error that ended a bake.
pub fn status_of(failure: &Failure) -> Status {
    status(failure, None)
}

/// An error of the library that takes calls, with the details that AIP-193 asks for: the bytes are no message, the
/// message is too large, or there is no such method.
pub fn detailed(error: &Status) -> Option<Status> {
    let (code, reason) = match error.code() {
        _ if !error.details().is_empty() => return None,
        Code::Ok => return None,
        // What our own code finds has details.
        Code::Internal | Code::Unknown => (Code::InvalidArgument, "REQUEST_INVALID"),
        Code::OutOfRange => (Code::OutOfRange, "REQUEST_TOO_LARGE"),
        Code::Unimplemented => (Code::Unimplemented, "NOT_OFFERED"),
        code => (code, "CALL_REFUSED"),
    };
    let what = match error.message() {
        "" => "there is no such call; see GetServerInfo and the server's reflection".to_owned(),
        message => format!("the call cannot be taken: {message}"),
    };
    let failure = Failure { code: code.into(), reason: reason.into(), message: what, problems: Vec::new() };
    Some(status(&failure, None))
}

fn status(failure: &Failure, retry: Option<Duration>) -> Status {
    /// Bytes of all descriptions together: a status is sent in headers, and proxies limit their size.
    const ROOM: usize = 4000;
    let mut details = ErrorDetails::new();
    details.set_error_info(&failure.reason, DOMAIN, [("version".to_owned(), cairn_files::version::VERSION.to_owned())]);
    let mut room = ROOM;
    for (index, problem) in failure.problems.iter().enumerate() {
        room = room.saturating_sub(problem.field.len() + problem.description.len());
        if room == 0 && index > 0 {
            details.add_bad_request_violation("spec", "and more problems");
            break;
        }
        details.add_bad_request_violation(&problem.field, cut(&problem.description, ROOM));
    }
    if retry.is_some() {
        details.set_retry_info(retry);
    }
    Status::with_error_details(failure.code.into(), cut(&failure.message, ROOM / 4), details)
}

/// Truncates a long text.
fn cut(text: &str, most: usize) -> String {
    if text.len() <= most { text.into() } else { format!("{} ...", &text[..text.floor_char_boundary(most)]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_the_library_get_details() {
        for (found, code, reason) in [
            (Status::internal("no message"), Code::InvalidArgument, "REQUEST_INVALID"),
            (Status::out_of_range("too long"), Code::OutOfRange, "REQUEST_TOO_LARGE"),
            (Status::unimplemented(""), Code::Unimplemented, "NOT_OFFERED"),
            (Status::resource_exhausted("many"), Code::ResourceExhausted, "CALL_REFUSED"),
        ] {
            let status = detailed(&found).expect("it has none");
            let details = status.get_error_details();
            assert_eq!((status.code(), &*details.error_info().unwrap().reason), (code, reason));
            assert!(!status.message().is_empty() && detailed(&status).is_none());
        }
        assert!(detailed(&Status::ok("")).is_none());
    }
}
