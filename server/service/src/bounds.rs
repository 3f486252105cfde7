//! What a request may become in memory, known from its bytes before it is decoded: an empty message in a list takes two
//! bytes on the wire, and a thousand or more as what it stands for.

use crate::status::Fault;
use cairn_files::version::VERSION;
use cairn_wire::proto::FieldProblem;
use prost_reflect::{Cardinality, FieldDescriptor, Kind, MessageDescriptor};
use std::collections::HashMap;

/// A request may take this many times its bytes, and this much besides.
const TIMES: usize = 16;
const BESIDES: usize = 8 << 20;
/// Of a list that grows, as much again is free, for a while.
const GROWTH: usize = 2;
/// Messages in each other: more than the decoder takes, so that it refuses what is not looked at to the end.
const DEEPEST: usize = 128;
/// Of the system, for each piece of memory.
const ALLOCATION: usize = 16;
/// Unknown fields that are named.
const NAMED: usize = 20;

/// How a request is looked at.
pub struct Bounds {
    left: usize,
    /// Bytes of a message without what is behind pointers, by its name.
    sizes: HashMap<String, usize>,
    problems: Vec<FieldProblem>,
}

/// Why a look ends.
enum End {
    /// No protobuf: the decoder ends at the same place, and says what is wrong.
    Malformed,
    TooLarge(String),
}

/// Checks the bytes of a message. Unknown fields are problems within the fields that `strict` names.
pub fn check(message: &MessageDescriptor, bytes: &[u8], strict: &[&str]) -> Result<(), Fault> {
    let mut bounds = Bounds { left: TIMES * bytes.len() + BESIDES, sizes: HashMap::new(), problems: Vec::new() };
    match bounds.look(message, bytes, &Path::Root, Strictness::Within(strict), DEEPEST) {
        Err(End::TooLarge(field)) => {
            let description = format!(
                "{field}: so many entries in so few bytes take too much memory; leave out empty ones, or send fewer in \
                 one request"
            );
            Err(Fault::RequestInvalid(vec![FieldProblem { field, description }]))
        }
        Err(End::Malformed) => Ok(()),
        Ok(()) if bounds.problems.is_empty() => Ok(()),
        Ok(()) => Err(Fault::RequestInvalid(bounds.problems)),
    }
}

#[derive(Clone, Copy)]
enum Strictness<'a> {
    /// Unknown fields are problems in these fields alone.
    Within(&'a [&'a str]),
    Here,
    Nowhere,
}

/// The way to a message, for texts.
enum Path<'a> {
    Root,
    Field(&'a Path<'a>, &'a str, Option<usize>),
}

impl Path<'_> {
    fn text(&self) -> String {
        let Path::Field(before, name, index) = self else { return String::new() };
        let index = index.map_or_else(String::new, |index| format!("[{index}]"));
        match before {
            Path::Root => format!("{name}{index}"),
            before => format!("{}.{name}{index}", before.text()),
        }
    }
}

impl Bounds {
    fn look(
        &mut self,
        message: &MessageDescriptor,
        mut bytes: &[u8],
        path: &Path,
        strict: Strictness,
        deeper: usize,
    ) -> Result<(), End> {
        let deeper = deeper.checked_sub(1).ok_or(End::Malformed)?;
        // Of the few lists that a message has, the entries so far.
        let mut counts: Vec<(u32, usize)> = Vec::new();
        while !bytes.is_empty() {
            let key = number(&mut bytes)?;
            let (tag, wire) = (u32::try_from(key >> 3).map_err(|_| End::Malformed)?, key & 7);
            let value = match wire {
                0 => number(&mut bytes).map(|_| &[][..])?,
                1 => take(&mut bytes, 8)?,
                2 => {
                    let length = number(&mut bytes)?;
                    take(&mut bytes, usize::try_from(length).map_err(|_| End::Malformed)?)?
                }
                5 => take(&mut bytes, 4)?,
                // A group, which no message has, but which decoders pass over.
                3 => skip_group(&mut bytes, deeper).map(|()| &[][..])?,
                _ => return Err(End::Malformed),
            };
            let Some(field) = message.get_field(tag) else {
                if matches!(strict, Strictness::Here) && self.problems.len() < NAMED {
                    let field = path.text();
                    let description = format!(
                        "{field}: this server (cairn {VERSION}) does not know the field of number {tag}: update it, or \
                         leave the field out"
                    );
                    self.problems.push(FieldProblem { field, description });
                }
                continue;
            };
            let is_repeated = field.cardinality() == Cardinality::Repeated;
            let index = is_repeated.then(|| {
                let known = counts.iter().position(|(known, _)| *known == tag);
                let place = known.unwrap_or_else(|| {
                    counts.push((tag, 0));
                    counts.len() - 1
                });
                counts[place].1 += 1;
                counts[place].1 - 1
            });
            let within = Path::Field(path, field.name(), index);
            self.pay(&field, wire, value.len(), &within)?;
            if let (Kind::Message(inner), 2) = (field.kind(), wire) {
                let strict = match strict {
                    Strictness::Within(names) if names.contains(&field.name()) => Strictness::Here,
                    Strictness::Within(_) => Strictness::Nowhere,
                    other => other,
                };
                // A map's entry is no message of the schema's own.
                let strict = if field.is_map() { Strictness::Nowhere } else { strict };
                self.look(&inner, value, &within, strict, deeper)?;
            }
        }
        Ok(())
    }

    /// What a value takes beside the message that it is in.
    fn pay(&mut self, field: &FieldDescriptor, wire: u64, length: usize, path: &Path) -> Result<(), End> {
        let is_repeated = field.cardinality() == Cardinality::Repeated;
        let own = match field.kind() {
            Kind::Message(inner) => self.size(&inner, DEEPEST),
            Kind::String | Kind::Bytes => size_of::<String>(),
            _ => size_of::<u64>(),
        };
        let behind = if matches!(field.kind(), Kind::String | Kind::Bytes) { length + ALLOCATION } else { 0 };
        let entries = match (is_repeated, wire, field.kind()) {
            (false, ..) => 0,
            // Packed numbers: at least a byte each.
            (true, 2, Kind::Double | Kind::Fixed64 | Kind::Sfixed64) => length / 8,
            (true, 2, Kind::Float | Kind::Fixed32 | Kind::Sfixed32) => length / 4,
            (true, 2, kind) if !matches!(kind, Kind::Message(_) | Kind::String | Kind::Bytes) => length,
            (true, ..) => 1,
        };
        let taken = entries * GROWTH * own + behind;
        self.left = self.left.checked_sub(taken).ok_or_else(|| {
            // The list, not its last entry.
            let Path::Field(before, name, _) = path else { return End::TooLarge(String::new()) };
            End::TooLarge(Path::Field(before, name, None).text())
        })?;
        Ok(())
    }

    /// Bytes of a message as it is in memory, without what is behind pointers.
    fn size(&mut self, message: &MessageDescriptor, deeper: usize) -> usize {
        if let Some(&size) = self.sizes.get(message.full_name()) {
            return size;
        }
        if deeper == 0 {
            return size_of::<usize>();
        }
        // A message within itself is behind a pointer.
        self.sizes.insert(message.full_name().to_owned(), size_of::<usize>());
        let mut size = 0;
        for field in message.fields() {
            size += match (field.cardinality(), field.kind()) {
                (Cardinality::Repeated, _) if field.is_map() => 2 * size_of::<Vec<()>>(),
                (Cardinality::Repeated, _) | (_, Kind::String) => size_of::<Vec<()>>(),
                (_, Kind::Bytes) => 2 * size_of::<u128>(),
                (_, Kind::Message(inner)) => self.size(&inner, deeper - 1) + size_of::<usize>(),
                _ => size_of::<u128>(),
            };
        }
        self.sizes.insert(message.full_name().to_owned(), size);
        size
    }
}

/// The next variable-length number.
fn number(bytes: &mut &[u8]) -> Result<u64, End> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let (&byte, rest) = bytes.split_first().ok_or(End::Malformed)?;
        *bytes = rest;
        value |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Ok(value);
        }
    }
    Err(End::Malformed)
}

/// Passes over a group that has begun.
fn skip_group(bytes: &mut &[u8], deeper: usize) -> Result<(), End> {
    let deeper = deeper.checked_sub(1).ok_or(End::Malformed)?;
    loop {
        match number(bytes)? & 7 {
            0 => drop(number(bytes)?),
            1 => drop(take(bytes, 8)?),
            2 => {
                let length = number(bytes)?;
                take(bytes, usize::try_from(length).map_err(|_| End::Malformed)?)?;
            }
            3 => skip_group(bytes, deeper)?,
            4 => return Ok(()),
            5 => drop(take(bytes, 4)?),
            _ => return Err(End::Malformed),
        }
    }
}

fn take<'a>(bytes: &mut &'a [u8], length: usize) -> Result<&'a [u8], End> {
    let (value, rest) = bytes.split_at_checked(length).ok_or(End::Malformed)?;
    *bytes = rest;
    Ok(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_wire::proto::{BakeSpec, BatchCreateBakesRequest, Body, CreateBakeRequest, PlanBakeRequest, Prop, Scene};
    use cairn_wire::scene_file::schema;
    use prost::Message;

    fn descriptor(name: &str) -> MessageDescriptor {
        schema::pool().get_message_by_name(name).expect("it is in the schema")
    }

    fn refused(name: &str, bytes: &[u8]) -> Option<String> {
        match check(&descriptor(name), bytes, &[]) {
            Err(Fault::RequestInvalid(problems)) => {
                assert!(problems[0].description.contains("so many entries in so few bytes take too much memory"));
                Some(problems[0].field.clone())
            }
            Err(other) => panic!("{other:?}"),
            Ok(()) => None,
        }
    }

    #[test]
    fn messages_are_as_large_as_is_reckoned_at_least() {
        let mut bounds = Bounds { left: 0, sizes: HashMap::new(), problems: Vec::new() };
        let mut reckoned = |name: &str| bounds.size(&descriptor(name), DEEPEST);
        for (name, size) in [
            ("cairn.v1.CreateBakeRequest", size_of::<CreateBakeRequest>()),
            ("cairn.v1.BakeSpec", size_of::<BakeSpec>()),
            ("cairn.v1.Scene", size_of::<Scene>()),
            ("cairn.v1.Prop", size_of::<Prop>()),
        ] {
            let reckoned = reckoned(name);
            assert!(reckoned >= size && reckoned <= 3 * size, "{name}: {reckoned} for {size}");
        }
    }

    #[test]
    fn lists_of_empty_messages_are_refused() {
        let empty = |count: usize| BatchCreateBakesRequest { requests: vec![CreateBakeRequest::default(); count] };
        let name = "cairn.v1.BatchCreateBakesRequest";
        assert_eq!(refused(name, &empty(20_000).encode_to_vec()), Some("requests".into()));
        assert_eq!(refused(name, &empty(100).encode_to_vec()), None);
        let props = Scene { props: vec![Prop::default(); 100_000], ..Default::default() };
        let plan = PlanBakeRequest { spec: Some(BakeSpec { scene: Some(props), ..Default::default() }) };
        assert_eq!(refused("cairn.v1.PlanBakeRequest", &plan.encode_to_vec()), Some("spec.scene.props".into()));
        // Behind a group, which decoders pass over.
        let behind = [&[0x7b, 0x08, 0x01, 0x7c][..], &empty(20_000).encode_to_vec()].concat();
        assert!(BatchCreateBakesRequest::decode(&behind[..]).is_ok());
        assert_eq!(refused(name, &behind), Some("requests".into()));
        // Entries of a map, without a key.
        assert_eq!(refused("cairn.v1.CreateBakeRequest", &[0x12, 0x00].repeat(1 << 20)), Some("labels".into()));
        let labels = (0..1000).map(|k| (k.to_string(), String::new())).collect();
        let create = CreateBakeRequest { labels, ..Default::default() };
        assert_eq!(refused("cairn.v1.CreateBakeRequest", &create.encode_to_vec()), None);
    }

    #[test]
    fn the_largest_scene_is_not_refused() {
        let body = Body { prop: "p".into(), position: vec![1.0, 2.0, 3.0], ..Default::default() };
        let scene = Scene { bodies: vec![body; 100_000], ..Default::default() };
        let plan = PlanBakeRequest { spec: Some(BakeSpec { scene: Some(scene), ..Default::default() }) };
        assert_eq!(refused("cairn.v1.PlanBakeRequest", &plan.encode_to_vec()), None);
    }

    /// Any bytes: no more memory is allowed than the promise.
    #[test]
    fn the_promise_is_kept_for_any_bytes() {
        for bytes in [0usize, 1 << 10, 1 << 20, 32 << 20] {
            assert!(bytes + TIMES * bytes + BESIDES <= 20 * bytes + (16 << 20));
        }
    }

    #[test]
    fn what_is_no_protobuf_is_left_to_the_decoder() {
        for bytes in
            [&[0xff; 30][..], &[0x0a, 0x7f], &[0x0b], &[0x0a, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f]]
        {
            assert!(check(&descriptor("cairn.v1.PlanBakeRequest"), bytes, &["spec"]).is_ok());
        }
    }
}
