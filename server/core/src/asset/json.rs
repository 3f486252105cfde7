//! The JSON of a glTF file as a tree that borrows from the file and keeps only what leads to geometry.
//!
//! Parsed leniently, so that a fault in a texture or an animation cannot refuse a mesh, and with a bound on the
//! number of values, so that a small file cannot fill the memory. Depth is bounded by `serde_json` (128).

use std::borrow::Cow;
use std::cell::Cell;
use std::fmt;

use serde::Deserializer;
use serde::de::{DeserializeSeed, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};

use super::log::{Checked, Log};
use super::problem::{ProblemKind, clip};

/// Values kept of one file, 40 bytes each in memory: eight for each node, accessor and primitive of the largest
/// scenes that the other limits admit.
const MOST_VALUES: usize = 4_000_000;

/// Top-level properties that lead to geometry; the others are skipped unread.
const KEPT: [&str; 10] = [
    "asset",
    "scene",
    "scenes",
    "nodes",
    "meshes",
    "accessors",
    "bufferViews",
    "buffers",
    "extensionsUsed",
    "extensionsRequired",
];

/// Properties skipped at every depth: free data, and bounds that the data itself tells better.
const SKIPPED: [&str; 3] = ["extras", "min", "max"];

#[derive(Debug)]
pub(super) enum Json<'a> {
    Null,
    Bool(bool),
    Int(u64),
    Real(f64),
    Text(Cow<'a, str>),
    List(Vec<Json<'a>>),
    Object(Vec<(Cow<'a, str>, Json<'a>)>),
}

/// Parses a document. The error is `serde_json`'s text with line and column.
pub(super) fn parse(bytes: &[u8]) -> Result<Json<'_>, String> {
    let left = Cell::new(MOST_VALUES);
    let mut reader = serde_json::Deserializer::from_slice(bytes);
    let root = Seed { left: &left, top: true }.deserialize(&mut reader).map_err(|e| clip(&e.to_string()))?;
    reader.end().map_err(|e| clip(&e.to_string()))?;
    Ok(root)
}

impl<'a> Json<'a> {
    /// A property of an object; the last one if it is there twice, as everywhere in JSON.
    pub fn get(&self, key: &str) -> Option<&Json<'a>> {
        match self {
            Json::Object(entries) => entries.iter().rev().find(|(k, _)| k == key).map(|(_, v)| v),
            _ => None,
        }
    }

    pub fn items(&self) -> Option<&[Json<'a>]> {
        match self {
            Json::List(items) => Some(items),
            _ => None,
        }
    }

    pub fn keys(&self) -> impl Iterator<Item = &str> {
        let entries = match self {
            Json::Object(entries) => entries.as_slice(),
            _ => &[],
        };
        entries.iter().map(|(k, _)| k.as_ref())
    }

    pub fn text(&self) -> Option<&str> {
        match self {
            Json::Text(text) => Some(text),
            _ => None,
        }
    }

    pub fn number(&self) -> Option<f64> {
        match *self {
            Json::Int(n) => Some(n as f64),
            Json::Real(x) => Some(x),
            _ => None,
        }
    }

    /// A natural number. Some exporters write `4.0`, which is one too.
    pub fn natural(&self) -> Option<u64> {
        const EXACT: f64 = 9_007_199_254_740_992.0; // 2^53: above, a real no longer tells integers apart
        match *self {
            Json::Int(n) => Some(n),
            Json::Real(x) if (0.0..=EXACT).contains(&x) && x.fract() == 0.0 => Some(x as u64),
            _ => None,
        }
    }

    /// What is there, for a message.
    pub fn describe(&self) -> String {
        match self {
            Json::Null => "null".to_owned(),
            Json::Bool(b) => b.to_string(),
            Json::Int(n) => n.to_string(),
            Json::Real(x) => format!("{x:?}"),
            Json::Text(text) => format!("{:?}", clip(text)),
            Json::List(items) => format!("a list of {}", items.len()),
            Json::Object(_) => "an object".to_owned(),
        }
    }

    /// The natural number at `key`, if it is there. `path` is this object's own.
    pub fn natural_at(&self, key: &str, path: &str, log: &mut Log) -> Checked<Option<u64>> {
        self.get(key)
            .map(|value| {
                value.natural().ok_or_else(|| {
                    let what = ProblemKind::Type { expected: "an integer, 0 or more", found: value.describe() };
                    log.refuse(format!("{path}/{key}"), what)
                })
            })
            .transpose()
    }

    /// The natural number at `key`, which must be there.
    pub fn required_at(&self, key: &str, path: &str, log: &mut Log) -> Checked<u64> {
        self.natural_at(key, path, log)?.ok_or_else(|| log.refuse(format!("{path}/{key}"), ProblemKind::Missing))
    }

    /// The list at `key`; none is an empty one.
    pub fn list_at(&self, key: &str, path: &str, log: &mut Log) -> Checked<&[Json<'a>]> {
        match self.get(key) {
            None => Ok(&[]),
            Some(Json::List(items)) => Ok(items),
            Some(other) => {
                let what = ProblemKind::Type { expected: "a list", found: other.describe() };
                Err(log.refuse(format!("{path}/{key}"), what))
            }
        }
    }

    /// The `n` numbers at `key`, if it is there.
    pub fn numbers_at<const N: usize>(&self, key: &str, path: &str, log: &mut Log) -> Checked<Option<[f64; N]>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let numbers: Option<Vec<f64>> = value.items().and_then(|items| items.iter().map(Json::number).collect());
        match numbers.and_then(|n| <[f64; N]>::try_from(n).ok()) {
            Some(numbers) => Ok(Some(numbers)),
            None => {
                let expected = match N {
                    3 => "three numbers",
                    4 => "four numbers",
                    16 => "sixteen numbers",
                    _ => "a list of numbers",
                };
                Err(log.refuse(format!("{path}/{key}"), ProblemKind::Type { expected, found: value.describe() }))
            }
        }
    }
}

/// An element of a top-level list by its index, with its path. `place` is where the index stands.
pub(super) fn element<'j, 'a>(
    root: &'j Json<'a>,
    list: &'static str,
    what: &'static str,
    index: u64,
    place: &str,
    log: &mut Log,
) -> Checked<(usize, &'j Json<'a>, String)> {
    let items = root.list_at(list, "", log)?;
    match usize::try_from(index).ok().and_then(|i| items.get(i).map(|item| (i, item))) {
        Some((i, item)) => Ok((i, item, format!("/{list}/{i}"))),
        None => Err(log.refuse(place, ProblemKind::Reference { what, index, count: items.len() })),
    }
}

struct Seed<'b> {
    left: &'b Cell<usize>,
    top: bool,
}

impl Seed<'_> {
    fn take<E: Error>(&self) -> Result<(), E> {
        let left = self.left.get().checked_sub(1);
        self.left.set(left.ok_or_else(|| E::custom("the document has too many values"))?);
        Ok(())
    }
}

impl<'de> DeserializeSeed<'de> for Seed<'_> {
    type Value = Json<'de>;
    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Json<'de>, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Seed<'_> {
    type Value = Json<'de>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("JSON")
    }
    fn visit_unit<E: Error>(self) -> Result<Json<'de>, E> {
        self.take().map(|()| Json::Null)
    }
    fn visit_bool<E: Error>(self, v: bool) -> Result<Json<'de>, E> {
        self.take().map(|()| Json::Bool(v))
    }
    fn visit_u64<E: Error>(self, v: u64) -> Result<Json<'de>, E> {
        self.take().map(|()| Json::Int(v))
    }
    fn visit_i64<E: Error>(self, v: i64) -> Result<Json<'de>, E> {
        self.take().map(|()| u64::try_from(v).map_or(Json::Real(v as f64), Json::Int))
    }
    fn visit_f64<E: Error>(self, v: f64) -> Result<Json<'de>, E> {
        self.take().map(|()| Json::Real(v))
    }
    fn visit_borrowed_str<E: Error>(self, v: &'de str) -> Result<Json<'de>, E> {
        self.take().map(|()| Json::Text(Cow::Borrowed(v)))
    }
    fn visit_str<E: Error>(self, v: &str) -> Result<Json<'de>, E> {
        self.take().map(|()| Json::Text(Cow::Owned(v.to_owned())))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut access: A) -> Result<Json<'de>, A::Error> {
        self.take()?;
        let mut items = Vec::new();
        while let Some(item) = access.next_element_seed(Seed { left: self.left, top: false })? {
            items.push(item);
        }
        Ok(Json::List(items))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut access: A) -> Result<Json<'de>, A::Error> {
        self.take()?;
        let mut entries = Vec::new();
        while let Some(key) = access.next_key_seed(Key)? {
            let skip = if self.top { !KEPT.contains(&key.as_ref()) } else { SKIPPED.contains(&key.as_ref()) };
            if skip {
                access.next_value::<IgnoredAny>()?;
            } else {
                entries.push((key, access.next_value_seed(Seed { left: self.left, top: false })?));
            }
        }
        Ok(Json::Object(entries))
    }
}

/// An object's key, borrowed where it needs no unescaping.
struct Key;

impl<'de> DeserializeSeed<'de> for Key {
    type Value = Cow<'de, str>;
    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Cow<'de, str>, D::Error> {
        deserializer.deserialize_str(self)
    }
}

impl<'de> Visitor<'de> for Key {
    type Value = Cow<'de, str>;
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a key")
    }
    fn visit_borrowed_str<E: Error>(self, v: &'de str) -> Result<Cow<'de, str>, E> {
        Ok(Cow::Borrowed(v))
    }
    fn visit_str<E: Error>(self, v: &str) -> Result<Cow<'de, str>, E> {
        Ok(Cow::Owned(v.to_owned()))
    }
}
