//! Writes the Rust code of the parameters from `proto/cairn/v1`, the only place where a parameter is declared.
//!
//! Two build scripts use it: that of `cairn-input` for the types, defaults and ranges ([`core`]), and that of
//! `cairn-wire` for the conversions between these types and the messages ([`wire`]). A field's comment has its default
//! (`Default: 8.`, or `Default: not set, ...` for a value that may be absent) and its range (`Range: 1 to 64.`,
//! `Range: above 0.`).

mod core;
mod wire;

use protox::prost_reflect::{
    DescriptorPool, EnumDescriptor, FieldDescriptor, FileDescriptor, Kind, MessageDescriptor, OneofDescriptor,
};
use std::path::Path;

/// Messages of the scene that are parameters: each is a group, named as the scene's field.
const FILES: [&str; 2] = ["cairn/v1/params.proto", "cairn/v1/scene.proto"];
/// These effects are settings of shapes and engine, which get no other parameters than `physics`.
const PHYSICS_SWITCHES: [&str; 6] =
    ["primitives", "decomposition", "continuous_collision", "stiff_contacts", "rolling_resistance", "restitution"];

/// The parameters as the schema declares them.
pub struct Schema {
    pool: DescriptorPool,
    /// Parents first. The first one is the scene itself.
    groups: Vec<Group>,
    enums: Vec<EnumDescriptor>,
}

/// A struct of the core.
struct Group {
    /// Its path in `Params`: `physics.switches`; empty for `Params` itself.
    path: String,
    type_name: String,
    /// The scene's field that has its values; empty for the scene itself.
    wire: String,
    message: MessageDescriptor,
    comment: String,
    parameters: Vec<Parameter>,
}

/// A field of the core.
struct Parameter {
    name: String,
    value: Value,
    /// May be absent.
    is_optional: bool,
    /// As the comment has it.
    default: String,
    range: Option<Range>,
    comment: String,
}

enum Value {
    Number,
    /// As many as there are; none if it is not set.
    Numbers,
    /// Signed on the wire, unsigned in the core.
    Count {
        bits: u32,
    },
    Flag,
    /// A flag that may be absent: a switch of the core.
    FlagOrAuto,
    Choice(EnumDescriptor),
    /// A number in one of several units.
    Measure(OneofDescriptor),
    /// Frame or seconds on the wire, seconds or absent in the core.
    Moment,
}

/// As in `Range: 0 to 1.` and `Range: above 0.`
struct Range {
    low: String,
    is_low_excluded: bool,
    high: Option<String>,
}

/// Compiles the schema of the service, comments included, from the folder that has `cairn/v1`.
pub fn compile(folder: impl AsRef<Path>) -> Result<protox::Compiler, protox::Error> {
    let mut compiler = protox::Compiler::new([folder])?;
    compiler.include_source_info(true).include_imports(true).open_file("cairn/v1/service.proto")?;
    Ok(compiler)
}

impl Schema {
    pub fn new(compiler: &protox::Compiler) -> Schema {
        let pool = compiler.descriptor_pool();
        let scene = pool.get_message_by_name("cairn.v1.Scene").expect("the schema has a scene");
        let mut groups = vec![Group::new("", "Params", "", scene.clone(), |_| true)];
        for field in scene.fields().filter(|field| !field.is_list()) {
            let Kind::Message(message) = field.kind() else { continue };
            if message.parent_file().name() != FILES[0] {
                continue;
            }
            let (name, is_engine) = (field.name(), |name: &str| PHYSICS_SWITCHES.contains(&name));
            if name == "effects" {
                groups.push(Group::new(name, message.name(), name, message.clone(), |name| !is_engine(name)));
                groups.push(Group::new("physics.switches", "PhysicsSwitches", name, message, is_engine));
            } else {
                groups.push(Group::new(name, message.name(), name, message.clone(), |_| true));
            }
        }
        let files = FILES.iter().map(|name| pool.get_file_by_name(name).expect("the service imports it"));
        let enums = files.flat_map(|file| file.enums().collect::<Vec<_>>()).collect();
        Schema { pool, groups, enums }
    }

    /// The groups that are fields of this one, by their names there.
    fn children<'a>(&'a self, of: &'a Group) -> impl Iterator<Item = (&'a str, &'a Group)> {
        let place = |group: &'a Group| group.path.rsplit_once('.').unwrap_or(("", &group.path));
        let is_child = move |(group, (parent, name)): &(&Group, (&str, &str))| {
            !name.is_empty() && *parent == of.path && group.path != of.path
        };
        self.groups
            .iter()
            .map(move |group| (group, place(group)))
            .filter(is_child)
            .map(|(group, (_, name))| (name, group))
    }
}

impl Group {
    fn new(path: &str, type_name: &str, wire: &str, message: MessageDescriptor, has: impl Fn(&str) -> bool) -> Group {
        let parameters = parameters(&message).into_iter().filter(|parameter| has(&parameter.name)).collect();
        let comment = comment(&message.parent_file(), message.path());
        Group { path: path.into(), type_name: type_name.into(), wire: wire.into(), message, comment, parameters }
    }

    /// A field of this group as code names it, `params.fill.order`.
    fn place(&self, root: &str, name: &str) -> String {
        [root, &self.path, name].iter().filter(|part| !part.is_empty()).copied().collect::<Vec<_>>().join(".")
    }
}

fn parameters(message: &MessageDescriptor) -> Vec<Parameter> {
    let is_plain = |field: &FieldDescriptor| match field.kind() {
        Kind::Message(_) => false,
        kind => !field.is_list() || matches!(kind, Kind::Double),
    };
    let single = message.fields().filter(is_plain);
    let single = single.filter(|field| !is_deprecated(field) && !is_text(field));
    let (one_of, alone): (Vec<_>, Vec<_>) = single.partition(|field| choice(field).is_some());
    let mut parameters: Vec<Parameter> = alone.iter().map(parameter).collect();
    for field in one_of {
        let choice = choice(&field).expect("only such fields are left");
        match parameters.iter_mut().find(|parameter| parameter.name == choice.name()) {
            // The default stands at the field that has it.
            Some(known) if known.default.is_empty() => known.default = stated(&of_field(&field), "Default: "),
            Some(_) => {}
            None => {
                let is_moment = choice.fields().any(|field| field.name().ends_with("_frame"));
                let value = if is_moment { Value::Moment } else { Value::Measure(choice.clone()) };
                let comment = comment(&choice.parent_message().parent_file(), choice.path());
                parameters.push(Parameter { name: choice.name().into(), value, comment, ..parameter(&field) });
            }
        }
    }
    parameters
}

fn parameter(field: &FieldDescriptor) -> Parameter {
    let comment = of_field(field);
    let default = stated(&comment, "Default: ");
    let is_absent = default.starts_with("not set");
    let value = match field.kind() {
        Kind::Double if field.is_list() => Value::Numbers,
        Kind::Double => Value::Number,
        Kind::Int32 => Value::Count { bits: 32 },
        Kind::Int64 => Value::Count { bits: 64 },
        Kind::Bool if is_absent => Value::FlagOrAuto,
        Kind::Bool => Value::Flag,
        Kind::Enum(of) => Value::Choice(of),
        kind => panic!("{}: no parameter is a {kind:?}", field.full_name()),
    };
    let is_optional = is_absent && !matches!(value, Value::FlagOrAuto | Value::Numbers);
    Parameter { name: field.name().into(), value, is_optional, default, range: Range::of(&comment), comment }
}

/// A name, which whoever reads the scene's files resolves: no parameter.
fn is_text(field: &FieldDescriptor) -> bool {
    matches!(field.kind(), Kind::String)
}

/// The wire still has it, for callers that were made before it was replaced.
fn is_deprecated(field: &FieldDescriptor) -> bool {
    field.field_descriptor_proto().options.as_ref().is_some_and(|options| options.deprecated())
}

/// The choice between fields that a field is part of.
fn choice(field: &FieldDescriptor) -> Option<OneofDescriptor> {
    field.containing_oneof().filter(|choice| !choice.is_synthetic())
}

impl Range {
    fn of(comment: &str) -> Option<Range> {
        let text = stated(comment, "Range: ");
        let (low, high) = text.split_once(" to ").map_or((&*text, None), |(low, high)| (low, Some(high.to_owned())));
        let excluded = low.strip_prefix("above ");
        let low = excluded.unwrap_or(low).to_owned();
        (!low.is_empty()).then_some(Range { low, is_low_excluded: excluded.is_some(), high })
    }
}

/// A value of the wire that the core never sees: whoever reads the scene's files puts another one in its place.
const CHOSEN: &str = "ACCURACY_AUTO";

/// The names of an enum's values in Rust, with their comments; the zero value is that of an unset field.
fn variants(of: &EnumDescriptor) -> Vec<(String, String)> {
    let values = of.values().filter(|value| value.number() != 0 && value.name() != CHOSEN);
    values.map(|value| (variant(of, value.name()), comment(&of.parent_file(), value.path()))).collect()
}

/// The name of an enum's value in Rust.
fn variant(of: &EnumDescriptor, full: &str) -> String {
    let prefix = of.default_value().name().trim_end_matches("UNSPECIFIED").to_owned();
    camel(full.strip_prefix(&prefix).expect("values begin with the enum's name"))
}

/// `AS_MODELLED` and `as_modelled` -> `AsModelled`.
fn camel(name: &str) -> String {
    let words = name.split('_').map(|word| word[..1].to_uppercase() + &word[1..].to_lowercase());
    words.collect()
}

/// A measure's type in the core, and for each of its fields the variant there.
fn measure(of: &OneofDescriptor) -> (String, Vec<(String, FieldDescriptor)>) {
    let unit = |field: &FieldDescriptor| camel(field.name().rsplit('_').next().expect("a name has a last word"));
    let fields: Vec<_> = of.fields().map(|field| (unit(&field), field)).collect();
    let is_time = fields.iter().any(|(unit, _)| unit == "Seconds");
    (if is_time { "Time".into() } else { camel(of.name()) }, fields)
}

fn of_field(field: &FieldDescriptor) -> String {
    comment(&field.parent_message().parent_file(), field.path())
}

/// The comment at a place of a file, its lines joined.
fn comment(file: &FileDescriptor, path: &[i32]) -> String {
    let source = file.file_descriptor_proto().source_code_info.as_ref().expect("the compiler was asked for comments");
    let found = source.location.iter().find(|location| location.path == path);
    found
        .map(|location| location.leading_comments())
        .unwrap_or_default()
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
}

/// The rest of a sentence after a word in a comment.
fn stated(comment: &str, word: &str) -> String {
    let rest = comment.split_once(word).map_or("", |(_, rest)| rest);
    rest[..rest.find(". ").unwrap_or(rest.trim_end_matches('.').len())].into()
}
