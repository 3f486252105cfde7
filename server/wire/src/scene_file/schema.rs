//! The message `cairn.v1.Scene` as data: its fields, kinds and names.

use cairn_files::problem::nearest;
use prost_reflect::{DescriptorPool, EnumDescriptor, FieldDescriptor, FileDescriptor, Kind, MessageDescriptor};
use std::sync::LazyLock;

/// All descriptors of `cairn.v1`, encoded.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/descriptors.bin"));

static POOL: LazyLock<DescriptorPool> =
    LazyLock::new(|| DescriptorPool::decode(DESCRIPTORS).expect("the build wrote valid descriptors"));

/// The descriptors of `proto/cairn/v1`, with their comments.
pub fn pool() -> &'static DescriptorPool {
    &POOL
}

/// The descriptor of `cairn.v1.Scene`.
pub fn scene() -> MessageDescriptor {
    pool().get_message_by_name("cairn.v1.Scene").expect("the schema has a scene")
}

/// A field by either of its names.
pub fn field(message: &MessageDescriptor, name: &str) -> Option<FieldDescriptor> {
    message.get_field_by_name(name).or_else(|| message.get_field_by_json_name(name))
}

/// The field that a string in the place of this group sets: its first, if that is text or a name, and no other field of
/// its kind follows.
pub fn shorthand(message: &MessageDescriptor) -> Option<FieldDescriptor> {
    let is_alone = |first: &FieldDescriptor| message.get_field(2).is_none_or(|second| second.kind() != first.kind());
    let first = message.get_field(1).filter(|field| !field.is_list())?;
    match first.kind() {
        Kind::String => Some(first),
        Kind::Enum(_) => Some(first).filter(is_alone),
        _ => None,
    }
}

/// Advice on a field name that the group does not have.
pub fn suggest(message: &MessageDescriptor, name: &str) -> String {
    let fields: Vec<FieldDescriptor> = message.fields().collect();
    if let Some(meant) = nearest(name, fields.iter().map(|field| field.name())) {
        return format!("Did you mean `{meant}`?");
    }
    let of_several = fields.iter().map(|field| field.name()).filter(|own| own.split('_').any(|word| word == name));
    let of_several: Vec<&str> = of_several.collect();
    if !of_several.is_empty() {
        return format!("Did you mean `{}`?", of_several.join("` or `"));
    }
    let elsewhere: Vec<String> =
        paths(&scene(), "").into_iter().filter(|path| path.rsplit('.').next() == Some(name)).collect();
    if !elsewhere.is_empty() {
        return format!("Did you mean `{}`?", elsewhere.join("` or `"));
    }
    format!("Known here: {}.", fields.iter().map(|field| field.name()).collect::<Vec<_>>().join(", "))
}

/// Every field of the schema, as a dotted path; a list's elements have no index.
fn paths(message: &MessageDescriptor, prefix: &str) -> Vec<String> {
    let mut found = Vec::new();
    for field in message.fields() {
        let path = format!("{prefix}{}", field.name());
        if let Kind::Message(group) = field.kind() {
            found.extend(paths(&group, &format!("{path}.")));
        }
        found.push(path);
    }
    found
}

/// `ACCURACY_STANDARD` -> `standard`.
pub fn short_name(of: &EnumDescriptor, full: &str) -> String {
    full.strip_prefix(&enum_prefix(of)).unwrap_or(full).to_lowercase()
}

/// The full name of an enum value, from its full or its short name.
pub fn full_name(of: &EnumDescriptor, name: &str) -> Option<String> {
    of.values()
        .find(|value| value.name() == name || short_name(of, value.name()) == name)
        .map(|value| value.name().to_owned())
}

/// The short names that may be chosen.
pub fn choices(of: &EnumDescriptor) -> Vec<String> {
    of.values().filter(|value| value.number() != 0).map(|value| short_name(of, value.name())).collect()
}

/// The prefix of all values of an enum: the zero value's name without `UNSPECIFIED`.
fn enum_prefix(of: &EnumDescriptor) -> String {
    of.default_value().name().trim_end_matches("UNSPECIFIED").to_owned()
}

/// The comment at a place of a file, see [`plain`].
pub fn comment(file: &FileDescriptor, path: &[i32]) -> String {
    let source = file.file_descriptor_proto().source_code_info.as_ref().expect("descriptors keep their comments");
    let found = source.location.iter().find(|location| location.path == path);
    plain(found.map(|location| location.leading_comments()).unwrap_or_default())
}

/// A comment without the blank before each line.
pub fn plain(comment: &str) -> String {
    comment.lines().map(|line| line.strip_prefix(' ').unwrap_or(line)).collect::<Vec<_>>().join("\n").trim().to_owned()
}

/// The text after a word in a comment, such as `Default: `, up to the end of the sentence.
pub fn stated(comment: &str, word: &str) -> Option<String> {
    let comment = comment.split_whitespace().collect::<Vec<_>>().join(" ");
    let (_, rest) = comment.split_once(word)?;
    let end = rest.find(". ").unwrap_or(rest.trim_end_matches('.').len());
    Some(rest[..end].trim().to_owned())
}
