//! A file in which each body has the colour of a figure.

use super::{FoundBody, FoundPile};
use cairn_analysis::{AnalysedBody, PileAnalysis, Standing};
use cairn_gltf::Document;
use cairn_gltf::document::{DocumentError, Object, reference};
use glam::DMat4;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The figure that colours show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Figure {
    /// What each carries: dark blue nothing, yellow the most.
    Load,
    /// The least push that moves it, its neighbours held: red none, green that of half its weight or more.
    Margin,
    /// Green safe to remove, red not, yellow open.
    Removal,
    /// Green stands, red falls, orange falls with others.
    Standing,
}

/// Points of a scale from dark blue over green to yellow, as sRGB.
const LOAD: [[f64; 3]; 5] =
    [[0.27, 0.0, 0.33], [0.23, 0.32, 0.55], [0.13, 0.57, 0.55], [0.37, 0.79, 0.38], [0.99, 0.91, 0.14]];
/// From red over yellow to green.
const MARGIN: [[f64; 3]; 3] = [[0.78, 0.10, 0.12], [0.95, 0.80, 0.25], [0.16, 0.58, 0.30]];
/// A push of this share of its weight is a large margin.
const LARGE: f64 = 0.5;
const GREEN: [f64; 3] = MARGIN[2];
const YELLOW: [f64; 3] = MARGIN[1];
const ORANGE: [f64; 3] = [0.90, 0.45, 0.12];
const RED: [f64; 3] = MARGIN[0];
const GREY: [f64; 3] = [0.62, 0.62, 0.62];

fn on_scale(scale: &[[f64; 3]], share: f64) -> [f64; 3] {
    let at = share.clamp(0.0, 1.0) * (scale.len() - 1) as f64;
    let from = (at as usize).min(scale.len() - 2);
    let part = at - from as f64;
    std::array::from_fn(|k| scale[from][k] * (1.0 - part) + scale[from + 1][k] * part)
}

impl Figure {
    /// The colour of a body, sRGB; `largest`: the largest load.
    fn color(self, body: &AnalysedBody, largest: f64) -> [f64; 3] {
        match self {
            _ if body.standing == Standing::Pinned => GREY,
            Figure::Load => on_scale(&LOAD, if largest > 0.0 { (body.load / largest).sqrt() } else { 0.0 }),
            Figure::Margin => on_scale(&MARGIN, body.least_push.unwrap_or(0.0) / LARGE),
            Figure::Removal => match &body.removal {
                Some(removal) if removal.is_safe => GREEN,
                Some(removal) if removal.is_open => YELLOW,
                Some(_) => RED,
                None => ORANGE,
            },
            Figure::Standing => match body.standing {
                Standing::Stands => GREEN,
                Standing::FallsWithOthers => ORANGE,
                _ => RED,
            },
        }
    }
}

/// A `.glb` of the bodies and the scenery as they stand, each body in the colour of its figure and with all of its
/// figures as extras. Materials and animations of the file are not in it.
pub fn colored(
    document: &Document,
    pile: &FoundPile,
    analysis: &PileAnalysis,
    figure: Figure,
) -> Result<Vec<u8>, DocumentError> {
    let mut writer = Writer { document, materials: Vec::new(), meshes: Vec::new(), nodes: Vec::new() };
    let largest = analysis.bodies.iter().map(|body| body.load).fold(0.0, f64::max);
    let (mut bodies, mut scenery) = (Vec::new(), Vec::new());
    for (body, figures) in pile.bodies.iter().zip(&analysis.bodies) {
        let color = figure.color(figures, largest);
        bodies.push(writer.add(body, color, json!({ "cairn": figures }))?);
    }
    for piece in &pile.scenery {
        scenery.push(writer.add(piece, GREY, Value::Null)?);
    }
    writer.nodes.push(json!({ "name": cairn_render::nodes::PILE, "children": bodies }));
    scenery.push(writer.nodes.len() - 1);
    writer.finish(&scenery)
}

struct Writer<'a> {
    document: &'a Document<'a>,
    materials: Vec<Value>,
    meshes: Vec<Value>,
    nodes: Vec<Value>,
}

impl Writer<'_> {
    /// Adds a body, and gives the index of its node.
    fn add(&mut self, body: &FoundBody, color: [f64; 3], extras: Value) -> Result<usize, DocumentError> {
        let linear = color.map(|c| if c <= 0.04045 { c / 12.92 } else { libm::pow((c + 0.055) / 1.055, 2.4) });
        let factor = [linear[0], linear[1], linear[2], 1.0].map(|c| (c * 1e4).round() / 1e4);
        let material = json!({
            "pbrMetallicRoughness": { "baseColorFactor": factor, "metallicFactor": 0.0, "roughnessFactor": 0.8 },
            "doubleSided": true,
        });
        let number = self.materials.iter().position(|known| *known == material).unwrap_or_else(|| {
            self.materials.push(material);
            self.materials.len() - 1
        });
        let mut parts = Vec::new();
        for (mesh, place) in &body.parts {
            let mut copy = self.document.get("meshes", *mesh)?.clone();
            copy.remove("weights");
            for primitive in copy.get_mut("primitives").and_then(Value::as_array_mut).into_iter().flatten() {
                let Some(primitive) = primitive.as_object_mut() else { continue };
                primitive.insert("material".into(), number.into());
                ["extensions", "targets", "extras"].iter().for_each(|key| drop(primitive.remove(*key)));
                if let Some(attributes) = primitive.get_mut("attributes").and_then(Value::as_object_mut) {
                    attributes.retain(|key, _| key == "POSITION" || key == "NORMAL");
                }
            }
            self.meshes.push(copy.into());
            let matrix = DMat4::from(*place).to_cols_array();
            parts.push(json!({ "mesh": self.meshes.len() - 1, "matrix": matrix, "name": body.name }));
        }
        let mut node = match parts.len() {
            1 => parts.remove(0),
            _ => {
                let first = self.nodes.len();
                self.nodes.append(&mut parts);
                json!({ "name": body.name, "children": (first..self.nodes.len()).collect::<Vec<_>>() })
            }
        };
        if !extras.is_null() {
            node["extras"] = extras;
        }
        self.nodes.push(node);
        Ok(self.nodes.len() - 1)
    }

    /// The file. Buffers that no accessor needs any more are left out.
    fn finish(mut self, roots: &[usize]) -> Result<Vec<u8>, DocumentError> {
        let (mut accessors, mut views, mut bin) = (Vec::new(), Vec::new(), Vec::new());
        let mut known: BTreeMap<usize, usize> = BTreeMap::new();
        let mut view_of: BTreeMap<usize, usize> = BTreeMap::new();
        let document = self.document;
        let mut view = |index: usize, views: &mut Vec<Value>| -> Result<usize, DocumentError> {
            if let Some(&number) = view_of.get(&index) {
                return Ok(number);
            }
            let mut copy = document.get("bufferViews", index)?.clone();
            let bytes = document.view(index)?;
            bin.resize(usize::next_multiple_of(bin.len(), 4), 0);
            copy.insert("buffer".into(), 0.into());
            copy.insert("byteOffset".into(), bin.len().into());
            copy.remove("extensions");
            bin.extend_from_slice(bytes);
            views.push(copy.into());
            view_of.insert(index, views.len() - 1);
            Ok(views.len() - 1)
        };
        let mut accessor = |index: usize| -> Result<usize, DocumentError> {
            if let Some(&number) = known.get(&index) {
                return Ok(number);
            }
            let mut copy = document.get("accessors", index)?.clone();
            if let Some(own) = reference(&copy, "bufferView") {
                copy.insert("bufferView".into(), view(own, &mut views)?.into());
            }
            for key in ["indices", "values"] {
                let part = copy.get_mut("sparse").and_then(|sparse| sparse.get_mut(key)).and_then(Value::as_object_mut);
                if let Some(part) = part
                    && let Some(own) = reference(part, "bufferView")
                {
                    part.insert("bufferView".into(), view(own, &mut views)?.into());
                }
            }
            accessors.push(Value::from(copy));
            known.insert(index, accessors.len() - 1);
            Ok(accessors.len() - 1)
        };
        for mesh in &mut self.meshes {
            for primitive in mesh.get_mut("primitives").and_then(Value::as_array_mut).into_iter().flatten() {
                let Some(primitive) = primitive.as_object_mut() else { continue };
                if let Some(indices) = reference(primitive, "indices") {
                    primitive.insert("indices".into(), accessor(indices)?.into());
                }
                if let Some(attributes) = primitive.get_mut("attributes").and_then(Value::as_object_mut) {
                    for key in ["POSITION", "NORMAL"] {
                        if let Some(own) = reference(attributes, key) {
                            attributes.insert(key.into(), accessor(own)?.into());
                        }
                    }
                }
            }
        }
        bin.resize(usize::next_multiple_of(bin.len(), 4), 0);
        let mut json = Object::new();
        json.insert(
            "asset".into(),
            json!({ "version": "2.0", "generator": concat!("cairn ", env!("CARGO_PKG_VERSION")) }),
        );
        json.insert("scene".into(), 0.into());
        json.insert("scenes".into(), json!([{ "nodes": roots }]));
        json.insert("nodes".into(), self.nodes.into());
        json.insert("meshes".into(), self.meshes.into());
        json.insert("materials".into(), self.materials.into());
        json.insert("accessors".into(), accessors.into());
        json.insert("bufferViews".into(), views.into());
        json.insert("buffers".into(), json!([{ "byteLength": bin.len() }]));
        for key in ["extensionsUsed", "extensionsRequired"] {
            let all = self.document.json().get(key).and_then(Value::as_array);
            if all.is_some_and(|all| all.iter().any(|name| name == QUANTIZATION)) {
                json.insert(key.into(), json!([QUANTIZATION]));
            }
        }
        let mut text = serde_json::to_vec(&json)?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let word = |n: usize| u32::try_from(n).unwrap_or(u32::MAX).to_le_bytes();
        let mut glb = Vec::with_capacity(28 + text.len() + bin.len());
        glb.extend_from_slice(b"glTF");
        glb.extend_from_slice(&2u32.to_le_bytes());
        glb.extend_from_slice(&word(28 + text.len() + bin.len()));
        glb.extend_from_slice(&word(text.len()));
        glb.extend_from_slice(b"JSON");
        glb.extend_from_slice(&text);
        glb.extend_from_slice(&word(bin.len()));
        glb.extend_from_slice(b"BIN\0");
        glb.extend_from_slice(&bin);
        Ok(glb)
    }
}

/// The extension whose accessors of positions hold integers.
const QUANTIZATION: &str = "KHR_mesh_quantization";
