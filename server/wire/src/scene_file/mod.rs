//! Scene files: the JSON or TOML mapping of `cairn.v1.Scene`, read with all problems reported, and written.

mod check;
pub mod json_schema;
pub mod schema;
mod set;
mod text;

use crate::proto;
use bytes::Bytes;
use cairn_files::fence::Fence;
use cairn_files::problem::Problem;
use cairn_files::{Disk, FileSource};
use check::Checker;
use prost::Message;
use prost_reflect::{DynamicMessage, EnumDescriptor, Kind, MessageDescriptor, SerializeOptions};
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};
use std::sync::Arc;
pub use text::from_f64 as number;

/// A message as JSON, with the schema's own names. `name`: of its type.
pub fn json_of(name: &str, message: &impl Message) -> Value {
    let descriptor = schema::pool().get_message_by_name(name).expect("the schema has it");
    let dynamic = DynamicMessage::decode(descriptor, Bytes::from(message.encode_to_vec()))
        .expect("the message is of this schema");
    let options = SerializeOptions::new().stringify_64_bit_integers(false).use_proto_field_name(true);
    dynamic.serialize_with_options(serde_json::value::Serializer, &options).expect("every message has a JSON mapping")
}

/// A scene as written, checked against the schema. Paths in it are relative to the current directory.
#[derive(Clone, Debug)]
pub struct SceneTree {
    /// Protobuf's JSON mapping in its plainest form: original field names, full enum names, groups written out.
    values: Value,
    /// The scene file's own.
    folder: PathBuf,
    files: Disk,
}

impl Default for SceneTree {
    fn default() -> Self {
        SceneTree { values: Value::Object(Map::new()), folder: PathBuf::new(), files: Disk::default() }
    }
}

impl SceneTree {
    /// Reads a `.toml` or `.json` scene file.
    pub fn load(path: &Path) -> Result<SceneTree, Vec<Problem>> {
        let name = path.display().to_string();
        let one = |what: &str, remedy: &str| vec![Problem::new(&name, what, remedy)];
        if cairn_files::is_model_file(path) {
            return Err(one("a mesh, not a scene file", "Give it by --control, --prop or --static."));
        }
        let extension = path.extension().unwrap_or_default();
        if !["toml", "json"].iter().any(|known| extension.eq_ignore_ascii_case(known)) {
            return Err(one("not a scene file", "A scene file's name ends in .toml or .json."));
        }
        let bytes = cairn_files::read(path).map_err(|problem| vec![problem])?;
        SceneTree::read(path, &bytes)
    }

    /// The scene file of this name with this content.
    pub fn read(path: &Path, bytes: &[u8]) -> Result<SceneTree, Vec<Problem>> {
        let name = path.display().to_string();
        let one = |what: &str, remedy: &str| vec![Problem::new(&name, what, remedy)];
        let is_toml = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
        let parse = if is_toml { text::parse_toml } else { text::parse_json };
        let text = std::str::from_utf8(bytes).map_err(|_| one("not a text file", "Save it as UTF-8."))?;
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let parsed = parse(text).map_err(|errors| {
            let place = |line: Option<usize>| line.map_or(name.clone(), |line| format!("{name}:{line}"));
            errors
                .into_iter()
                .map(|error| Problem::new(place(error.line), error.message, "Correct the file's syntax."))
                .collect::<Vec<_>>()
        })?;

        let place = |path: &str| parsed.line(path).map_or(name.clone(), |line| format!("{name}:{line}"));
        let mut checker = Checker::new(&place);
        let values = checker.message(&schema::scene(), &parsed.value, "");
        match values {
            Some(mut values) if checker.problems.is_empty() => {
                let folder = path.parent().unwrap_or(Path::new(""));
                if folder.to_str().is_none() {
                    let what = "the name of its folder is not UTF-8 text, and the paths in it could not be found";
                    return Err(one(what, "Rename the folder, or go into it and name the scene from there."));
                }
                rebase(&mut values, folder);
                Ok(SceneTree { values, folder: folder.to_owned(), files: Disk::default() })
            }
            _ => Err(checker.problems),
        }
    }

    /// The scene of a message: every field that is set.
    pub fn from_message(scene: &proto::Scene) -> SceneTree {
        let mut dynamic = DynamicMessage::new(schema::scene());
        dynamic.transcode_from(scene).expect("the message is of this schema");
        let options = SerializeOptions::new().stringify_64_bit_integers(false).use_proto_field_name(true);
        let values = dynamic.serialize_with_options(serde_json::value::Serializer, &options);
        SceneTree { values: values.expect("every message has a JSON mapping"), ..SceneTree::default() }
    }

    /// The problems of a tree that came from a message: names that the schema does not have.
    pub fn problems(&self) -> Vec<Problem> {
        let place = |path: &str| path.to_owned();
        let mut checker = Checker::new(&place);
        checker.message(&schema::scene(), &self.values, "");
        checker.problems.into_iter().map(|problem| Problem { field: problem.place.clone(), ..problem }).collect()
    }

    pub fn to_message(&self) -> proto::Scene {
        let dynamic = DynamicMessage::deserialize(schema::scene(), &self.values).expect("the tree was checked");
        proto::Scene::decode(Bytes::from(dynamic.encode_to_vec())).expect("the bytes are of this schema")
    }

    /// The scene file's own folder: results name files relative to it.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Where its files come from.
    pub fn files(&self) -> Arc<dyn FileSource> {
        Arc::new(self.files.clone())
    }

    /// The same scene with its files elsewhere.
    pub fn with_files(self, files: Disk) -> SceneTree {
        SceneTree { files, ..self }
    }

    /// The same scene, of which only some files may be read.
    pub fn fenced(self, fence: Fence) -> SceneTree {
        let files = Disk { fence: Some(Arc::new(fence)), ..self.files };
        SceneTree { files, ..self }
    }

    /// Changes one field by `path=value`.
    pub fn set(&mut self, assignment: &str) -> Result<(), Vec<Problem>> {
        set::set(&mut self.values, assignment)
    }

    /// Changes a field of the scene itself. The value must be in the tree's plain form.
    pub fn put(&mut self, field: &str, value: Value) {
        debug_assert!(schema::field(&schema::scene(), field).is_some());
        self.group_mut(None).insert(field.to_owned(), value);
    }

    /// Changes a field of one of the scene's groups. The value must be in the tree's plain form.
    pub fn put_in(&mut self, group: &str, field: &str, value: Value) {
        self.group_mut(Some(group)).insert(field.to_owned(), value);
    }

    fn group_mut(&mut self, group: Option<&str>) -> &mut Map<String, Value> {
        let scene = self.values.as_object_mut().expect("a scene is an object");
        match group {
            None => scene,
            Some(group) => {
                let group = scene.entry(group).or_insert_with(|| Value::Object(Map::new()));
                group.as_object_mut().expect("a group is an object")
            }
        }
    }

    /// The scene file in TOML.
    pub fn to_toml(&self) -> String {
        toml::to_string_pretty(&toml_value(&self.to_value())).expect("text, numbers and groups have a TOML form")
    }

    /// The scene file's values, in the schema's order.
    pub fn to_value(&self) -> Value {
        pretty(&schema::scene(), &self.values)
    }

    /// The scene file in JSON.
    pub fn to_json(&self) -> String {
        let mut text = serde_json::to_string_pretty(&self.to_value()).expect("values have a JSON form");
        text.push('\n');
        text
    }
}

/// Makes the paths of a scene file relative to the current directory.
fn rebase(scene: &mut Value, folder: &Path) {
    let join = |field: &str, model: &mut Value| {
        if let Some(Value::String(path)) = model.get_mut(field) {
            *path = folder.join(&*path).to_string_lossy().into_owned();
        }
    };
    for shape in ["control_mesh", "region", "from"] {
        if let Some(shape) = scene.get_mut(shape) {
            join("path", shape);
        }
    }
    let lists = [("props", "path"), ("statics", "path"), ("emitters", "mesh"), ("piles", "path"), ("around", "path")];
    for (list, field) in lists {
        let elements = scene.get_mut(list).and_then(Value::as_array_mut).into_iter().flatten();
        elements.for_each(|model| join(field, model));
    }
}

/// The tree in the schema's order, with short enum names.
fn pretty(message: &MessageDescriptor, value: &Value) -> Value {
    let mut map = Map::new();
    for field in message.fields() {
        let Some(value) = value.get(field.name()) else { continue };
        let one = |value: &Value| match field.kind() {
            Kind::Message(group) => pretty(&group, value),
            Kind::Enum(names) => short(&names, value),
            _ => value.clone(),
        };
        let value = match value {
            Value::Array(list) => Value::Array(list.iter().map(one).collect()),
            value => one(value),
        };
        map.insert(field.name().to_owned(), value);
    }
    Value::Object(map)
}

fn short(names: &EnumDescriptor, value: &Value) -> Value {
    value.as_str().map_or(value.clone(), |name| Value::String(schema::short_name(names, name)))
}

/// Values as TOML has them: infinite numbers, which are text in JSON, are floats.
fn toml_value(value: &Value) -> toml::Value {
    match value {
        Value::Null => unreachable!("an unset field is left out"),
        Value::Bool(boolean) => toml::Value::Boolean(*boolean),
        Value::Number(number) => match number.as_i64() {
            Some(integer) => toml::Value::Integer(integer),
            None => toml::Value::Float(number.as_f64().expect("a number is an integer or a double")),
        },
        Value::String(text) => match text::to_f64(value).filter(|number| !number.is_finite()) {
            Some(number) => toml::Value::Float(number),
            None => toml::Value::String(text.clone()),
        },
        Value::Array(list) => toml::Value::Array(list.iter().map(toml_value).collect()),
        Value::Object(map) => {
            toml::Value::Table(map.iter().map(|(name, value)| (name.clone(), toml_value(value))).collect())
        }
    }
}
