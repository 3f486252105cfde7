//! `--set path=value`: changes one field of a scene, typed by the schema.

use super::check::{Checker, alternatives};
use super::{schema, text};
use cairn_files::problem::Problem;
use prost_reflect::{FieldDescriptor, Kind, MessageDescriptor};
use serde_json::{Map, Value};

/// A step into the tree.
enum Step {
    Field(FieldDescriptor),
    /// An element of the list of the step before.
    Element(usize),
}

/// Applies one `path=value` to a checked tree. The value is in TOML's notation; text needs no quotes; `null` unsets.
pub fn set(tree: &mut Value, assignment: &str) -> Result<(), Vec<Problem>> {
    let place = format!("--set {assignment}");
    let fail = |what: &str, remedy: String| vec![Problem::new(place.clone(), what, remedy)];
    let Some((path, given)) = assignment.split_once('=') else {
        return Err(fail("no value", "Write path=value, for example fill.count=200.".into()));
    };
    let mut steps = resolve(path.trim()).map_err(|(what, remedy)| fail(&what, remedy))?;
    let (mut field, mut is_element) = target(&steps);
    if let (Kind::Message(group), true) = (field.kind(), is_element || !field.is_list())
        && let Some(first) = schema::shorthand(&group)
        && !given.trim_start().starts_with('{')
    {
        steps.push(Step::Field(first.clone()));
        (field, is_element) = (first, false);
    }

    let at = |_: &str| place.clone();
    let mut checker = Checker::new(&at);
    let value = read(&field, is_element, given.trim());
    let checked = match &value {
        Value::Null => None,
        value if is_element => checker.single(&field, value, path),
        value => checker.field(&field, value, path),
    };
    if !checker.problems.is_empty() {
        return Err(checker.problems);
    }
    put(tree, &steps, checked)
        .map_err(|count| fail(&format!("the list has {count} elements"), "They are counted from 0.".into()))
}

/// The value as text where the field holds text or a name, else in TOML's notation.
fn read(field: &FieldDescriptor, is_element: bool, given: &str) -> Value {
    if given == "null" {
        return Value::Null;
    }
    let is_text = matches!(field.kind(), Kind::String | Kind::Enum(_)) && (is_element || !field.is_list());
    let unquoted = given.strip_prefix('"').and_then(|given| given.strip_suffix('"')).unwrap_or(given);
    if is_text {
        return Value::String(unquoted.to_owned());
    }
    text::parse_value(given).unwrap_or_else(|| Value::String(given.to_owned()))
}

fn resolve(path: &str) -> Result<Vec<Step>, (String, String)> {
    let mut steps = Vec::new();
    let mut group: Option<MessageDescriptor> = Some(schema::scene());
    let mut list: Option<FieldDescriptor> = None;
    for name in path.split('.') {
        if let Some(field) = list.take() {
            let index = name.parse().map_err(|_| {
                (
                    format!("`{}` is a list", field.name()),
                    format!("Name one by its number, counted from 0: {}.0.", field.name()),
                )
            })?;
            steps.push(Step::Element(index));
            continue;
        }
        let Some(message) = group.take() else {
            return Err((
                format!("there is no field below `{}`", path.rsplit_once('.').map_or(path, |(above, _)| above)),
                String::new(),
            ));
        };
        let field = schema::field(&message, name)
            .ok_or_else(|| (format!("unknown field `{name}`"), schema::suggest(&message, name)))?;
        group = field.kind().as_message().cloned();
        list = field.is_list().then(|| field.clone());
        steps.push(Step::Field(field));
    }
    Ok(steps)
}

/// The field that the steps end at, and whether they end at an element of it.
fn target(steps: &[Step]) -> (FieldDescriptor, bool) {
    let is_element = matches!(steps.last(), Some(Step::Element(_)));
    let field = steps.iter().rev().find_map(|step| match step {
        Step::Field(field) => Some(field.clone()),
        Step::Element(_) => None,
    });
    (field.expect("a path begins with a field"), is_element)
}

/// Puts a value at the end of the steps, creating groups and one further element of a list where needed. Fails with a
/// list's length if a step leads past its end.
fn put(tree: &mut Value, steps: &[Step], value: Option<Value>) -> Result<(), usize> {
    let Some((step, rest)) = steps.split_first() else {
        *tree = value.unwrap_or(Value::Null);
        return Ok(());
    };
    match step {
        Step::Field(field) => {
            if !tree.is_object() {
                *tree = Value::Object(Map::new());
            }
            let map = tree.as_object_mut().expect("made above");
            if rest.is_empty() && value.is_none() {
                map.shift_remove(field.name());
                return Ok(());
            }
            for other in alternatives(field) {
                map.shift_remove(&other);
            }
            put(map.entry(field.name()).or_insert(Value::Null), rest, value)
        }
        Step::Element(index) => {
            if !tree.is_array() {
                *tree = Value::Array(Vec::new());
            }
            let list = tree.as_array_mut().expect("made above");
            if rest.is_empty() && value.is_none() {
                return if *index < list.len() {
                    list.remove(*index);
                    Ok(())
                } else {
                    Err(list.len())
                };
            }
            if *index > list.len() {
                return Err(list.len());
            }
            if *index == list.len() {
                list.push(Value::Null);
            }
            put(&mut list[*index], rest, value)
        }
    }
}
