//! The gate before the `gltf` crate: of each entry of the document only what leads to geometry, and only in the types
//! that the crate reads.
//!
//! The crate refuses a whole file for one wrong type, in a texture too, and panics where a number leads to no entry. So
//! the gate keeps the text in pieces. When the geometry needs an entry, the gate cuts out the members that it reads,
//! reports every fault in them, and makes the crate's types of the rest. Faults elsewhere do not matter. Only the lists
//! are counted: all else stays text in place until it is needed.

use std::borrow::Cow;
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde::de::{DeserializeOwned, IgnoredAny, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::value::RawValue;
use serde_json::{Map, Value, from_str, from_value};

use crate::log::{Log, Logged, Reported};
use crate::problem::{ProblemKind, clip};

/// Items of lists in one file: eight for each node, accessor and primitive of the largest scenes that the other limits
/// admit.
const MOST_ITEMS: usize = 4_000_000;

/// Numbers of the longest member that holds them: a matrix.
const MOST_NUMBERS: usize = 16;

/// A list of the document that leads to geometry, and the name of an entry in messages.
pub(crate) type List = (&'static str, &'static str);
pub(crate) const SCENES: List = ("scenes", "scene");
pub(crate) const NODES: List = ("nodes", "node");
pub(crate) const MESHES: List = ("meshes", "mesh");
pub(crate) const ACCESSORS: List = ("accessors", "accessor");
pub(crate) const VIEWS: List = ("bufferViews", "buffer view");
pub(crate) const BUFFERS: List = ("buffers", "buffer");

/// The members of the document itself that are read: the lists, and besides.
const LISTS: [List; 6] = [SCENES, NODES, MESHES, ACCESSORS, VIEWS, BUFFERS];
const BESIDES: [&str; 4] = ["asset", "scene", "extensionsUsed", "extensionsRequired"];

/// The form that a member must have.
#[derive(Clone, Copy)]
pub(crate) enum MemberKind {
    /// An integer, 0 up to this.
    Natural(u64),
    /// Numbers of nodes that are there.
    Nodes,
    Uri,
    /// Text; anything else counts as missing.
    Name,
    /// Text; without one, this.
    Word(&'static str),
    /// An object of these members; a missing one counts as empty.
    Part(&'static [Member]),
}

pub(crate) const NATURAL: MemberKind = MemberKind::Natural(u64::MAX);
/// The number of an entry, or a code: the crate holds 32 bits, and drops any above.
pub(crate) const NUMBER: MemberKind = MemberKind::Natural(u32::MAX as u64);

/// A member that is read, and whether it must be there.
pub(crate) type Member = (&'static str, MemberKind, bool);

pub(crate) const MUST: bool = true;
pub(crate) const MAY: bool = false;

/// A value of the document: a text of valid JSON.
pub(crate) struct Piece<'a> {
    pub text: &'a str,
    /// Its JSON path.
    pub path: String,
}

pub(crate) struct Gate<'a> {
    /// The document's members of [`BESIDES`].
    root: BTreeMap<&'static str, Piece<'a>>,
    /// The entries of its lists; or why a list has none.
    lists: BTreeMap<&'static str, Result<Vec<&'a RawValue>, ProblemKind>>,
    /// Items that may still be listed.
    left: Cell<usize>,
    /// Extensions that are required but not read, and those of them that an entry with geometry has.
    unread: Vec<String>,
    met: RefCell<BTreeSet<String>>,
}

impl<'a> Gate<'a> {
    /// Takes a document apart. `is_read`: whether a file may require an extension.
    pub fn open(bytes: &'a [u8], is_read: fn(&str) -> bool, log: &mut Log) -> Logged<Gate<'a>> {
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

    /// A member of the document that is not a list of entries.
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

    /// Does the file have a member of this name, list or not?
    pub fn has(&self, (list, _): List) -> bool {
        self.lists.contains_key(list)
    }

    /// Number of entries of a list.
    pub fn count(&self, (list, _): List, log: &mut Log) -> Logged<usize> {
        let refuse = |what: &ProblemKind| log.refuse(format!("/{list}"), what.clone());
        self.lists.get(list).map_or(Ok(0), |items| items.as_ref().map(Vec::len).map_err(refuse))
    }

    /// An entry, if it is there.
    pub fn find(&self, (list, _): List, index: usize) -> Option<Piece<'a>> {
        let text = self.lists.get(list)?.as_ref().ok()?.get(index)?.get();
        Some(Piece { text, path: format!("/{list}/{index}") })
    }

    /// An entry by its number, which stands at `place`.
    pub fn entry(&self, list: List, index: usize, place: &str, log: &mut Log) -> Logged<Piece<'a>> {
        let count = self.count(list, log)?;
        let what = ProblemKind::Reference { what: list.1, index: index as u64, count };
        self.find(list, index).ok_or_else(|| log.refuse(place, what))
    }

    /// A piece in a type of the crate; refused if it has a fault.
    pub fn read<T: DeserializeOwned>(&self, piece: &Piece<'a>, members: &[Member], log: &mut Log) -> Logged<T> {
        let good = self.members(piece, members, log)?;
        // Every member that the type needs is there: this only fails if it needs another.
        from_value(Value::Object(good)).map_err(|error| {
            log.refuse(piece.path.as_str(), ProblemKind::Internal { message: clip(&error.to_string()) })
        })
    }

    /// A piece in a type of the crate, without its faulty members; `None` if the type needs one of these.
    pub fn read_good<T: DeserializeOwned>(&self, piece: &Piece<'a>, members: &[Member], log: &mut Log) -> Option<T> {
        from_value(Value::Object(self.cut(piece, members, log))).ok()
    }

    /// The members of a piece, all of them good.
    pub fn members(&self, piece: &Piece<'a>, members: &[Member], log: &mut Log) -> Logged<Map<String, Value>> {
        let before = log.count();
        let good = self.cut(piece, members, log);
        if log.count() == before { Ok(good) } else { Err(Reported) }
    }

    /// Remembers the piece's extensions that are required but not read.
    pub fn meet(&self, piece: &Piece<'a>) {
        if !self.unread.is_empty()
            && let Some(extensions) = piece.member("extensions")
        {
            let met = self.unread.iter().filter(|name| extensions.member(name).is_some());
            self.met.borrow_mut().extend(met.cloned());
        }
    }

    /// The items of a member that is a list; a missing list is empty.
    pub fn items(
        &self,
        piece: &Piece<'a>,
        name: &str,
        log: &mut Log,
    ) -> Logged<impl Iterator<Item = Piece<'a>> + use<'a>> {
        let list = piece.member(name).unwrap_or_else(|| piece.below(name, "[]"));
        let items = list.items(&self.left).map_err(|what| log.refuse(list.path.as_str(), what))?;
        Ok(items.into_iter().enumerate().map(move |(k, item)| list.below(k, item.get())))
    }

    /// The sound members of a piece; faults are reported.
    fn cut(&self, piece: &Piece<'a>, members: &[Member], log: &mut Log) -> Map<String, Value> {
        let names: Vec<&str> = members.iter().map(|(name, ..)| *name).collect();
        let mut good = Map::new();
        for (&(name, kind, must), text) in members.iter().zip(piece.pick(&names)) {
            let always = matches!(kind, MemberKind::Part(_) | MemberKind::Word(_));
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

    /// The value of a member; a fault is reported, and the member left out.
    fn value(&self, kind: MemberKind, piece: &Piece<'a>, log: &mut Log) -> Option<Value> {
        match kind {
            MemberKind::Natural(most) => {
                let number = piece.whole(log).ok()?;
                let number = piece.expect(Some(number).filter(|&n| n <= most), "an integer of 32 bits at most", log);
                number.ok().map(Value::from)
            }
            MemberKind::Uri => piece.expect(piece.word(), "a URI", log).ok().map(Value::from),
            MemberKind::Name => piece.word().map(Value::from),
            MemberKind::Word(other) => Some(piece.word().map_or(Value::from(other), Value::from)),
            MemberKind::Nodes => Some(self.nodes(piece, log)),
            MemberKind::Part(members) => Some(Value::Object(self.cut(piece, members, log))),
        }
    }

    /// The valid numbers in a list of nodes; faults are reported.
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

    /// The members of these names; only objects have members.
    fn pick(&self, names: &[&str]) -> Vec<Option<&'a RawValue>> {
        let found = serde_json::Deserializer::from_str(self.text).deserialize_map(Picked { names });
        found.unwrap_or_else(|_| vec![None; names.len()])
    }

    pub fn word(&self) -> Option<String> {
        from_str(self.text).ok()
    }

    /// An integer, 0 or more. Some exporters write `4.0`, which is one too.
    pub fn natural(&self) -> Option<u64> {
        const EXACT: f64 = 9_007_199_254_740_992.0; // 2^53: larger reals are not exact
        let whole = |x: &f64| (0.0..=EXACT).contains(x) && x.fract() == 0.0;
        from_str(self.text).or_else(|_| from_str(self.text).ok().filter(whole).map(|x| x as u64).ok_or(())).ok()
    }

    /// As [`Piece::natural`]; anything else is a fault.
    pub fn whole(&self, log: &mut Log) -> Logged<u64> {
        self.expect(self.natural(), "an integer, 0 or more", log)
    }

    /// `N` numbers; anything else is a fault.
    pub fn numbers<const N: usize>(&self, expected: &'static str, log: &mut Log) -> Logged<[f64; N]> {
        let numbers = if self.length() == N { from_str::<Vec<f64>>(self.text).ok() } else { None };
        self.expect(numbers.and_then(|numbers| numbers.try_into().ok()), expected, log)
    }

    /// The value that was read, or a report that the piece is not as expected.
    fn expect<T>(&self, read: Option<T>, expected: &'static str, log: &mut Log) -> Logged<T> {
        read.ok_or_else(|| log.refuse(self.path.as_str(), self.unlike(expected)))
    }

    /// The number of items of a list; 0 for anything else.
    fn length(&self) -> usize {
        from_str::<Vec<IgnoredAny>>(self.text).map_or(0, |items| items.len())
    }

    /// The value's description in a message.
    pub fn describe(&self) -> String {
        match self.text.as_bytes().first() {
            Some(b'[') => format!("a list of {}", self.length()),
            Some(b'{') => "an object".to_owned(),
            Some(b'"') => format!("{:?}", clip(&self.word().unwrap_or_default())),
            _ if from_str::<u64>(self.text).is_ok() => self.text.to_owned(),
            _ => from_str::<f64>(self.text).map_or_else(|_| clip(self.text), |x| format!("{x:?}")),
        }
    }

    /// The fault of an unexpected value, or of a number that is out of JSON's range.
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
