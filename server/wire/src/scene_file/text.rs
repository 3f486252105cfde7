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

impl Parsed {
    /// The line of a field; of what has none of its own, that of what it is in.
    pub fn line(&self, path: &str) -> Option<usize> {
        let found = self.lines.get(path).copied();
        found.or_else(|| path.rsplit_once('.').and_then(|(above, _)| self.line(above)))
    }
}

/// A place where a text is no valid TOML or JSON.
#[derive(Debug, PartialEq)]
pub struct SyntaxError {
    pub line: Option<usize>,
    pub message: String,
}

/// Groups of fields in a text: twice the bodies that a scene may have, and room for the rest.
const MOST_GROUPS: usize = 250_000;
/// Values in a text, for each group of fields, and besides: lists of numbers of bodies.
const VALUES_OF_A_GROUP: usize = 40;
const VALUES_BESIDES: usize = 250_000;

/// Refuses a text of more groups and values than a scene has, before they take a hundred times its bytes.
fn check_size(text: &str) -> Result<(), Vec<SyntaxError>> {
    let (mut groups, mut values, mut before) = (0, 0, b'\n');
    for byte in text.bytes() {
        groups += usize::from(byte == b'{' || byte == b'[' && before == b'\n');
        values += usize::from(matches!(byte, b'=' | b':' | b',' | b'[' | b'{'));
        before = byte;
    }
    let refuse = |what: &str| Err(vec![SyntaxError { line: None, message: what.to_owned() }]);
    if groups > MOST_GROUPS {
        return refuse(&format!("it has more than {MOST_GROUPS} groups of fields, and a scene at most 100000 bodies"));
    }
    if values > VALUES_BESIDES + VALUES_OF_A_GROUP * groups {
        return refuse("its lists are longer than any of a scene");
    }
    Ok(())
}

pub fn parse_json(text: &str) -> Result<Parsed, Vec<SyntaxError>> {
    check_size(text)?;
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
    check_size(text)?;
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
                // The line of a number is that of its list.
                let is_group = matches!(element.get_ref(), DeValue::Table(_) | DeValue::Array(_));
                let path = if is_group { format!("{path}.{index}") } else { String::new() };
                if is_group {
                    lines.insert(path.clone(), ends.at(element.span().start));
                }
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

    #[test]
    fn a_number_has_the_line_of_its_list() {
        let parsed = parse_toml("a = 1\nb = [\n1,\n2]\n").unwrap();
        assert_eq!((parsed.line("b.1"), parsed.line("b"), parsed.line("c")), (Some(2), Some(2), None));
    }

    /// Without reading them: 300,000 bodies took 1.9 GB before their number was looked at.
    #[test]
    fn more_than_any_scene_has_is_refused_by_its_text() {
        let refused = |text: &str, read: fn(&str) -> Result<super::Parsed, Vec<super::SyntaxError>>| {
            read(text).expect_err("it is too large")[0].message.clone()
        };
        let bodies = "[[bodies]]\nprop = 'cube'\n".repeat(300_000);
        let what = refused(&bodies, parse_toml);
        assert!(what.contains("it has more than 250000 groups of fields, and a scene at most 100000 bodies"));
        let inline = format!("bodies = [{}]", "{prop='a'},".repeat(300_000));
        assert!(refused(&inline, parse_toml).contains("more than 250000 groups of fields"));
        let json = format!("{{\"bodies\": [{}{{}}]}}", "{},".repeat(300_000));
        assert!(refused(&json, super::parse_json).contains("more than 250000 groups of fields"));
        let numbers = format!("a = [{}]", "0,".repeat(600_000));
        assert!(refused(&numbers, parse_toml).contains("its lists are longer than any of a scene"));
    }
}
