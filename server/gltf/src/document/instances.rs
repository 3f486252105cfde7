//! Nodes that show their mesh many times.

use glam::{DQuat, DVec3};
use serde_json::Value;

use super::{Document, DocumentError, LocalTransform, Object, reference, unit};
use crate::node::INSTANCING;

impl Document<'_> {
    /// The transforms at which a node shows its mesh, relative to the node; `None` for a node that is not instanced.
    pub fn instances(&self, node: &Object) -> Result<Option<Vec<LocalTransform>>, DocumentError> {
        let attributes = node.get("extensions").and_then(|e| e.get(INSTANCING)).and_then(|i| i.get("attributes"));
        let Some(attributes) = attributes.and_then(Value::as_object) else { return Ok(None) };
        let read = |key: &str| reference(attributes, key);
        let translations = read("TRANSLATION").map(|i| self.vectors::<3>(i)).transpose()?;
        let rotations = read("ROTATION").map(|i| self.vectors::<4>(i)).transpose()?;
        let scales = read("SCALE").map(|i| self.vectors::<3>(i)).transpose()?;
        let lengths =
            [translations.as_ref().map(Vec::len), rotations.as_ref().map(Vec::len), scales.as_ref().map(Vec::len)];
        let count = lengths.into_iter().flatten().min().unwrap_or(0);
        let copy = |i: usize| LocalTransform {
            translation: translations.as_ref().map_or(DVec3::ZERO, |t| t[i].into()),
            rotation: rotations.as_ref().map_or(DQuat::IDENTITY, |r| unit(DQuat::from_array(r[i]))),
            scale: scales.as_ref().map_or(DVec3::ONE, |s| s[i].into()),
        };
        Ok(Some((0..count).map(copy).collect()))
    }
}
