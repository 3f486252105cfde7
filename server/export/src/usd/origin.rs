//! The origin of a USD result, stored below `cairn` in the layer's custom data.
//!
//! `versions`, `request_blake3` and `result_blake3` are plain values, `scene` and `assets` are JSON: a dictionary of
//! USD cannot hold lists of groups.

use super::super::{ExportError, ORIGIN};
use super::layer::Layer;
use super::{TEXT, open};
use openusd::sdf::{AbstractData, FieldKey, Path, Value};
use openusd::usda;
use std::collections::HashMap;

type Dictionary = HashMap<String, Value>;

/// Entries that are stored as JSON.
const JSON: [&str; 2] = ["scene", "assets"];

/// Writes the origin into a layer.
pub fn write(layer: &mut Layer, origin: &serde_json::Value) -> Result<(), ExportError> {
    let mut entries = Dictionary::new();
    for (key, value) in origin.as_object().into_iter().flatten() {
        let value = match value {
            _ if JSON.contains(&key.as_str()) => {
                // Apostrophes in names are escaped, because the text stands between two of them.
                let json = serde_json::to_string(value).map_err(std::io::Error::from)?.replace('\'', "\\u0027");
                Value::String(layer.text(&json))
            }
            serde_json::Value::Object(members) => {
                let entry = |(key, value): (&String, &serde_json::Value)| Some((key.clone(), text(layer, value)?));
                Value::Dictionary(members.iter().filter_map(entry).collect())
            }
            plain => match text(layer, plain) {
                Some(text) => text,
                None => continue,
            },
        };
        entries.insert(key.clone(), value);
    }
    let data = Dictionary::from([(ORIGIN.to_owned(), Value::Dictionary(entries))]);
    layer.set(&Path::abs_root(), FieldKey::CustomLayerData, Value::Dictionary(data));
    Ok(())
}

fn text(layer: &Layer, value: &serde_json::Value) -> Option<Value> {
    value.as_str().map(|text| Value::String(layer.text(text)))
}

/// The origin that a file states, in any of USD's formats; `None` if it states none.
pub fn read(bytes: &[u8]) -> Option<serde_json::Value> {
    if bytes.starts_with(TEXT) {
        // The layer's data stands before the first prim, and no line of it begins as a prim does.
        const PRIM: &[u8] = b"\ndef ";
        let end = bytes.windows(PRIM.len()).position(|line| line == PRIM).unwrap_or(bytes.len());
        let layer = usda::parse(std::str::from_utf8(&bytes[..end]).ok()?).ok()?;
        return read_layer(&layer, |text| text.replace("\\\\", "\\"));
    }
    // The crate's readers trust what they read: some damaged files make them panic.
    std::panic::catch_unwind(|| read_layer(&*open(bytes)?, str::to_owned)).ok().flatten()
}

fn read_layer(layer: &dyn AbstractData, plain: impl Fn(&str) -> String) -> Option<serde_json::Value> {
    let data = layer.try_field(&Path::abs_root(), FieldKey::CustomLayerData.as_str()).ok()??.into_owned();
    let entries = data.try_as_dictionary()?.remove(ORIGIN)?.try_as_dictionary()?;
    let mut origin = serde_json::Map::new();
    for (key, value) in entries {
        let value = match value {
            Value::String(text) if JSON.contains(&key.as_str()) => serde_json::from_str(&plain(&text)).ok()?,
            Value::String(text) => plain(&text).into(),
            Value::Dictionary(members) => {
                let entry = |(key, value): (String, Value)| Some((key, plain(&value.try_as_string()?).into()));
                serde_json::Value::Object(members.into_iter().filter_map(entry).collect())
            }
            _ => continue,
        };
        origin.insert(key, value);
    }
    Some(origin.into())
}
