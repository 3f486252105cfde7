//! The faults of a file, each with its place and a remedy for the file's owner.

use std::fmt;

/// Characters of foreign text (names, URIs, values) repeated in a message.
const MOST_TEXT: usize = 80;

/// One reason why a file was refused.
#[derive(Clone, Debug, PartialEq)]
pub struct AssetProblem {
    /// The file's name in messages.
    pub file: String,
    /// Where in it: a JSON path (`/accessors/3/count`), or the path from the node down
    /// (``node 4 `Brick`, mesh 0, primitive 1, accessor 3 (POSITION)``). Empty for the file as a whole.
    pub place: String,
    pub what: ProblemKind,
    /// One sentence for the owner.
    pub remedy: String,
}

impl fmt::Display for AssetProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.file)?;
        if !self.place.is_empty() {
            write!(f, "{}: ", self.place)?;
        }
        write!(f, "{}. {}", self.what, self.remedy)
    }
}

impl std::error::Error for AssetProblem {}

/// A count in groups of three digits: `5,242,880`.
pub fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// The kinds of problems, with the values that make them.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ProblemKind {
    // The file as a whole.
    #[error("the file is empty")]
    EmptyFile,
    #[error("this is not glTF; it looks like {seems}")]
    NotGltf { seems: &'static str },
    #[error("the JSON cannot be read: {message}")]
    Json { message: String },
    #[error("the GLB container is broken: {fault}")]
    Glb { fault: String },
    #[error("glTF version {version:?} is not read, only 2.0")]
    Version { version: String },
    #[error("it requires the extension {name}, which is not read")]
    Extension { name: String },
    #[error("{} {what} are more than the limit of {}", grouped(*.found), grouped(*.limit))]
    Limit { what: &'static str, found: u64, limit: u64 },
    #[error("it holds no triangles{}", .why.as_ref().map(|w| format!(": {w}")).unwrap_or_default())]
    NoTriangles { why: Option<String> },

    // The JSON document.
    #[error("a required property is missing")]
    Missing,
    #[error("expected {expected}, found {found}")]
    Type { expected: &'static str, found: String },
    #[error("there is no {what} {index}; the file has {count}")]
    Reference { what: &'static str, index: u64, count: usize },

    // Nodes.
    #[error("nodes contain themselves: {path}")]
    Cycle { path: String },
    #[error("the node has two parents, {first} and {second}")]
    TwoParents { first: String, second: String },
    #[error("{fault}")]
    Transform { fault: String },
    #[error("no node is called `{name}`{}", near_or_known(.near, .known))]
    UnknownNode { name: String, near: Vec<String>, known: Vec<String> },
    #[error("{} nodes are called `{name}` (nodes {})", .nodes.len(), list(.nodes))]
    AmbiguousNode { name: String, nodes: Vec<usize> },

    // Buffers, views and accessors.
    #[error("the URI {uri:?} is refused: {why}")]
    Uri { uri: String, why: &'static str },
    #[error("the data URI cannot be decoded: {why}")]
    DataUri { why: String },
    #[error("the external buffer {uri:?} cannot be read: {why}")]
    External { uri: String, why: String },
    #[error("the buffer has no data")]
    NoData,
    #[error("the buffer should have {declared} bytes but has {found}")]
    ShortBuffer { declared: u64, found: u64 },
    #[error("bytes {start} to {end} are wanted of {available} ({what})")]
    OutOfBytes { what: &'static str, start: u64, end: u64, available: u64 },
    #[error("{what} cannot hold {found}; it must be {expected}")]
    Format { what: &'static str, found: String, expected: &'static str },
    #[error("the stride of {stride} bytes is smaller than an element of {element} bytes")]
    Stride { stride: u64, element: u64 },
    #[error("{fault}")]
    Sparse { fault: String },
    #[error("the data compressed by {extension} cannot be decoded: {why}")]
    Compressed { extension: String, why: String },

    // Geometry.
    #[error("index {position} points at vertex {vertex}, but there are {vertices}")]
    Index { position: u64, vertex: u64, vertices: u64 },
    #[error("vertex {vertex} is at {value}, which is not a place")]
    NotFinite { vertex: u64, value: String },
    #[error("vertex {vertex} ends up at {value} m, further than {limit:e} m from the origin")]
    TooFar { vertex: u64, value: String, limit: f64 },
    #[error("and {count} more problems")]
    More { count: usize },
    #[error("an internal error stopped the reader: {message}")]
    Internal { message: String },
}

fn near_or_known(near: &[String], known: &[String]) -> String {
    let quoted = |names: &[String]| names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
    match (near.is_empty(), known.is_empty()) {
        (false, _) => format!("; near it: {}", quoted(near)),
        (true, false) => format!("; there are: {}", quoted(known)),
        (true, true) => "; no node has a name".to_owned(),
    }
}

fn list(nodes: &[usize]) -> String {
    let mut text = nodes.iter().take(8).map(usize::to_string).collect::<Vec<_>>().join(", ");
    if nodes.len() > 8 {
        text.push_str(", ...");
    }
    text
}

/// Foreign text made fit for a message: one line, of bounded length.
pub(crate) fn clip(text: &str) -> String {
    let clean = |c: char| if c.is_control() { '\u{fffd}' } else { c };
    let mut out: String = text.chars().take(MOST_TEXT).map(clean).collect();
    if text.chars().nth(MOST_TEXT).is_some() {
        out.push_str("...");
    }
    out
}
