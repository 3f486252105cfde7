//! Buffers and their views: bytes that are only fetched when the geometry needs them.
//!
//! A buffer of pictures or animations may therefore be missing. Each buffer is fetched, and its faults reported, once.

use std::collections::BTreeMap;
use std::ops::Range;
use std::rc::Rc;

use gltf::json;
use serde_json::Value;

use crate::compressed::{MESHOPT, Meshopt};
use crate::gate::{BUFFERS, Gate, MAY, MUST, Member, MemberKind, NATURAL, NUMBER, Piece, VIEWS};
use crate::log::{Log, Logged, Reported};
use crate::problem::{ProblemKind, clip};
use crate::source::Resolver;
use crate::uri::{self, Reach};

const VIEW: &[Member] = &[
    ("buffer", NUMBER, MUST),
    ("byteOffset", NATURAL, MAY),
    ("byteLength", NATURAL, MUST),
    ("byteStride", NATURAL, MAY),
];

/// The extension of a compressed view.
const STREAM: &[Member] = &[
    ("buffer", NUMBER, MUST),
    ("byteOffset", NATURAL, MAY),
    ("byteLength", NATURAL, MUST),
    ("byteStride", NATURAL, MUST),
    ("count", NATURAL, MUST),
    ("mode", MemberKind::Word("(no mode)"), MAY),
    ("filter", MemberKind::Word("NONE"), MAY),
];

const BUFFER: &[Member] = &[("byteLength", NATURAL, MUST), ("uri", MemberKind::Uri, MAY)];

/// Shared bytes: those of the GLB in place, others as they were fetched.
#[derive(Clone)]
enum Bytes<'a> {
    InPlace(&'a [u8]),
    Fetched(Rc<Vec<u8>>),
}

/// A range of a buffer, inside of what the buffer holds.
#[derive(Clone)]
pub(crate) struct BufferView<'a> {
    bytes: Bytes<'a>,
    range: Range<usize>,
    /// Bytes from one element to the next, if the file says so.
    pub stride: Option<u64>,
    /// The view's own path, for messages.
    pub path: String,
}

impl BufferView<'_> {
    /// Decompressed bytes, which no buffer of the file holds.
    pub fn fetched(bytes: Vec<u8>, stride: Option<u64>, path: String) -> BufferView<'static> {
        BufferView { range: 0..bytes.len(), bytes: Bytes::Fetched(Rc::new(bytes)), stride, path }
    }

    /// Bytes in place, such as a document's.
    pub fn in_place(bytes: &[u8], stride: Option<u64>) -> BufferView<'_> {
        BufferView { range: 0..bytes.len(), bytes: Bytes::InPlace(bytes), stride, path: String::new() }
    }

    pub fn len(&self) -> u64 {
        self.range.len() as u64
    }

    #[inline]
    pub fn bytes(&self) -> &[u8] {
        let all = match &self.bytes {
            Bytes::InPlace(bytes) => bytes,
            Bytes::Fetched(bytes) => bytes.as_slice(),
        };
        all.get(self.range.clone()).unwrap_or(&[])
    }
}

pub(crate) struct Buffers<'a, 'g> {
    gate: &'g Gate<'a>,
    bin: Option<&'a [u8]>,
    resolve: &'a Resolver<'a>,
    /// Bytes that may still be fetched, and the limit of all.
    left: u64,
    limit: u64,
    views: BTreeMap<usize, Logged<BufferView<'a>>>,
    buffers: BTreeMap<usize, Logged<(Bytes<'a>, u64)>>,
}

impl<'a, 'g> Buffers<'a, 'g> {
    pub fn new(gate: &'g Gate<'a>, bin: Option<&'a [u8]>, resolve: &'a Resolver<'a>, limit: u64, used: u64) -> Self {
        let left = limit.saturating_sub(used);
        Buffers { gate, bin, resolve, left, limit, views: BTreeMap::new(), buffers: BTreeMap::new() }
    }

    /// The view of number `index`, which `place` needs.
    pub fn view(&mut self, index: usize, place: &str, log: &mut Log) -> Logged<BufferView<'a>> {
        if let Some(known) = self.views.get(&index) {
            return known.clone();
        }
        let view = self.open_view(index, place, log);
        self.views.insert(index, view.clone());
        view
    }

    fn open_view(&mut self, index: usize, place: &str, log: &mut Log) -> Logged<BufferView<'a>> {
        let piece = self.gate.entry(VIEWS, index, place, log)?;
        self.gate.meet(&piece);
        let view: json::buffer::View = self.gate.read(&piece, VIEW, log)?;
        let (path, length, at) = (piece.path.clone(), view.byte_length.0, view.buffer.value());
        let stride = view.byte_stride.map(|stride| stride.0 as u64);
        let buffer = self.gate.entry(BUFFERS, at, &format!("{path}/buffer"), log)?;
        let extensions = piece.member("extensions");
        let stream = |name: &&'static str| Some((*name, extensions.as_ref()?.member(name)?));
        if let Some((name, stream)) = MESHOPT.iter().find_map(stream) {
            // Plain bytes may stand beside the compressed ones, for readers that have no decoder.
            let marked = buffer.extension(name).is_some_and(|extension| extension.member("fallback").is_some());
            let empty = buffer.member("uri").is_none() && !(at == 0 && self.bin.is_some());
            if marked || empty {
                let plain = self.decompress(&stream, name, log)?;
                let available = plain.len() as u64;
                if length > available {
                    let what = ProblemKind::OutOfBytes { what: "the decoded view", start: 0, end: length, available };
                    return Err(log.refuse(stream.path, what));
                }
                return Ok(BufferView::fetched(plain, stride, stream.path));
            }
        }
        let (bytes, range) = self.slice(at, view.byte_offset.map_or(0, |offset| offset.0), length, &path, log)?;
        Ok(BufferView { bytes, range, stride, path })
    }

    /// A range of a buffer, which is fetched if it is not yet. `path`: the view's.
    fn slice(
        &mut self,
        at: usize,
        offset: u64,
        length: u64,
        path: &str,
        log: &mut Log,
    ) -> Logged<(Bytes<'a>, Range<usize>)> {
        let buffer = self.gate.entry(BUFFERS, at, &format!("{path}/buffer"), log)?;
        let (bytes, available) = match self.buffers.get(&at) {
            Some(known) => known.clone()?,
            None => {
                let fetched = self.fetch(at, &buffer, log);
                self.buffers.insert(at, fetched.clone());
                fetched?
            }
        };
        let end = offset.saturating_add(length);
        if end > available {
            let what = ProblemKind::OutOfBytes { what: "the view in its buffer", start: offset, end, available };
            return Err(log.refuse(path, what));
        }
        // Within `available`, which is a length in memory.
        Ok((bytes, offset as usize..end as usize))
    }

    /// The decoded bytes of a meshopt stream.
    fn decompress(&mut self, stream: &Piece<'a>, name: &str, log: &mut Log) -> Logged<Vec<u8>> {
        let view = self.gate.members(stream, STREAM, log)?;
        let number = |key: &str| view.get(key).and_then(Value::as_u64).unwrap_or_default();
        let missing = || log.refuse(stream.path.as_str(), ProblemKind::Missing);
        let meshopt = Meshopt::read(&view).ok_or_else(missing)?;
        let at = number("buffer") as usize;
        let (bytes, range) = self.slice(at, number("byteOffset"), number("byteLength"), &stream.path, log)?;
        self.take(meshopt.bytes(), &stream.path, log)?;
        let bytes = BufferView { bytes, range, stride: None, path: String::new() };
        let broken = |why: String| {
            let what = ProblemKind::Compressed { extension: name.to_owned(), why: clip(&why) };
            log.refuse(stream.path.as_str(), what)
        };
        meshopt.decode(bytes.bytes()).map_err(broken)
    }

    /// Bytes that may still come into memory.
    pub fn left(&self) -> u64 {
        self.left
    }

    /// Counts bytes that come into memory against the limit.
    pub fn take(&mut self, bytes: u64, path: &str, log: &mut Log) -> Logged<()> {
        self.left = self.left.checked_sub(bytes).ok_or_else(|| self.too_much(path, log))?;
        Ok(())
    }

    /// A buffer's bytes and how many of them count.
    fn fetch(&mut self, at: usize, piece: &Piece<'a>, log: &mut Log) -> Logged<(Bytes<'a>, u64)> {
        let buffer: json::Buffer = self.gate.read(piece, BUFFER, log)?;
        let (declared, path) = (buffer.byte_length.0, piece.path.as_str());
        let uri_path = format!("{path}/uri");
        let (bytes, found) = match (buffer.uri, self.bin) {
            (None, Some(bin)) if at == 0 => (Bytes::InPlace(bin), bin.len()),
            (None, _) => return Err(log.refuse(path, ProblemKind::NoData)),
            (Some(text), _) => {
                let fetched = self.fetch_uri(&text, declared, &uri_path, log)?;
                self.take(fetched.len() as u64, &uri_path, log)?;
                let length = fetched.len();
                (Bytes::Fetched(Rc::new(fetched)), length)
            }
        };
        if (found as u64) < declared {
            return Err(log.refuse(path, ProblemKind::ShortBuffer { declared, found: found as u64 }));
        }
        Ok((bytes, declared))
    }

    fn fetch_uri(&self, text: &str, declared: u64, path: &str, log: &mut Log) -> Logged<Vec<u8>> {
        if declared > self.left {
            return Err(self.too_much(path, log));
        }
        if uri::is_data(text) {
            return uri::decode_data(text).map_err(|why| log.refuse(path, ProblemKind::DataUri { why }));
        }
        if let Err(why) = uri::paths(text, Reach::Below) {
            return Err(log.refuse(path, ProblemKind::Uri { uri: clip(text), why }));
        }
        let found = uri::find(text, Reach::Below, self.resolve, |_| true);
        found
            .map(|(_, bytes)| bytes)
            .map_err(|missing| log.refuse(path, ProblemKind::External { uri: clip(text), why: clip(&missing.why) }))
    }

    fn too_much(&self, path: &str, log: &mut Log) -> Reported {
        let found = self.limit.saturating_add(1);
        log.refuse(path, ProblemKind::Limit { what: "bytes", found, limit: self.limit })
    }
}
