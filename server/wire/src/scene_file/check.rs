//! Checks a tree of values against the schema: reports every unknown field and wrong type at once, each with its place.
//!
//! The result is protobuf's JSON mapping in its plainest form: original field names, full enum names, groups written
//! out.

use super::schema;
use super::text::{from_f64, to_f64};
use cairn_files::problem::{Problem, nearest};
use prost_reflect::{EnumDescriptor, FieldDescriptor, Kind, MessageDescriptor};
use serde_json::{Map, Value};

/// Checks a tree against the schema and collects the problems.
pub struct Checker<'a> {
    /// The place that a message names for the field at a path.
    place: &'a dyn Fn(&str) -> String,
    pub problems: Vec<Problem>,
}

impl<'a> Checker<'a> {
    pub fn new(place: &'a dyn Fn(&str) -> String) -> Checker<'a> {
        Checker { place, problems: Vec::new() }
    }

    fn report(&mut self, path: &str, what: String, remedy: impl Into<String>) {
        self.problems.push(Problem::new((self.place)(path), what, remedy));
    }

    /// A group: an object, or a string that sets its first field.
    pub fn message(&mut self, message: &MessageDescriptor, value: &Value, path: &str) -> Option<Value> {
        match (value, schema::shorthand(message)) {
            (Value::Object(map), _) => Some(Value::Object(self.fields(message, map, path))),
            (Value::String(_), Some(first)) => {
                let value = self.single(&first, value, path)?;
                Some(Value::Object(Map::from_iter([(first.name().to_owned(), value)])))
            }
            _ => self.mistyped(path, value, "a group of fields"),
        }
    }

    fn fields(&mut self, message: &MessageDescriptor, map: &Map<String, Value>, path: &str) -> Map<String, Value> {
        let mut checked = Map::new();
        for (name, value) in map {
            let path = join(path, name);
            let Some(field) = schema::field(message, name) else {
                self.report(&path, format!("unknown field `{path}`"), schema::suggest(message, name));
                continue;
            };
            if let Some(other) = rival(&field, &checked) {
                self.report(&path, format!("`{path}` and `{other}` exclude each other"), "Set one of them.");
                continue;
            }
            if value.is_null() {
                continue;
            }
            if let Some(value) = self.field(&field, value, &path) {
                checked.insert(field.name().to_owned(), value);
            }
        }
        checked
    }

    /// The value of a field; of a list, all of its elements.
    pub fn field(&mut self, field: &FieldDescriptor, value: &Value, path: &str) -> Option<Value> {
        if !field.is_list() {
            return self.single(field, value, path);
        }
        let Value::Array(elements) = value else { return self.mistyped(path, value, "a list") };
        let checked = elements
            .iter()
            .enumerate()
            .map(|(index, element)| self.single(field, element, &join(path, &index.to_string())));
        // All elements are checked before the first failure counts, so that all problems are reported.
        let checked: Vec<Option<Value>> = checked.collect();
        checked.into_iter().collect::<Option<Vec<Value>>>().map(Value::Array)
    }

    /// A single value, or one element of a list.
    pub fn single(&mut self, field: &FieldDescriptor, value: &Value, path: &str) -> Option<Value> {
        match field.kind() {
            Kind::Message(group) => self.message(&group, value, path),
            Kind::Enum(names) => self.name(&names, value, path),
            Kind::Double => to_f64(value).map(from_f64).or_else(|| self.mistyped(path, value, "a number")),
            Kind::Int32 => self.integer(value, path, i64::from(i32::MIN)..=i64::from(i32::MAX)),
            Kind::Int64 => self.integer(value, path, i64::MIN..=i64::MAX),
            Kind::Bool if value.is_boolean() => Some(value.clone()),
            Kind::Bool => self.mistyped(path, value, "true or false"),
            Kind::String if value.is_string() => Some(value.clone()),
            Kind::String => self.mistyped(path, value, "text in quotes"),
            kind => unreachable!("the schema has no {kind:?}"),
        }
    }

    fn integer(&mut self, value: &Value, path: &str, range: std::ops::RangeInclusive<i64>) -> Option<Value> {
        let whole = match value {
            Value::Number(number) => number
                .as_i64()
                .or_else(|| number.as_f64().filter(|number| is_exact(*number)).map(|number| number as i64)),
            Value::String(text) => text.parse().ok(),
            _ => None,
        };
        match whole {
            Some(whole) if range.contains(&whole) => Some(Value::Number(whole.into())),
            Some(_) => self.mistyped(path, value, &format!("a whole number up to {}", range.end())),
            None if value.as_f64().is_some_and(|number| number.fract() == 0.0) => {
                self.mistyped(path, value, &format!("a whole number up to {}", range.end()))
            }
            None => self.mistyped(path, value, "a whole number"),
        }
    }

    fn name(&mut self, names: &EnumDescriptor, value: &Value, path: &str) -> Option<Value> {
        let given = match value {
            Value::String(given) => given.as_str(),
            _ => return self.mistyped(path, value, "a name in quotes"),
        };
        if let Some(full) = schema::full_name(names, given) {
            return Some(Value::String(full));
        }
        let choices = schema::choices(names);
        let remedy = match nearest(given, choices.iter().map(String::as_str)) {
            Some(meant) => format!("Did you mean `{meant}`? Possible: {}.", choices.join(", ")),
            None => format!("Possible: {}.", choices.join(", ")),
        };
        self.report(path, format!("`{path}` cannot be `{given}`"), remedy);
        None
    }

    fn mistyped(&mut self, path: &str, value: &Value, wanted: &str) -> Option<Value> {
        let what = format!(
            "{} is {}",
            if path.is_empty() { "the scene".into() } else { format!("`{path}`") },
            describe(value)
        );
        self.report(path, what, format!("It must be {wanted}."));
        None
    }
}

/// A field already set that excludes this one: the same under its other name, or another of its oneof.
fn rival(field: &FieldDescriptor, set: &Map<String, Value>) -> Option<String> {
    if set.contains_key(field.name()) {
        return Some(field.name().to_owned());
    }
    alternatives(field).into_iter().find(|name| set.contains_key(name))
}

/// The other fields of which at most one can be set together with this one.
pub fn alternatives(field: &FieldDescriptor) -> Vec<String> {
    let choice = field.containing_oneof().filter(|choice| !choice.is_synthetic());
    let names =
        choice.iter().flat_map(|choice| choice.fields().map(|other| other.name().to_owned()).collect::<Vec<_>>());
    names.filter(|name| name != field.name()).collect()
}

/// Whether a double is a whole number that it holds exactly.
fn is_exact(number: f64) -> bool {
    const LARGEST: f64 = (1_u64 << f64::MANTISSA_DIGITS) as f64;
    number.fract() == 0.0 && number.abs() <= LARGEST
}

fn describe(value: &Value) -> String {
    /// Characters of a text that a message quotes.
    const LONGEST: usize = 40;
    match value {
        Value::Null => "null".into(),
        Value::Bool(_) | Value::Number(_) => value.to_string(),
        Value::String(text) if text.chars().count() > LONGEST => {
            format!("the text \"{}...\"", text.chars().take(LONGEST).collect::<String>())
        }
        Value::String(text) => format!("the text \"{text}\""),
        Value::Array(_) => "a list".into(),
        Value::Object(_) => "a group of fields".into(),
    }
}

pub fn join(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}
