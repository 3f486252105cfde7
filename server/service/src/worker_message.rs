//! The messages that a worker sends to its server on its standard output.

use super::event_log::Extent;
use cairn_wire::proto;

/// A message on the wire.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Envelope {
    #[prost(oneof = "WorkerMessage", tags = "1, 2, 3, 4, 5, 6, 7, 8, 9")]
    pub message: Option<WorkerMessage>,
}

#[derive(Clone, PartialEq, prost::Oneof)]
pub enum WorkerMessage {
    #[prost(message, boxed, tag = "1")]
    Planned(Box<proto::Accepted>),
    #[prost(message, tag = "2")]
    Progress(proto::Progress),
    /// More events of the log may be read.
    #[prost(message, tag = "3")]
    Logged(Extent),
    #[prost(message, tag = "4")]
    Done(proto::Summary),
    /// The request is wrong.
    #[prost(message, tag = "5")]
    Invalid(Invalid),
    /// The disk is full.
    #[prost(string, tag = "6")]
    NotWritten(String),
    /// The disk is at fault.
    #[prost(string, tag = "7")]
    Broken(String),
    /// A result was made in a further format.
    #[prost(message, tag = "8")]
    Exported(ResultHead),
    /// Progress or answers of an analysis.
    #[prost(message, boxed, tag = "9")]
    Analysed(Box<proto::AnalysePileResponse>),
}

/// The first messages of the downloads of a result and of its report, without their first bytes.
#[derive(Clone, PartialEq, prost::Message)]
pub struct ResultHead {
    #[prost(message, required, tag = "1")]
    pub result: proto::DownloadResultResponse,
    #[prost(message, required, tag = "2")]
    pub report: proto::DownloadResultResponse,
}

#[derive(Clone, PartialEq, prost::Message)]
pub struct Invalid {
    #[prost(message, repeated, tag = "1")]
    pub problems: Vec<proto::FieldProblem>,
    /// All problems are assets that were not uploaded.
    #[prost(bool, tag = "2")]
    pub only_missing: bool,
}
