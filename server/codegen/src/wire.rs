//! Conversions between the core's parameters and the messages, for `cairn_wire`.

use crate::{
    CHOSEN, Group, Parameter, Schema, Value, camel, is_deprecated, is_text, measure, of_field, stated, variant,
    variants,
};
use protox::prost_reflect::{EnumDescriptor, FieldDescriptor, Kind, MessageDescriptor};
use std::collections::BTreeSet;
use std::fmt::Write;

impl Schema {
    /// The code that `parameters.rs` of `cairn_wire` includes.
    pub fn wire(&self) -> String {
        let mut code = String::new();
        let stage = self.pool.get_enum_by_name("cairn.v1.Stage").expect("the schema has stages");
        self.enums.iter().for_each(|of| twins(&mut code, of, "params"));
        twins(&mut code, &stage, "observer");
        code.push_str("/// The values that a scene sets.\n");
        code.push_str("pub fn set_all(params: &mut Params, scene: &proto::Scene, counts: &mut Counts) {\n");
        for group in &self.groups {
            // Messages with text or lists cannot be copied.
            let is_long = |field: FieldDescriptor| is_text(&field) || field.is_list();
            let clone = if group.message.fields().any(is_long) { ".clone()" } else { "" };
            let given = format!("scene.{}{clone}.unwrap_or_default()", group.wire);
            let given = if group.wire.is_empty() { "scene" } else { &given };
            writeln!(code, "let given = {given};").unwrap();
            group.parameters.iter().for_each(|parameter| from(&mut code, group, parameter));
            group.message.fields().filter(is_deprecated).for_each(|field| refuse(&mut code, group, &field));
        }
        code.push_str("}\n/// A scene of these parameters, without models.\n#[allow(deprecated)]\n");
        code.push_str("pub fn to_scene(params: &Params) -> proto::Scene {\nproto::Scene {\n");
        self.fields(&mut code, "");
        let groups: BTreeSet<_> = self.groups.iter().skip(1).map(|group| (&group.wire, group.message.name())).collect();
        for (wire, message) in groups {
            writeln!(code, "{wire}: Some(proto::{message} {{").unwrap();
            self.fields(&mut code, wire);
            code.push_str("}),\n");
        }
        code.push_str("..Default::default()\n}\n}\n");
        set_defaults(&mut code, &self.groups[0].message, &mut BTreeSet::new());
        code
    }

    /// All fields of a message, from wherever the core has them.
    fn fields(&self, code: &mut String, wire: &str) {
        for group in self.groups.iter().filter(|group| group.wire == wire) {
            group.parameters.iter().for_each(|parameter| to(code, group, parameter));
            let replaced = group.message.fields().filter(|field| is_deprecated(field) || is_text(field));
            replaced.for_each(|field| writeln!(code, "{}: None,", field.name()).unwrap());
        }
    }
}

/// Both conversions of an enum; a value that is not set is `None`.
fn twins(code: &mut String, of: &EnumDescriptor, module: &str) {
    let name = of.name();
    let (mut to, mut from) = (String::new(), String::new());
    for (variant, _) in variants(of) {
        writeln!(to, "Core::{variant} => Self::{variant},").unwrap();
        writeln!(from, "proto::{name}::{variant} => Some(Core::{variant}),").unwrap();
    }
    for value in of.values().filter(|value| value.name() == CHOSEN) {
        writeln!(from, "proto::{name}::{} => None,", variant(of, value.name())).unwrap();
    }
    let core = format!("use cairn_input::{module}::{name} as Core;");
    writeln!(
        code,
        "const _: () = {{\n{core}\n\
         impl From<Core> for proto::{name} {{ fn from(value: Core) -> Self {{ match value {{ {to} }} }} }}\n\
         impl From<proto::{name}> for Option<Core> {{ fn from(value: proto::{name}) -> Self {{ match value {{\n\
         proto::{name}::Unspecified => None,\n{from} }} }} }}\n}};"
    )
    .unwrap();
}

fn from(code: &mut String, group: &Group, parameter: &Parameter) {
    let name = &parameter.name;
    let given = match &parameter.value {
        Value::Number | Value::Flag => format!("given.{name}"),
        Value::Numbers => format!("(!given.{name}.is_empty()).then(|| given.{name}.clone())"),
        Value::Count { .. } => format!("given.{name}.map(|n| counts.natural(\"{}\", n))", group.place("", name)),
        Value::FlagOrAuto => format!("given.{name}.map(|on| if on {{ Switch::On }} else {{ Switch::Off }})"),
        Value::Choice(_) => format!("given.{name}().into()"),
        Value::Measure(of) => {
            let (core, fields) = measure(of);
            let wire = wire_choice(group, name);
            let arm = |(unit, field): &(String, FieldDescriptor)| {
                format!("{wire}::{}(number) => {core}::{unit}(number),", camel(field.name()))
            };
            format!("given.{name}.map(|of| match of {{ {} }})", fields.iter().map(arm).collect::<String>())
        }
        // Its frames are those of the output: by hand.
        Value::Moment => return,
    };
    let given = if parameter.is_optional { format!("{given}.map(Some)") } else { given };
    writeln!(code, "set(&mut {}, {given});", group.place("params", name)).unwrap();
}

/// A field that was replaced: its comment begins with what to do.
fn refuse(code: &mut String, group: &Group, field: &FieldDescriptor) {
    let (name, about) = (field.name(), of_field(field));
    let remedy = about.split_inclusive(". ").next().unwrap_or_default().trim_end();
    let place = group.place("", name);
    writeln!(code, "#[allow(deprecated)] counts.replaced(\"{place}\", given.{name}.is_some(), {remedy:?});").unwrap();
}

fn to(code: &mut String, group: &Group, parameter: &Parameter) {
    let (name, is_optional) = (&parameter.name, parameter.is_optional);
    let place = group.place("params", name);
    let value = match &parameter.value {
        Value::Number if is_optional => place,
        Value::Count { .. } if is_optional => format!("{place}.map(signed)"),
        Value::Number | Value::Flag => format!("Some({place})"),
        Value::Numbers => format!("{place}.clone()"),
        Value::Count { .. } => format!("Some(signed({place}))"),
        Value::FlagOrAuto => format!("match {place} {{ Switch::Auto => None, on => Some(on == Switch::On) }}"),
        Value::Choice(of) => format!("proto::{}::from({place}).into()", of.name()),
        Value::Measure(of) => {
            let (core, fields) = measure(of);
            let wire = wire_choice(group, name);
            let arm = |(unit, field): &(String, FieldDescriptor)| {
                format!("{core}::{unit}(number) => {wire}::{}(number),", camel(field.name()))
            };
            format!("Some(match {place} {{ {} }})", fields.iter().map(arm).collect::<String>())
        }
        Value::Moment => format!("{place}.map({}::{}Seconds)", wire_choice(group, name), camel(name)),
    };
    writeln!(code, "{name}: {value},").unwrap();
}

/// The type that prost gives a choice between fields.
fn wire_choice(group: &Group, name: &str) -> String {
    format!("proto::{}::{}", group.message.name().to_lowercase(), camel(name))
}

/// For a message and those in its lists: sets what is not set and has a default.
fn set_defaults(code: &mut String, message: &MessageDescriptor, known: &mut BTreeSet<String>) {
    if !known.insert(message.name().to_owned()) {
        return;
    }
    let mut inside = Vec::new();
    let about = "/// Sets every value that is not set and has a default, in the messages of lists, too.";
    writeln!(code, "impl proto::{} {{\n{about}\npub fn set_defaults(&mut self) {{", message.name()).unwrap();
    for field in message.fields() {
        let name = field.name();
        let default = stated(&crate::of_field(&field), "Default: ");
        let is_given = !default.is_empty() && !default.starts_with("not set");
        match field.kind() {
            Kind::Message(of) if field.is_list() => {
                writeln!(code, "self.{name}.iter_mut().for_each(proto::{}::set_defaults);", of.name()).unwrap();
                inside.push(of);
            }
            Kind::Enum(of) if is_given => {
                let (of, variant) = (of.name(), camel(&default));
                let is_unset = format!("self.{name}() == proto::{of}::Unspecified");
                writeln!(code, "if {is_unset} {{ self.set_{name}(proto::{of}::{variant}); }}").unwrap();
            }
            Kind::Double if is_given && field.is_list() => {
                let numbers = default.trim_matches(['[', ']']).replace(',', "_f64, ");
                writeln!(code, "if self.{name}.is_empty() {{ self.{name} = vec![{numbers}_f64]; }}").unwrap();
            }
            Kind::Double if is_given => writeln!(code, "self.{name}.get_or_insert({default}_f64);").unwrap(),
            Kind::Int32 | Kind::Int64 | Kind::Bool if is_given => {
                writeln!(code, "self.{name}.get_or_insert({default});").unwrap();
            }
            _ => {}
        }
    }
    code.push_str("}\n}\n");
    inside.iter().for_each(|of| set_defaults(code, of, known));
}
