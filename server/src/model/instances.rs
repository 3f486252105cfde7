//! Nodes that show their mesh many times.

use super::accessor;
use super::document::{Document, DocumentError, reference};
use super::local::{Local, unit};
use glam::{DQuat, DVec3};
use serde_json::{Map, Value};

/// Draws a node's mesh many times; its attributes are accessors.
pub const INSTANCING: &str = "EXT_mesh_gpu_instancing";

/// Where a node shows its mesh, relative to itself; `None` where it does so once, as any other.
pub fn instances(document: &Document, node: &Map<String, Value>) -> Result<Option<Vec<Local>>, DocumentError> {
    let attributes = node.get("extensions").and_then(|e| e.get(INSTANCING)).and_then(|i| i.get("attributes"));
    let Some(attributes) = attributes.and_then(Value::as_object) else { return Ok(None) };
    let read = |key: &str| reference(attributes, key);
    let translations = read("TRANSLATION").map(|i| accessor::vectors::<3>(document, i)).transpose()?;
    let rotations = read("ROTATION").map(|i| accessor::vectors::<4>(document, i)).transpose()?;
    let scales = read("SCALE").map(|i| accessor::vectors::<3>(document, i)).transpose()?;
    let lengths =
        [translations.as_ref().map(Vec::len), rotations.as_ref().map(Vec::len), scales.as_ref().map(Vec::len)];
    let count = lengths.into_iter().flatten().min().unwrap_or(0);
    let copy = |i: usize| Local {
        translation: translations.as_ref().map_or(DVec3::ZERO, |t| t[i].into()),
        rotation: rotations.as_ref().map_or(DQuat::IDENTITY, |r| unit(DQuat::from_array(r[i]))),
        scale: scales.as_ref().map_or(DVec3::ONE, |s| s[i].into()),
    };
    Ok(Some((0..count).map(copy).collect()))
}
