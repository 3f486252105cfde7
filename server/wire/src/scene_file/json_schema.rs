//! The schema of scene files as a JSON Schema (draft 7, which editors know), made from the protobuf schema: comments
//! become descriptions, and their ranges and defaults become rules.

use super::check::alternatives;
use super::schema;
use prost_reflect::{EnumDescriptor, FieldDescriptor, Kind, MessageDescriptor};
use serde_json::{Map, Value, json};

/// The schema of `cairn.v1.Scene`.
pub fn scene() -> Value {
    let scene = schema::scene();
    let mut definitions = Map::new();
    define(&scene, &mut definitions);
    json!({
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "Scene of Cairn",
        "$ref": reference(scene.name()),
        "definitions": definitions,
    })
}

fn reference(name: &str) -> String {
    format!("#/definitions/{name}")
}

/// Adds a message and all messages that it refers to.
fn define(message: &MessageDescriptor, definitions: &mut Map<String, Value>) {
    if definitions.contains_key(message.name()) {
        return;
    }
    definitions.insert(message.name().to_owned(), Value::Null); // found by messages that refer back
    let mut properties = Map::new();
    let mut camel = Map::new();
    let mut exclusive = Vec::new();
    for field in message.fields() {
        properties.insert(field.name().to_owned(), property(&field, definitions));
        if field.json_name() != field.name() {
            let path = format!("{}/properties/{}", object_path(message), field.name());
            camel.insert(format!("^{}$", field.json_name()), json!({ "$ref": path }));
        }
        let others = alternatives(&field).into_iter().filter(|other| field.name() < other.as_str());
        exclusive.extend(others.map(|other| json!({ "required": [field.name(), other] })));
    }
    let mut object = json!({
        "type": "object",
        "description": schema::comment(&message.parent_file(), message.path()),
        "properties": properties,
        "additionalProperties": false,
    });
    // Names in lowerCamelCase are valid, but an editor should not offer them.
    if !camel.is_empty() {
        object["patternProperties"] = Value::Object(camel);
    }
    if !exclusive.is_empty() {
        object["not"] = json!({ "anyOf": exclusive });
    }
    let object = match schema::shorthand(message) {
        Some(first) => json!({ "anyOf": [object, kind(&first, definitions)] }),
        None => object,
    };
    definitions.insert(message.name().to_owned(), object);
}

/// The place of the definition of a message's group of fields.
fn object_path(message: &MessageDescriptor) -> String {
    let path = reference(message.name());
    if schema::shorthand(message).is_some() { format!("{path}/anyOf/0") } else { path }
}

fn property(field: &FieldDescriptor, definitions: &mut Map<String, Value>) -> Value {
    let comment = schema::comment(&field.parent_file(), field.path());
    let mut value = kind(field, definitions);
    for (rule, bound) in bounds(&comment) {
        value[rule] = bound;
    }
    if let Some(default) = default(field, &comment) {
        value["default"] = default;
    }
    if field.is_list() {
        value = json!({ "type": "array", "items": value });
    }
    if value.get("$ref").is_some() {
        // Draft 7 ignores everything beside a reference.
        value = json!({ "allOf": [value] });
    }
    value["description"] = comment.into();
    value
}

/// One value of a field.
fn kind(field: &FieldDescriptor, definitions: &mut Map<String, Value>) -> Value {
    match field.kind() {
        Kind::Message(group) => {
            define(&group, definitions);
            json!({ "$ref": reference(group.name()) })
        }
        Kind::Enum(names) => enumeration(&names),
        Kind::Double => json!({ "type": "number" }),
        Kind::Int32 | Kind::Int64 => json!({ "type": "integer" }),
        Kind::Bool => json!({ "type": "boolean" }),
        _ => json!({ "type": "string" }),
    }
}

/// Short names are offered; full names are valid, too.
fn enumeration(names: &EnumDescriptor) -> Value {
    let file = names.parent_file();
    let value = |value: prost_reflect::EnumValueDescriptor| {
        let short = schema::short_name(names, value.name());
        json!({ "const": short, "description": schema::comment(&file, value.path()) })
    };
    let mut choices: Vec<Value> = names.values().filter(|value| value.number() != 0).map(value).collect();
    let full: Vec<String> = names.values().map(|value| value.name().to_owned()).collect();
    choices.push(json!({ "pattern": format!("^({})$", full.join("|")) }));
    json!({ "type": "string", "anyOf": choices })
}

/// `Range: 0 to 2.`, `Range: above 0 to 2.` or `Range: 0.`
fn bounds(comment: &str) -> Vec<(&'static str, Value)> {
    let Some(range) = schema::stated(comment, "Range: ") else { return Vec::new() };
    let (low, high) = range.split_once(" to ").map_or((&*range, None), |(low, high)| (low, Some(high)));
    let low = match low.strip_prefix("above ") {
        Some(excluded) => ("exclusiveMinimum", number(excluded)),
        None => ("minimum", number(low)),
    };
    let bounds = [low, ("maximum", high.and_then(number))];
    bounds.into_iter().filter_map(|(rule, bound)| Some((rule, bound?))).collect()
}

/// `Default: 0.7.`
fn default(field: &FieldDescriptor, comment: &str) -> Option<Value> {
    let stated = schema::stated(comment, "Default: ")?;
    match field.kind() {
        Kind::Enum(names) => schema::choices(&names).contains(&stated).then(|| stated.into()),
        Kind::Bool => stated.parse::<bool>().ok().map(Value::from),
        Kind::Double | Kind::Int32 | Kind::Int64 => number(&stated),
        _ => None,
    }
}

fn number(text: &str) -> Option<Value> {
    text.parse::<i64>().map(Value::from).ok().or_else(|| text.parse::<f64>().ok().map(Value::from))
}
