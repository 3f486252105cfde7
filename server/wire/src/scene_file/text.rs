//! TOML or JSON text -> a tree of plain values, with the lines of its fields where the format's reader reports them.

use serde_json::{Map, Number, Value};
use std::collections::BTreeMap;
use toml::de::{DeTable, DeValue};

/// A scene file's text as values: not yet checked against the schema.
#[derive(Debug, Default)]
pub struct Parsed {
    pub value: Value,
    /// Line of each field by its dotted path (`props.0.weight`), counted from 1. JSON's reader reports none.
    pub lines: BTreeMap<String, usize>,
}

/// A place where a text is no valid TOML or JSON.
#[derive(Debug, PartialEq)]
pub struct SyntaxError {
    pub line: Option<usize>,
    pub message: String,
}

pub fn parse_json(text: &str) -> Result<Parsed, Vec<SyntaxError>> {
    match serde_json::from_str(text) {
        Ok(value) => Ok(Parsed { value, lines: BTreeMap::new() }),
        Err(error) => {
            let whole = error.to_string();
            let message = whole.rsplit_once(" at line ").map_or(whole.as_str(), |(message, _)| message).to_owned();
            Err(vec![SyntaxError { line: Some(error.line()), message }])
        }
    }
}

pub fn parse_toml(text: &str) -> Result<Parsed, Vec<SyntaxError>> {
    let (table, errors) = DeTable::parse_recoverable(text);
    let ends = LineEnds::of(text);
    if !errors.is_empty() {
        let at = |error: &toml::de::Error| error.span().map(|span| ends.at(span.start));
        return Err(errors
            .iter()
            .map(|error| SyntaxError { line: at(error), message: error.message().replace('\n', ", ") })
            .collect());
    }
    let mut lines = BTreeMap::new();
    let value = from_table(table.get_ref(), &ends, "", &mut lines);
    Ok(Parsed { value, lines })
}

/// One value in TOML's notation, as `--set` takes it.
pub fn parse_value(text: &str) -> Option<Value> {
    let value = DeValue::parse(text).ok()?;
    Some(from_value(value.get_ref(), &LineEnds::of(text), "", &mut BTreeMap::new()))
}

fn from_table(table: &DeTable, ends: &LineEnds, path: &str, lines: &mut BTreeMap<String, usize>) -> Value {
    let mut map = Map::new();
    // In the order of the text: the table itself is sorted by name.
    let mut entries: Vec<_> = table.iter().collect();
    entries.sort_by_key(|(key, _)| key.span().start);
    for (key, value) in entries {
        let path = if path.is_empty() { key.get_ref().to_string() } else { format!("{path}.{}", key.get_ref()) };
        lines.insert(path.clone(), ends.at(key.span().start));
        map.insert(key.get_ref().to_string(), from_value(value.get_ref(), ends, &path, lines));
    }
    Value::Object(map)
}

fn from_value(value: &DeValue, ends: &LineEnds, path: &str, lines: &mut BTreeMap<String, usize>) -> Value {
    match value {
        DeValue::String(string) => Value::String(string.to_string()),
        DeValue::Integer(integer) => match i64::from_str_radix(integer.as_str(), integer.radix()) {
            Ok(number) => Value::Number(number.into()),
            // A number too large for any field.
            Err(_) => integer.as_str().parse().map_or_else(|_| Value::String(integer.as_str().to_owned()), from_f64),
        },
        DeValue::Float(float) => match float.as_str().parse::<f64>() {
            Ok(number) => from_f64(number),
            Err(_) => Value::String(float.as_str().to_owned()),
        },
        DeValue::Boolean(boolean) => Value::Bool(*boolean),
        DeValue::Datetime(datetime) => Value::String(datetime.to_string()),
        DeValue::Array(array) => {
            let elements = array.iter().enumerate().map(|(index, element)| {
                let path = format!("{path}.{index}");
                lines.insert(path.clone(), ends.at(element.span().start));
                from_value(element.get_ref(), ends, &path, lines)
            });
            Value::Array(elements.collect())
        }
        DeValue::Table(table) => from_table(table, ends, path, lines),
    }
}

/// A double as protobuf's JSON mapping writes it: values for which JSON has no number are strings.
pub fn from_f64(number: f64) -> Value {
    match Number::from_f64(number) {
        Some(number) => Value::Number(number),
        None if number.is_nan() => Value::String("NaN".into()),
        None if number > 0.0 => Value::String("Infinity".into()),
        None => Value::String("-Infinity".into()),
    }
}

/// The inverse of [`from_f64`]; also takes numbers written as text, as the mapping allows.
pub fn to_f64(value: &Value) -> Option<f64> {
    match value {
        Value::Number(number) => number.as_f64(),
        Value::String(text) => match text.as_str() {
            "NaN" => Some(f64::NAN),
            "Infinity" => Some(f64::INFINITY),
            "-Infinity" => Some(f64::NEG_INFINITY),
            text => text.parse().ok().filter(|number: &f64| number.is_finite()),
        },
        _ => None,
    }
}

/// The ends of a text's lines, found once: a scene may have 100,000 fields.
struct LineEnds(Vec<usize>);

impl LineEnds {
    fn of(text: &str) -> LineEnds {
        LineEnds(text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n').map(|(at, _)| at).collect())
    }

    /// The line of an offset, counted from 1.
    fn at(&self, offset: usize) -> usize {
        self.0.partition_point(|end| *end < offset) + 1
    }
}

#[cfg(test)]
mod tests {
    use super::parse_toml;

    /// The most bodies that a scene may have. A search of the text for each line would take an hour.
    #[test]
    fn very_many_bodies_each_with_its_line() {
        const BODIES: usize = 100_000;
        let parsed = parse_toml(&"[[bodies]]\nprop = 'cube'\n".repeat(BODIES)).unwrap();
        assert_eq!(parsed.value["bodies"].as_array().unwrap().len(), BODIES);
        assert_eq!(parsed.lines[&format!("bodies.{}.prop", BODIES - 1)], 2 * BODIES);
    }
}
