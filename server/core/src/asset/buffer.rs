//! Buffers and their views: bytes that are only fetched when geometry asks for them.
//!
//! A buffer of pictures or animations may therefore be missing. Each is fetched, and complained of, once.

use std::collections::BTreeMap;
use std::ops::Range;
use std::rc::Rc;

use super::compressed::{MESHOPT, Meshopt};
use super::json::{Json, element};
use super::log::{Checked, Log, Reported};
use super::problem::{ProblemKind, clip};
use super::uri;

/// Shared bytes: those of the GLB in place, others as they were fetched.
#[derive(Clone)]
enum Bytes<'a> {
    InPlace(&'a [u8]),
    Fetched(Rc<Vec<u8>>),
}

/// A range of a buffer, inside of what the buffer holds.
#[derive(Clone)]
pub(super) struct View<'a> {
    bytes: Bytes<'a>,
    range: Range<usize>,
    /// Bytes from one element to the next, if the file says so.
    pub stride: Option<u64>,
    /// The view's own path, for messages.
    pub path: String,
}

impl View<'_> {
    /// Bytes that stand in no buffer: what was compressed, made plain.
    pub fn fetched(bytes: Vec<u8>, stride: Option<u64>, path: String) -> View<'static> {
        View { range: 0..bytes.len(), bytes: Bytes::Fetched(Rc::new(bytes)), stride, path }
    }

    pub fn len(&self) -> u64 {
        self.range.len() as u64
    }

    pub fn bytes(&self) -> &[u8] {
        let all = match &self.bytes {
            Bytes::InPlace(bytes) => bytes,
            Bytes::Fetched(bytes) => bytes.as_slice(),
        };
        all.get(self.range.clone()).unwrap_or(&[])
    }
}

pub(super) type Resolve<'a> = &'a dyn Fn(&str) -> Result<Vec<u8>, String>;

pub(super) struct Buffers<'a, 'j> {
    root: &'j Json<'a>,
    bin: Option<&'a [u8]>,
    resolve: Resolve<'a>,
    /// Bytes that may still be fetched, and the limit that they were taken from.
    left: u64,
    limit: u64,
    views: BTreeMap<u64, Checked<View<'a>>>,
    buffers: BTreeMap<usize, Checked<(Bytes<'a>, u64)>>,
    /// Extensions met on views and buffers.
    pub extensions: Vec<String>,
}

impl<'a, 'j> Buffers<'a, 'j> {
    pub fn new(root: &'j Json<'a>, bin: Option<&'a [u8]>, resolve: Resolve<'a>, limit: u64, used: u64) -> Self {
        let left = limit.saturating_sub(used);
        let (views, buffers) = (BTreeMap::new(), BTreeMap::new());
        Buffers { root, bin, resolve, left, limit, views, buffers, extensions: Vec::new() }
    }

    /// The view of number `index`; `place` is who asks.
    pub fn view(&mut self, index: u64, place: &str, log: &mut Log) -> Checked<View<'a>> {
        if let Some(known) = self.views.get(&index) {
            return known.clone();
        }
        let view = self.open_view(index, place, log);
        self.views.insert(index, view.clone());
        view
    }

    fn open_view(&mut self, index: u64, place: &str, log: &mut Log) -> Checked<View<'a>> {
        let (_, view, path) = element(self.root, "bufferViews", "buffer view", index, place, log)?;
        let number = view.required_at("buffer", &path, log);
        let offset = view.natural_at("byteOffset", &path, log);
        let length = view.required_at("byteLength", &path, log);
        let stride = view.natural_at("byteStride", &path, log);
        let (number, offset, length, stride) = (number?, offset?.unwrap_or(0), length?, stride?);
        let (at, buffer, _) = element(self.root, "buffers", "buffer", number, &format!("{path}/buffer"), log)?;

        let extensions = view.get("extensions");
        self.extensions.extend(extensions.into_iter().flat_map(Json::keys).map(str::to_owned));
        let compressed = MESHOPT.iter().find_map(|&name| Some((name, extensions?.get(name)?)));
        if let Some((name, compressed)) = compressed {
            // Plain bytes may stand beside the compressed ones, for readers that have no decoder.
            let marked =
                buffer.get("extensions").and_then(|e| e.get(name)).is_some_and(|e| e.get("fallback").is_some());
            let empty = buffer.get("uri").is_none() && !(at == 0 && self.bin.is_some());
            if marked || empty {
                let path = format!("{path}/extensions/{name}");
                let plain = self.decompress(compressed, name, &path, log)?;
                let available = plain.len() as u64;
                if length > available {
                    let what = ProblemKind::OutOfBytes { what: "the decoded view", start: 0, end: length, available };
                    return Err(log.refuse(path, what));
                }
                return Ok(View::fetched(plain, stride, path));
            }
        }

        let (bytes, range) = self.slice(number, offset, length, &path, log)?;
        Ok(View { bytes, range, stride, path })
    }

    /// A range of buffer `number`, fetched if it is not yet. `path` is that of the view that asks.
    fn slice(
        &mut self,
        number: u64,
        offset: u64,
        length: u64,
        path: &str,
        log: &mut Log,
    ) -> Checked<(Bytes<'a>, Range<usize>)> {
        let (at, buffer, buffer_path) =
            element(self.root, "buffers", "buffer", number, &format!("{path}/buffer"), log)?;
        let (bytes, available) = match self.buffers.get(&at) {
            Some(known) => known.clone()?,
            None => {
                let fetched = self.fetch(at, buffer, &buffer_path, log);
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

    /// The plain bytes of a view that is a meshopt stream.
    fn decompress(&mut self, view: &Json<'a>, name: &str, path: &str, log: &mut Log) -> Checked<Vec<u8>> {
        let number = view.required_at("buffer", path, log);
        let offset = view.natural_at("byteOffset", path, log);
        let length = view.required_at("byteLength", path, log);
        let stride = view.required_at("byteStride", path, log);
        let count = view.required_at("count", path, log);
        let (number, offset, length, stride, count) = (number?, offset?.unwrap_or(0), length?, stride?, count?);
        let mode = view.get("mode").and_then(Json::text).unwrap_or("(no mode)");
        let filter = view.get("filter").and_then(Json::text).unwrap_or("NONE");
        let meshopt = Meshopt { count, stride, mode, filter };
        let (bytes, range) = self.slice(number, offset, length, path, log)?;
        self.take(meshopt.bytes(), path, log)?;
        let stream = View { bytes, range, stride: None, path: String::new() };
        let broken =
            |why: String| log.refuse(path, ProblemKind::Compressed { extension: name.to_owned(), why: clip(&why) });
        meshopt.decode(stream.bytes()).map_err(broken)
    }

    /// Bytes that may still come into memory.
    pub fn left(&self) -> u64 {
        self.left
    }

    /// Counts bytes that come into memory against the limit.
    pub fn take(&mut self, bytes: u64, path: &str, log: &mut Log) -> Checked<()> {
        self.left = self.left.checked_sub(bytes).ok_or_else(|| self.too_much(path, log))?;
        Ok(())
    }

    /// A buffer's bytes and how many of them count.
    fn fetch(&mut self, at: usize, buffer: &Json<'a>, path: &str, log: &mut Log) -> Checked<(Bytes<'a>, u64)> {
        let declared = buffer.required_at("byteLength", path, log)?;
        let uri_path = format!("{path}/uri");
        let (bytes, found) = match (buffer.get("uri"), self.bin) {
            (None, Some(bin)) if at == 0 => (Bytes::InPlace(bin), bin.len()),
            (None, _) => return Err(log.refuse(path, ProblemKind::NoData)),
            (Some(Json::Text(text)), _) => {
                let fetched = self.fetch_uri(text, declared, &uri_path, log)?;
                self.take(fetched.len() as u64, &uri_path, log)?;
                let length = fetched.len();
                (Bytes::Fetched(Rc::new(fetched)), length)
            }
            (Some(other), _) => {
                let what = ProblemKind::Type { expected: "a URI", found: other.describe() };
                return Err(log.refuse(uri_path, what));
            }
        };
        if (found as u64) < declared {
            return Err(log.refuse(path, ProblemKind::ShortBuffer { declared, found: found as u64 }));
        }
        Ok((bytes, declared))
    }

    fn fetch_uri(&self, text: &str, declared: u64, path: &str, log: &mut Log) -> Checked<Vec<u8>> {
        if declared > self.left {
            return Err(self.too_much(path, log));
        }
        if uri::is_data(text) {
            return uri::decode_data(text).map_err(|why| log.refuse(path, ProblemKind::DataUri { why }));
        }
        let name =
            uri::relative_path(text).map_err(|why| log.refuse(path, ProblemKind::Uri { uri: clip(text), why }))?;
        (self.resolve)(&name)
            .map_err(|why| log.refuse(path, ProblemKind::External { uri: clip(&name), why: clip(&why) }))
    }

    fn too_much(&self, path: &str, log: &mut Log) -> Reported {
        let found = self.limit.saturating_add(1);
        log.refuse(path, ProblemKind::Limit { what: "bytes", found, limit: self.limit })
    }
}
