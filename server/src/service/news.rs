//! What a worker tells its server, by messages on its standard output.

use super::event_log::Extent;
use crate::wire::proto;

/// One message.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Told {
    #[prost(oneof = "News", tags = "1, 2, 3, 4, 5, 6, 7")]
    pub news: Option<News>,
}

#[derive(Clone, PartialEq, prost::Oneof)]
pub enum News {
    #[prost(message, boxed, tag = "1")]
    Planned(Box<proto::Accepted>),
    #[prost(message, tag = "2")]
    Progress(proto::Progress),
    /// Events are there to be read.
    #[prost(message, tag = "3")]
    Logged(Extent),
    #[prost(message, tag = "4")]
    Done(proto::Summary),
    /// The request is at fault.
    #[prost(message, tag = "5")]
    Invalid(Invalid),
    /// The disk is full.
    #[prost(string, tag = "6")]
    NotWritten(String),
    /// The disk is at fault.
    #[prost(string, tag = "7")]
    Broken(String),
}

#[derive(Clone, PartialEq, prost::Message)]
pub struct Invalid {
    #[prost(message, repeated, tag = "1")]
    pub problems: Vec<proto::FieldProblem>,
    /// Nothing else is wrong than that assets were not uploaded.
    #[prost(bool, tag = "2")]
    pub only_missing: bool,
}
