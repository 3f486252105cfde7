//! The gate before the `gltf` crate: of each entry of the document only what leads to geometry, and only in the types that
//! the crate reads.
//!
//! The crate refuses a whole file for one wrong type, in a texture too, and panics where a number leads to no entry. So the
//! text is held in pieces, a piece of each entry is cut out when geometry asks for it, everything wrong with it is told, and
//! the crate's types are made of what is left. What is wrong elsewhere does not matter. Only the lists are counted: all
//! else is text in place until it is asked for.

use std::borrow::Cow;
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde::de::{DeserializeOwned, IgnoredAny, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::value::RawValue;
use serde_json::{Map, Value, from_str, from_value};

use super::log::{Checked, Log, Reported};
use super::problem::{ProblemKind, clip};

/// Items of lists in one file: eight for each node, accessor and primitive of the largest scenes that the other limits admit.
const MOST_ITEMS: usize = 4_000_000;

/// Numbers of the longest member that holds them: a matrix.
const MOST_NUMBERS: usize = 16;

/// A list of the document that leads to geometry, and what messages call an entry.
pub(super) type List = (&'static str, &'static str);
pub(super) const SCENES: List = ("scenes", "scene");
pub(super) const NODES: List = ("nodes", "node");
pub(super) const MESHES: List = ("meshes", "mesh");
pub(super) const ACCESSORS: List = ("accessors", "accessor");
pub(super) const VIEWS: List = ("bufferViews", "buffer view");
pub(super) const BUFFERS: List = ("buffers", "buffer");

/// What is read of the document itself: the lists, and besides.
const LISTS: [List; 6] = [SCENES, NODES, MESHES, ACCESSORS, VIEWS, BUFFERS];
const BESIDES: [&str; 4] = ["asset", "scene", "extensionsUsed", "extensionsRequired"];

/// What a member must be.
#[derive(Clone, Copy)]
pub(super) enum Kind {
    /// An integer, 0 up to this.
    Natural(u64),
    /// Numbers of nodes that are there.
    Nodes,
    Uri,
    /// Text; anything else is none.
    Name,
    /// Text; anything else, and none, is this.
    Word(&'static str),
    /// An object of these members; none is an empty one.
    Part(&'static [Member]),
}

pub(super) const NATURAL: Kind = Kind::Natural(u64::MAX);
/// The number of an entry, or a code: the crate holds 32 bits of them, and drops any above.
pub(super) const NUMBER: Kind = Kind::Natural(u32::MAX as u64);

/// A member that is read, and whether it must be there.
pub(super) type Member = (&'static str, Kind, bool);

pub(super) const MUST: bool = true;
pub(super) const MAY: bool = false;

/// A value of the document, whose text is sound JSON.
pub(super) struct Piece<'a> {
    pub text: &'a str,
    /// Where it stands.
    pub path: String,
}

pub(super) struct Gate<'a> {
    /// What the document has of [`BESIDES`].
    root: BTreeMap<&'static str, Piece<'a>>,
    /// The entries of its lists; or why there are none.
    lists: BTreeMap<&'static str, Result<Vec<&'a RawValue>, ProblemKind>>,
    /// Items that may still be listed.
    left: Cell<usize>,
    /// Extensions that are required but not read, and those of them that an entry with geometry has.
    unread: Vec<String>,
    met: RefCell<BTreeSet<String>>,
}

impl<'a> Gate<'a> {
    /// Takes a document apart. `is_read` tells which extensions may be required.
    pub fn open(bytes: &'a [u8], is_read: fn(&str) -> bool, log: &mut Log) -> Checked<Gate<'a>> {
        let names: Vec<&'static str> = LISTS.iter().map(|list| list.0).chain(BESIDES).collect();
        let mut reader = serde_json::Deserializer::from_slice(bytes);
        let found = reader.deserialize_map(Picked { names: &names }).and_then(|found| reader.end().map(|()| found));
        let broken = |error: serde_json::Error| match error.is_data() {
            true => ProblemKind::NotGltf { seems: "some other JSON" }, // no object
            false => ProblemKind::Json { message: clip(&error.to_string()) },
        };
        let found = found.map_err(|error| log.refuse("", broken(error)))?;
        let piece = |(name, text): (&'static str, Option<&'a RawValue>)| {
            Some((name, Piece { text: text?.get(), path: format!("/{name}") }))
        };
        let mut root: BTreeMap<_, _> = names.into_iter().zip(found).filter_map(piece).collect();
        let left = Cell::new(MOST_ITEMS);
        let list = |(name, _)| Some((name, root.remove(name)?.items(&left)));
        let lists = LISTS.into_iter().filter_map(list).collect();
        let mut gate = Gate { root, lists, left, unread: Vec::new(), met: RefCell::default() };
        gate.unread = gate.texts("extensionsRequired");
        gate.unread.retain(|name| !is_read(name));
        Ok(gate)
    }

    /// A member of the document that is no list of entries.
    pub fn root(&self, name: &str) -> Option<&Piece<'a>> {
        self.root.get(name)
    }

    /// Does the file say that it uses or requires this extension?
    pub fn declares(&self, name: &str) -> bool {
        ["extensionsUsed", "extensionsRequired"].iter().any(|list| self.texts(list).iter().any(|used| used == name))
    }

    fn texts(&self, list: &str) -> Vec<String> {
        let items = self.root(list).and_then(|list| list.items(&self.left).ok()).unwrap_or_default();
        items.iter().filter_map(|item| from_str(item.get()).ok()).collect()
    }

    /// Extensions that are required but not read, in the file's order, and whether an entry with geometry has them.
    pub fn unread(&self) -> impl Iterator<Item = (&str, bool)> {
        let met = self.met.borrow();
        self.unread.iter().map(move |name| (name.as_str(), met.contains(name)))
    }

    /// Does the file have this list, whatever it is?
    pub fn has(&self, (list, _): List) -> bool {
        self.lists.contains_key(list)
    }

    /// How many entries a list has.
    pub fn count(&self, (list, _): List, log: &mut Log) -> Checked<usize> {
        let told = |what: &ProblemKind| log.refuse(format!("/{list}"), what.clone());
        self.lists.get(list).map_or(Ok(0), |items| items.as_ref().map(Vec::len).map_err(told))
    }

    /// An entry, if it is there.
    pub fn find(&self, (list, _): List, index: usize) -> Option<Piece<'a>> {
        let text = self.lists.get(list)?.as_ref().ok()?.get(index)?.get();
        Some(Piece { text, path: format!("/{list}/{index}") })
    }

    /// An entry by its number, which stands at `place`.
    pub fn entry(&self, list: List, index: usize, place: &str, log: &mut Log) -> Checked<Piece<'a>> {
        let count = self.count(list, log)?;
        let what = ProblemKind::Reference { what: list.1, index: index as u64, count };
        self.find(list, index).ok_or_else(|| log.refuse(place, what))
    }

    /// A piece in a type of the crate, without any fault.
    pub fn read<T: DeserializeOwned>(&self, piece: &Piece<'a>, members: &[Member], log: &mut Log) -> Checked<T> {
        let good = self.members(piece, members, log)?;
        // Every member that the type needs is there: this only fails if it needs another.
        from_value(Value::Object(good)).map_err(|error| {
            log.refuse(piece.path.as_str(), ProblemKind::Internal { message: clip(&error.to_string()) })
        })
    }

    /// A piece in a type of the crate, without what is wrong in it; none if the type needs that.
    pub fn read_good<T: DeserializeOwned>(&self, piece: &Piece<'a>, members: &[Member], log: &mut Log) -> Option<T> {
        from_value(Value::Object(self.cut(piece, members, log))).ok()
    }

    /// The members of a piece, all of them good.
    pub fn members(&self, piece: &Piece<'a>, members: &[Member], log: &mut Log) -> Checked<Map<String, Value>> {
        let before = log.count();
        let good = self.cut(piece, members, log);
        if log.count() == before { Ok(good) } else { Err(Reported) }
    }

    /// Remembers which of the extensions that are not read a piece has.
    pub fn meet(&self, piece: &Piece<'a>) {
        if !self.unread.is_empty()
            && let Some(extensions) = piece.member("extensions")
        {
            let met = self.unread.iter().filter(|name| extensions.member(name).is_some());
            self.met.borrow_mut().extend(met.cloned());
        }
    }

    /// The items of a member that is a list; none is an empty one.
    pub fn items(
        &self,
        piece: &Piece<'a>,
        name: &str,
        log: &mut Log,
    ) -> Checked<impl Iterator<Item = Piece<'a>> + use<'a>> {
        let list = piece.member(name).unwrap_or_else(|| piece.below(name, "[]"));
        let items = list.items(&self.left).map_err(|what| log.refuse(list.path.as_str(), what))?;
        Ok(items.into_iter().enumerate().map(move |(k, item)| list.below(k, item.get())))
    }

    /// The good ones of a piece's members; the others are told.
    fn cut(&self, piece: &Piece<'a>, members: &[Member], log: &mut Log) -> Map<String, Value> {
        let names: Vec<&str> = members.iter().map(|(name, ..)| *name).collect();
        let mut good = Map::new();
        for (&(name, kind, must), text) in members.iter().zip(piece.pick(&names)) {
            let always = matches!(kind, Kind::Part(_) | Kind::Word(_));
            match text.map(RawValue::get).or(always.then_some("null")) {
                Some(text) => {
                    let value = self.value(kind, &piece.below(name, text), log);
                    good.extend(value.map(|value| (name.to_owned(), value)));
                }
                None if must == MUST => {
                    log.refuse(format!("{}/{name}", piece.path), ProblemKind::Missing);
                }
                None => {}
            }
        }
        good
    }

    /// What becomes of a member; told and left out if it is wrong.
    fn value(&self, kind: Kind, piece: &Piece<'a>, log: &mut Log) -> Option<Value> {
        match kind {
            Kind::Natural(most) => {
                let number = piece.whole(log).ok()?;
                let number = piece.told(Some(number).filter(|&n| n <= most), "an integer of 32 bits at most", log);
                number.ok().map(Value::from)
            }
            Kind::Uri => piece.told(piece.word(), "a URI", log).ok().map(Value::from),
            Kind::Name => piece.word().map(Value::from),
            Kind::Word(other) => Some(piece.word().map_or(Value::from(other), Value::from)),
            Kind::Nodes => Some(self.nodes(piece, log)),
            Kind::Part(members) => Some(Value::Object(self.cut(piece, members, log))),
        }
    }

    /// The good ones of a list of node numbers.
    fn nodes(&self, list: &Piece<'a>, log: &mut Log) -> Value {
        let count = self.count(NODES, log).unwrap_or(0);
        let items = list.items(&self.left).unwrap_or_else(|what| {
            log.refuse(list.path.as_str(), what);
            Vec::new()
        });
        let mut good = Vec::with_capacity(items.len());
        for (k, item) in items.iter().enumerate() {
            let item = Piece { text: item.get(), path: String::new() };
            let what = match item.natural() {
                Some(index) if index < count as u64 => {
                    good.push(Value::from(index));
                    continue;
                }
                Some(index) => ProblemKind::Reference { what: "node", index, count },
                None => item.unlike("the number of a node"),
            };
            log.refuse(format!("{}/{k}", list.path), what);
        }
        Value::Array(good)
    }
}

impl<'a> Piece<'a> {
    fn below(&self, name: impl fmt::Display, text: &'a str) -> Piece<'a> {
        Piece { text, path: format!("{}/{name}", self.path) }
    }

    /// The items of a list, as long as any are `left` to be listed.
    fn items(&self, left: &Cell<usize>) -> Result<Vec<&'a RawValue>, ProblemKind> {
        if !self.text.starts_with('[') {
            return Err(self.unlike("a list"));
        }
        // An item and its comma take two bytes, so that most lists need not be counted first.
        if self.text.len() / 2 > left.get() && self.length() > left.get() {
            return Err(ProblemKind::Json { message: "the document has too many values".to_owned() });
        }
        let items: Vec<&RawValue> = from_str(self.text).unwrap_or_default();
        left.set(left.get().saturating_sub(items.len()));
        Ok(items)
    }

    /// A member of an object; the last one if it is there twice, as everywhere in JSON.
    pub fn member(&self, name: &str) -> Option<Piece<'a>> {
        let [member] = self.members_of([name]);
        member
    }

    /// Several members at once.
    pub fn members_of<const N: usize>(&self, names: [&str; N]) -> [Option<Piece<'a>>; N] {
        let found = self.pick(&names);
        std::array::from_fn(|i| found[i].map(|text| self.below(names[i], text.get())))
    }

    /// An extension of an entry.
    pub fn extension(&self, name: &str) -> Option<Piece<'a>> {
        self.member("extensions")?.member(name)
    }

    /// The members of these names; what is no object has none.
    fn pick(&self, names: &[&str]) -> Vec<Option<&'a RawValue>> {
        let found = serde_json::Deserializer::from_str(self.text).deserialize_map(Picked { names });
        found.unwrap_or_else(|_| vec![None; names.len()])
    }

    pub fn word(&self) -> Option<String> {
        from_str(self.text).ok()
    }

    /// An integer, 0 or more. Some exporters write `4.0`, which is one too.
    pub fn natural(&self) -> Option<u64> {
        const EXACT: f64 = 9_007_199_254_740_992.0; // 2^53: above, a real no longer tells integers apart
        let whole = |x: &f64| (0.0..=EXACT).contains(x) && x.fract() == 0.0;
        from_str(self.text).or_else(|_| from_str(self.text).ok().filter(whole).map(|x| x as u64).ok_or(())).ok()
    }

    /// As [`Piece::natural`], which it must be.
    pub fn whole(&self, log: &mut Log) -> Checked<u64> {
        self.told(self.natural(), "an integer, 0 or more", log)
    }

    /// `N` numbers, which it must be.
    pub fn numbers<const N: usize>(&self, expected: &'static str, log: &mut Log) -> Checked<[f64; N]> {
        let numbers = if self.length() == N { from_str::<Vec<f64>>(self.text).ok() } else { None };
        self.told(numbers.and_then(|numbers| numbers.try_into().ok()), expected, log)
    }

    /// What was read of this, or that it is not what is expected.
    fn told<T>(&self, read: Option<T>, expected: &'static str, log: &mut Log) -> Checked<T> {
        read.ok_or_else(|| log.refuse(self.path.as_str(), self.unlike(expected)))
    }

    /// Items of a list; anything else has none.
    fn length(&self) -> usize {
        from_str::<Vec<IgnoredAny>>(self.text).map_or(0, |items| items.len())
    }

    /// What is there, for a message.
    pub fn describe(&self) -> String {
        match self.text.as_bytes().first() {
            Some(b'[') => format!("a list of {}", self.length()),
            Some(b'{') => "an object".to_owned(),
            Some(b'"') => format!("{:?}", clip(&self.word().unwrap_or_default())),
            _ if from_str::<u64>(self.text).is_ok() => self.text.to_owned(),
            _ => from_str::<f64>(self.text).map_or_else(|_| clip(self.text), |x| format!("{x:?}")),
        }
    }

    /// The fault of not being what is expected, or of being nothing that JSON can hold.
    fn unlike(&self, expected: &'static str) -> ProblemKind {
        let numbers = if self.length() <= MOST_NUMBERS { from_str::<Vec<f64>>(self.text).err() } else { None };
        let mut broken = from_str::<f64>(self.text).err().into_iter().chain(numbers);
        if broken.any(|error| error.to_string().starts_with("number out of range")) {
            return ProblemKind::Json { message: "number out of range".to_owned() };
        }
        ProblemKind::Type { expected, found: self.describe() }
    }
}

/// The members of an object that have these names.
struct Picked<'n> {
    names: &'n [&'n str],
}

#[derive(Deserialize)]
struct Key<'a>(#[serde(borrow)] Cow<'a, str>);

impl<'de> Visitor<'de> for Picked<'_> {
    type Value = Vec<Option<&'de RawValue>>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut access: A) -> Result<Self::Value, A::Error> {
        let mut found = vec![None; self.names.len()];
        while let Some(Key(key)) = access.next_key()? {
            match self.names.iter().position(|name| *name == key) {
                Some(at) => found[at] = Some(access.next_value()?),
                None => {
                    access.next_value::<IgnoredAny>()?;
                }
            }
        }
        Ok(found)
    }
}
