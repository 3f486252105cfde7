//! A stage as a `.glb`, for what shows results: the renderer and the contact sheet. It has what the file itself has:
//! meshes, base colours, and the motion of instances and of prims.
//!
//! One layer is read. What it takes from others by references, payloads and sublayers is not there, nor are variants,
//! skins, subdivision, and materials other than `UsdPreviewSurface`.

mod mesh;
mod surface;
mod values;

use super::super::copy::GlbOutput;
use super::super::{ORIGIN, glb};
use super::open;
use cairn_gltf::Resolver;
use cairn_gltf::document::Object;
use glam::{DMat3, DMat4, DQuat, DVec3};
use openusd::sdf::{AbstractData, ChildrenKey, FieldKey, Path, Value};
use serde_json::json;
use std::collections::BTreeMap;
use values::{number, quaternion, quaternions, vector, vectors};

/// Nodes of the result, and levels of prims: more than any pile has.
const MOST_NODES: usize = 4_000_000;
const MOST_LEVELS: usize = 200;

/// The `.glb` of a file in any of USD's formats, or why there is none.
pub fn to_gltf(bytes: &[u8], resolve: &Resolver) -> Result<Vec<u8>, String> {
    // The crate's readers trust what they read: some damaged files make them panic.
    let read = || -> Result<Vec<u8>, String> {
        let layer = open(bytes).ok_or("it is damaged, or no USD")?;
        let in_package = |name: &str| surface::file_in(bytes, name).ok_or_else(|| format!("there is no {name} in it"));
        let is_package = bytes.starts_with(b"PK");
        let pictures: &Resolver = if is_package { &in_package } else { resolve };
        Converter::new(&*layer, pictures).convert()
    };
    let read = std::panic::AssertUnwindSafe(read);
    std::panic::catch_unwind(read).unwrap_or_else(|_| Err("it is damaged".into()))
}

/// Values by their time codes, the first at the start of the stage or before.
type Samples<T> = Vec<(f64, T)>;

struct Converter<'a> {
    layer: &'a dyn AbstractData,
    pictures: &'a Resolver<'a>,
    out: GlbOutput,
    nodes: usize,
    /// Start, end and number per second of the time codes.
    clock: [f64; 3],
    meshes: BTreeMap<String, usize>,
    materials: BTreeMap<String, Option<usize>>,
    images: BTreeMap<String, usize>,
    times: BTreeMap<Vec<u64>, usize>,
    channels: Vec<serde_json::Value>,
    samplers: Vec<serde_json::Value>,
}

impl<'a> Converter<'a> {
    fn new(layer: &'a dyn AbstractData, pictures: &'a Resolver<'a>) -> Converter<'a> {
        Converter {
            layer,
            pictures,
            out: GlbOutput::default(),
            nodes: 0,
            clock: [0.0, 0.0, 24.0],
            meshes: BTreeMap::new(),
            materials: BTreeMap::new(),
            images: BTreeMap::new(),
            times: BTreeMap::new(),
            channels: Vec::new(),
            samplers: Vec::new(),
        }
    }

    fn convert(mut self) -> Result<Vec<u8>, String> {
        let root = Path::abs_root();
        let number = |key: &str| self.field(&root, key).and_then(number);
        let rate = number(FieldKey::TimeCodesPerSecond.as_str()).filter(|rate| *rate > 0.0 && rate.is_finite());
        let start = number(FieldKey::StartTimeCode.as_str()).unwrap_or(0.0);
        let end = number(FieldKey::EndTimeCode.as_str()).filter(|end| *end >= start).unwrap_or(start);
        let unit = number("metersPerUnit").filter(|unit| *unit > 0.0 && unit.is_finite()).unwrap_or(0.01);
        self.clock = [start, end, rate.unwrap_or(24.0)];
        let is_z_up = matches!(self.field(&root, "upAxis"), Some(Value::Token(axis)) if axis.as_str() == "Z");
        let mut tops = Vec::new();
        for child in self.children(&root) {
            tops.extend(self.prim(&child, None, 0)?);
        }
        let mut top = json!({ "name": "stage", "children": tops, "scale": [unit, unit, unit] });
        if is_z_up {
            let turn = std::f64::consts::FRAC_1_SQRT_2;
            top["rotation"] = json!([-turn, 0.0, 0.0, turn]);
        }
        if tops.is_empty() {
            return Err("it shows no meshes".into());
        }
        let top = self.node(top)?;
        if !self.channels.is_empty() {
            let animation = json!({ "name": "pile", "channels": self.channels, "samplers": self.samplers });
            self.out.push("animations", animation);
        }
        let (mut json, bin) = self.out.into_json();
        json.insert("asset".into(), json!({ "version": "2.0", "generator": "cairn" }));
        json.insert("scene".into(), json!(0));
        json.insert("scenes".into(), json!([{ "nodes": [top] }]));
        json.insert("buffers".into(), json!([{ "byteLength": bin.len() }]));
        let json = serde_json::to_vec(&json).map_err(|error| error.to_string())?;
        glb::container(&json, &bin).map_err(|error| error.to_string())
    }

    fn node(&mut self, node: serde_json::Value) -> Result<usize, String> {
        self.nodes += 1;
        if self.nodes > MOST_NODES {
            return Err(format!("it has more than {MOST_NODES} prims and instances"));
        }
        Ok(self.out.push("nodes", node))
    }

    fn field(&self, path: &Path, key: &str) -> Option<Value> {
        Some(self.layer.try_field(path, key).ok()??.into_owned())
    }

    /// The value of an attribute, where it does not change with time.
    fn value(&self, prim: &Path, name: &str) -> Option<Value> {
        self.field(&prim.append_property(name).ok()?, FieldKey::Default.as_str())
    }

    fn token(&self, prim: &Path, name: &str) -> Option<String> {
        match self.value(prim, name)? {
            Value::Token(token) => Some(token.as_str().to_owned()),
            _ => None,
        }
    }

    /// The samples of an attribute from the start of the stage on; of one that does not change, one.
    fn samples<T>(&self, prim: &Path, name: &str, read: impl Fn(Value) -> Option<T>) -> Option<Samples<T>> {
        let path = prim.append_property(name).ok()?;
        let start = self.clock[0];
        let Some(Value::TimeSamples(samples)) = self.field(&path, FieldKey::TimeSamples.as_str()) else {
            return Some(vec![(start, read(self.field(&path, FieldKey::Default.as_str())?)?)]);
        };
        // What is there at the start was set before it.
        let first = samples.partition_point(|(time, _)| *time <= start).saturating_sub(1);
        let samples = samples.into_iter().skip(first).map(|(time, value)| Some((time.max(start), read(value)?)));
        samples.collect::<Option<Vec<_>>>().filter(|samples| !samples.is_empty())
    }

    fn targets(&self, prim: &Path, name: &str, key: FieldKey) -> Vec<Path> {
        let targets = prim.append_property(name).ok().and_then(|path| self.field(&path, key.as_str()));
        match targets {
            Some(Value::PathListOp(list)) => list.flatten(),
            Some(Value::PathVec(list)) => list,
            _ => Vec::new(),
        }
    }

    fn children(&self, prim: &Path) -> Vec<Path> {
        let Some(Value::TokenVec(names)) = self.field(prim, ChildrenKey::PrimChildren.as_str()) else {
            return Vec::new();
        };
        names.iter().filter_map(|name| prim.append_path(name.as_str()).ok()).collect()
    }

    fn kind(&self, prim: &Path) -> String {
        match self.field(prim, FieldKey::TypeName.as_str()) {
            Some(Value::Token(kind)) => kind.as_str().to_owned(),
            _ => String::new(),
        }
    }

    /// The node of a prim and of all below it, if it shows anything. `above`: the material of what has none.
    fn prim(&mut self, prim: &Path, above: Option<&Path>, level: usize) -> Result<Option<usize>, String> {
        if level > MOST_LEVELS {
            return Err(format!("{}: prims are nested too deeply", prim.as_str()));
        }
        let kind = self.kind(prim);
        let is_off = matches!(self.field(prim, FieldKey::Active.as_str()), Some(Value::Bool(false)));
        let is_hidden = self.token(prim, "visibility").is_some_and(|seen| seen == "invisible");
        let is_aid = self.token(prim, "purpose").is_some_and(|purpose| purpose == "guide" || purpose == "proxy");
        if is_off || is_hidden || is_aid || ["Material", "Shader", "GeomSubset", "Camera"].contains(&&*kind) {
            return Ok(None);
        }
        let own = self.targets(prim, "material:binding", FieldKey::TargetPaths).into_iter().next();
        let material = own.as_ref().or(above);
        let mut node = Object::from_iter([("name".to_owned(), json!(prim.name().unwrap_or_default()))]);
        let mut children = Vec::new();
        match &*kind {
            "Mesh" => {
                if let Some(mesh) = self.mesh(prim, material)? {
                    node.insert("mesh".into(), json!(mesh));
                }
            }
            "PointInstancer" => {
                children = self.instances(prim, material, level)?;
                // A result of ours: its bodies are what the renderer calls the pile.
                if prim.as_str() == "/Pile/Bodies" && self.is_ours() {
                    let [start, end, rate] = self.clock;
                    node.insert("name".into(), json!("pile"));
                    node.insert("extras".into(), json!({ "fps": rate, "frames": (end - start).round() as u64 + 1 }));
                }
            }
            _ => {
                for child in self.children(prim) {
                    children.extend(self.prim(&child, material, level + 1)?);
                }
            }
        }
        if children.is_empty() && !node.contains_key("mesh") {
            return Ok(None);
        }
        if !children.is_empty() {
            node.insert("children".into(), json!(children));
        }
        let place = self.node(serde_json::Value::Null)?;
        self.transform(prim, &mut node, place)?;
        self.out.set("nodes", place, node);
        Ok(Some(place))
    }

    fn is_ours(&self) -> bool {
        let data = self.field(&Path::abs_root(), FieldKey::CustomLayerData.as_str());
        matches!(data, Some(Value::Dictionary(data)) if data.contains_key(ORIGIN))
    }

    /// The transform of a prim: parts that may move, where it has the usual ones, else a matrix.
    fn transform(&mut self, prim: &Path, node: &mut Object, place: usize) -> Result<(), String> {
        let Some(Value::TokenVec(order)) = self.value(prim, "xformOpOrder") else { return Ok(()) };
        let order: Vec<&str> = order.iter().map(|op| op.as_str()).collect();
        let usual = ["xformOp:translate", "xformOp:orient", "xformOp:scale"];
        let mut rest = &usual[..];
        let is_usual = order.iter().all(|op| match rest.iter().position(|one| one == op) {
            Some(at) => {
                rest = &rest[at + 1..];
                true
            }
            None => false,
        });
        if is_usual {
            for (op, name) in usual.into_iter().zip(["translation", "rotation", "scale"]) {
                if !order.contains(&op) {
                    continue;
                }
                if name == "rotation" {
                    let Some(samples) = self.samples(prim, op, quaternion) else { continue };
                    node.insert(name.into(), json!(samples[0].1));
                    self.channel(place, name, "LINEAR", &samples);
                } else {
                    let Some(samples) = self.samples(prim, op, vector) else { continue };
                    node.insert(name.into(), json!(samples[0].1));
                    self.channel(place, name, "LINEAR", &samples);
                }
            }
            return Ok(());
        }
        let mut all = DMat4::IDENTITY;
        for op in order {
            let matrix = self.op(prim, op).ok_or_else(|| format!("{}: {op} is not read", prim.as_str()))?;
            all *= matrix;
        }
        node.insert("matrix".into(), json!(all.to_cols_array()));
        Ok(())
    }

    /// One step of a transform, as at the start.
    fn op(&self, prim: &Path, op: &str) -> Option<DMat4> {
        let (name, is_inverse) = match op.strip_prefix("!invert!") {
            Some(name) => (name, true),
            None => (op, false),
        };
        let first = |samples: Option<Samples<[f32; 3]>>| Some(DVec3::from(samples?.first()?.1.map(f64::from)));
        let three = || first(self.samples(prim, name, vector));
        let one = || self.samples(prim, name, number)?.first().map(|sample| sample.1.to_radians());
        let euler = |order: [usize; 3]| {
            let angles = three()?.to_array().map(f64::to_radians);
            let turn = |axis: usize| match axis {
                0 => DMat3::from_rotation_x(angles[0]),
                1 => DMat3::from_rotation_y(angles[1]),
                _ => DMat3::from_rotation_z(angles[2]),
            };
            Some(DMat4::from_mat3(turn(order[2]) * turn(order[1]) * turn(order[0])))
        };
        let kind = name.strip_prefix("xformOp:")?.split(':').next()?;
        let matrix = match kind {
            "translate" => DMat4::from_translation(three()?),
            "scale" => DMat4::from_scale(three()?),
            "orient" => {
                let [x, y, z, w] = self.samples(prim, name, quaternion)?.first()?.1.map(f64::from);
                DMat4::from_quat(DQuat::from_xyzw(x, y, z, w).normalize())
            }
            "transform" => match self.samples(prim, name, Some)?.into_iter().next()?.1 {
                Value::Matrix4d(matrix) => DMat4::from_cols_array(&matrix.0),
                _ => return None,
            },
            "rotateX" => DMat4::from_rotation_x(one()?),
            "rotateY" => DMat4::from_rotation_y(one()?),
            "rotateZ" => DMat4::from_rotation_z(one()?),
            "rotateXYZ" => euler([0, 1, 2])?,
            "rotateXZY" => euler([0, 2, 1])?,
            "rotateYXZ" => euler([1, 0, 2])?,
            "rotateYZX" => euler([1, 2, 0])?,
            "rotateZXY" => euler([2, 0, 1])?,
            "rotateZYX" => euler([2, 1, 0])?,
            _ => return None,
        };
        let matrix = if is_inverse { matrix.inverse() } else { matrix };
        matrix.is_finite().then_some(matrix)
    }

    /// A node for each instance, with its prototype below it.
    fn instances(&mut self, prim: &Path, material: Option<&Path>, level: usize) -> Result<Vec<usize>, String> {
        let wrong = |what: &str| format!("{}: {what}", prim.as_str());
        let prototypes = self.targets(prim, "prototypes", FieldKey::TargetPaths);
        let Some(Value::IntVec(indices)) = self.value(prim, "protoIndices") else {
            return Err(wrong("it has no protoIndices that stay the same"));
        };
        let count = indices.len();
        let positions = self.samples(prim, "positions", vectors).ok_or_else(|| wrong("it has no positions"))?;
        let rotations = (self.samples(prim, "orientationsf", quaternions))
            .or_else(|| self.samples(prim, "orientations", quaternions))
            .unwrap_or_default();
        let scales = self.samples(prim, "scales", vectors).unwrap_or_default();
        let has_all = positions.iter().chain(&scales).all(|(_, all)| all.len() == count)
            && rotations.iter().all(|(_, all)| all.len() == count);
        if !has_all {
            return Err(wrong("its lists are of different lengths"));
        }
        let of = |samples: &Samples<Vec<[f32; 3]>>, i: usize| -> Samples<[f32; 3]> {
            samples.iter().map(|(time, all)| (*time, all[i])).collect()
        };
        let mut nodes = Vec::with_capacity(count);
        for (i, index) in indices.into_iter().enumerate() {
            let prototype = usize::try_from(index).ok().and_then(|index| prototypes.get(index));
            let prototype = prototype.ok_or_else(|| wrong("protoIndices name a prototype that it does not have"))?;
            let name = format!("{}.{i:04}", prototype.name().unwrap_or_default());
            let below = self.prim(&prototype.clone(), material, level + 1)?;
            let mut node = Object::from_iter([("name".to_owned(), json!(name))]);
            node.insert("children".into(), json!(below.into_iter().collect::<Vec<_>>()));
            let place = self.node(serde_json::Value::Null)?;
            let parts = [("translation", of(&positions, i), "LINEAR"), ("scale", of(&scales, i), "STEP")];
            for (part, samples, interpolation) in parts {
                if let Some((_, first)) = samples.first() {
                    node.insert(part.into(), json!(first));
                    self.channel(place, part, interpolation, &samples);
                }
            }
            let turns: Samples<[f32; 4]> = rotations.iter().map(|(time, all)| (*time, all[i])).collect();
            if let Some((_, first)) = turns.first() {
                node.insert("rotation".into(), json!(first));
                self.channel(place, "rotation", "LINEAR", &turns);
            }
            if below.is_none() {
                node.remove("children");
            }
            self.out.set("nodes", place, node);
            nodes.push(place);
        }
        Ok(nodes)
    }

    /// A channel of the animation, where anything changes.
    fn channel<const N: usize>(&mut self, node: usize, path: &str, how: &str, samples: &Samples<[f32; N]>) {
        if samples.iter().all(|(_, value)| *value == samples[0].1) {
            return;
        }
        let [start, _, rate] = self.clock;
        let seconds: Vec<f32> = samples.iter().map(|(time, _)| ((time - start) / rate) as f32).collect();
        let key: Vec<u64> = samples.iter().map(|(time, _)| time.to_bits()).collect();
        let input = match self.times.get(&key) {
            Some(input) => *input,
            None => {
                let input = self.numbers(&seconds, 1, Some([&seconds[..1], &seconds[seconds.len() - 1..]]));
                self.times.insert(key, input);
                input
            }
        };
        let values: Vec<f32> = samples.iter().flat_map(|(_, value)| *value).collect();
        let output = self.numbers(&values, N, None);
        self.channels.push(json!({ "sampler": self.samplers.len(), "target": { "node": node, "path": path } }));
        self.samplers.push(json!({ "input": input, "output": output, "interpolation": how }));
    }

    /// An accessor of floats.
    fn numbers(&mut self, values: &[f32], width: usize, bounds: Option<[&[f32]; 2]>) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let view = self.out.push_view(&bytes, Object::new());
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][width - 1];
        let mut accessor =
            json!({ "bufferView": view, "componentType": 5126, "type": kind, "count": values.len() / width });
        if let Some([low, high]) = bounds {
            (accessor["min"], accessor["max"]) = (json!(low), json!(high));
        }
        self.out.push("accessors", accessor)
    }
}
