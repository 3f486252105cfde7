//! A stage as a `.glb`, for the bake and for what shows results. Long: its parts share the state of one walk.
//!
//! It has meshes, base colours, and the motion of instances and of prims, as composed, with the variants that are
//! selected. Subdivision, skins, and materials other than `UsdPreviewSurface` are not there, which is noted.

mod mesh;
mod surface;
#[cfg(test)]
mod tests;
mod values;

use super::super::copy::GlbOutput;
use super::super::{ORIGIN, glb};
use super::stage::{self, ComposedStage};
use cairn_gltf::Resolver;
use cairn_gltf::document::Object;
use glam::{DMat3, DMat4, DQuat, DVec3};
use openusd::sdf::{FieldKey, Path, Value};
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet, HashSet};
use values::{number, quaternion, quaternions, vector, vectors};

/// Nodes of the result of small files, and bytes of files for each further one: nodes take a kilobyte while they are
/// made. More than any pile has.
const FEW_NODES: usize = 200_000;
const BYTES_OF_A_NODE: usize = 16;
/// Bytes of meshes that the result of small files may have, and how often the bytes of files.
const FEW_MESH_BYTES: usize = 64 << 20;
const TIMES_MESH_BYTES: usize = 32;
/// Prims, which take some 100 microseconds and 10 KiB each to compose, of a small file; and bytes of a larger one for
/// each further prim.
const FEW_PRIMS: usize = 10_000;
const BYTES_OF_A_PRIM: usize = 64;
/// Levels of prims.
const MOST_LEVELS: usize = 200;

/// A stage as glTF.
pub struct ConvertedStage {
    pub glb: Vec<u8>,
    /// What is not as in the stage, one sentence each.
    pub notes: Vec<String>,
    /// The files that it was made of besides the first one, by their paths from its folder.
    pub files: BTreeMap<String, Vec<u8>>,
    /// The parts that were asked for, in their order.
    pub parts: Vec<StagePart>,
}

/// A part of a stage as a scene of its own, for a bake.
pub struct StagePart {
    /// The name of the scene in the `.glb`.
    pub scene: String,
    /// The prims that make it up.
    pub prims: Vec<PartPrim>,
    /// A reference to the file without a prim takes it.
    pub is_default: bool,
}

/// A prim to which a result refers.
pub struct PartPrim {
    pub path: String,
    /// Places it besides its own transform.
    pub place: DMat4,
    /// Paths from it of prims that are no part of the model: it is above the part, because a material is.
    pub off: Vec<String>,
}

/// A wanted part of a stage.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct PartChoice {
    /// Path of a prim; `None`: the default prim, or all.
    pub prim: Option<String>,
    /// In a frame at the prim's own origin.
    pub at_origin: bool,
}

/// The `.glb` of all that a file in any of USD's formats shows, or why there is none.
pub fn to_gltf(bytes: &[u8], resolve: &Resolver) -> Result<Vec<u8>, String> {
    convert(bytes, resolve, &[]).map(|converted| converted.glb)
}

/// The `.glb` of all that a stage shows, or of parts of it.
pub fn convert(bytes: &[u8], resolve: &Resolver, parts: &[PartChoice]) -> Result<ConvertedStage, String> {
    // The crate's readers trust what they read: some damaged files make them panic.
    let read = || {
        let (mut converted, files) = stage::compose(bytes, resolve, |stage| Converter::new(stage).convert(parts))?;
        converted.files = files;
        Ok(converted)
    };
    let read = std::panic::AssertUnwindSafe(read);
    std::panic::catch_unwind(read).unwrap_or_else(|_| Err("it is damaged".into()))
}

/// Values by their time codes, the first at the start of the stage or before.
type Samples<T> = Vec<(f64, T)>;

struct Converter<'a> {
    stage: &'a ComposedStage,
    out: GlbOutput,
    nodes: usize,
    /// Those that were looked at.
    prims: HashSet<Path>,
    /// Start, end and number per second of the time codes.
    clock: [f64; 3],
    meshes: BTreeMap<String, Option<usize>>,
    /// Bytes that were read for them.
    mesh_bytes: usize,
    /// What a prototype became with a material where it was shown first.
    prototypes: BTreeMap<(Path, Option<Path>), Copied>,
    materials: BTreeMap<String, Option<usize>>,
    images: BTreeMap<String, usize>,
    times: BTreeMap<Vec<u64>, usize>,
    channels: Vec<serde_json::Value>,
    samplers: Vec<serde_json::Value>,
    /// What is left out, with the prims in which it was met.
    left_out: BTreeMap<&'static str, BTreeSet<String>>,
}

/// Nodes and channels of a prototype, which are made again for each further instance.
#[derive(Clone)]
struct Copied {
    top: Option<usize>,
    nodes: std::ops::Range<usize>,
    channels: std::ops::Range<usize>,
}

impl<'a> Converter<'a> {
    fn new(stage: &'a ComposedStage) -> Converter<'a> {
        Converter {
            stage,
            out: GlbOutput::default(),
            nodes: 0,
            prims: HashSet::new(),
            clock: [0.0, 0.0, 24.0],
            meshes: BTreeMap::new(),
            mesh_bytes: 0,
            prototypes: BTreeMap::new(),
            materials: BTreeMap::new(),
            images: BTreeMap::new(),
            times: BTreeMap::new(),
            channels: Vec::new(),
            samplers: Vec::new(),
            left_out: BTreeMap::new(),
        }
    }

    fn convert(mut self, choices: &[PartChoice]) -> Result<ConvertedStage, String> {
        let root = Path::abs_root();
        let number = |key: &str| self.field(&root, key).and_then(number);
        let rate = number(FieldKey::TimeCodesPerSecond.as_str()).filter(|rate| *rate > 0.0 && rate.is_finite());
        let start = number(FieldKey::StartTimeCode.as_str()).unwrap_or(0.0);
        let end = number(FieldKey::EndTimeCode.as_str()).filter(|end| *end >= start).unwrap_or(start);
        let unit = number("metersPerUnit").filter(|unit| *unit > 0.0 && unit.is_finite()).unwrap_or(0.01);
        self.clock = [start, end, rate.unwrap_or(24.0)];
        let turn = match stage::token(self.field(&root, "upAxis")).as_deref() {
            Some("Z") => DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2),
            _ => DQuat::IDENTITY,
        };
        // From the stage's units and axes to glTF's.
        let to_world = DMat4::from_scale_rotation_translation(DVec3::splat(unit), turn, DVec3::ZERO);
        let (mut scenes, mut parts) = (Vec::new(), Vec::new());
        if choices.is_empty() {
            let mut tops = Vec::new();
            for child in self.stage.children(&root) {
                tops.extend(self.prim(&child, None, 0)?);
            }
            if tops.is_empty() {
                return Err("it shows no meshes".into());
            }
            let top = self.node(json!({
                "name": "stage", "children": tops, "scale": [unit, unit, unit], "rotation": turn.as_quat().to_array(),
            }))?;
            scenes.push(json!({ "nodes": [top] }));
        }
        for choice in choices {
            // No prim has a name with a space.
            let (scene, part) = self.part(choice, format!("part {}", scenes.len()), to_world)?;
            scenes.push(scene);
            parts.push(part);
        }
        if !self.channels.is_empty() {
            let animation = json!({ "name": "pile", "channels": self.channels, "samplers": self.samplers });
            self.out.push("animations", animation);
        }
        let notes = self.left_out.iter().map(|(what, prims)| {
            let first = prims.first().map_or("", String::as_str);
            let more = if prims.len() > 1 { format!(" and {} more", prims.len() - 1) } else { String::new() };
            format!("{what} ({first}{more})")
        });
        let notes = notes.collect();
        let (mut json, bin) = self.out.into_json();
        json.insert("asset".into(), json!({ "version": "2.0", "generator": "cairn" }));
        json.insert("scene".into(), json!(0));
        json.insert("scenes".into(), json!(scenes));
        json.insert("buffers".into(), json!([{ "byteLength": bin.len() }]));
        let json = serde_json::to_vec(&json).map_err(|error| error.to_string())?;
        let glb = glb::container(&json, &bin).map_err(|error| error.to_string())?;
        Ok(ConvertedStage { glb, notes, files: BTreeMap::new(), parts })
    }

    /// The prim that has a prim and its materials: a reference to it keeps what is bound.
    fn holder(&self, prim: &Path) -> Path {
        let targets = self.bound_below(prim, 0);
        let mut holder = prim.clone();
        while let Some(above) = holder.parent().filter(|above| !above.is_abs_root()) {
            if targets.iter().all(|target| is_at_or_below(target, &holder)) {
                return holder;
            }
            holder = above;
        }
        if targets.iter().all(|target| is_at_or_below(target, &holder)) { holder } else { prim.clone() }
    }

    /// The materials of a prim and of all below it.
    fn bound_below(&self, prim: &Path, level: usize) -> BTreeSet<Path> {
        let mut targets: BTreeSet<Path> = self.binding(prim).into_iter().collect();
        if level < MOST_LEVELS {
            targets.extend(self.stage.children(prim).iter().flat_map(|child| self.bound_below(child, level + 1)));
        }
        targets
    }

    /// The prims below `whole` that are neither on the way to `prim` nor hold its materials, by their paths from
    /// `whole`.
    fn beside(&self, whole: &Path, prim: &Path) -> Vec<String> {
        let targets = self.bound_below(prim, 0);
        let mut off = Vec::new();
        let mut at = whole.clone();
        while at != *prim {
            let Some(next) = self.stage.children(&at).into_iter().find(|child| is_at_or_below(prim, child)) else {
                break;
            };
            let others = self.stage.children(&at).into_iter().filter(|child| *child != next);
            let others = others.filter(|child| !targets.iter().any(|target| is_at_or_below(target, child)));
            off.extend(others.map(|other| other.as_str()[whole.as_str().len() + 1..].to_owned()));
            at = next;
        }
        off
    }

    /// A scene of a part.
    fn part(
        &mut self,
        choice: &PartChoice,
        scene: String,
        to_world: DMat4,
    ) -> Result<(serde_json::Value, StagePart), String> {
        let root = Path::abs_root();
        let (prims, is_default) = match &choice.prim {
            Some(path) => {
                let prim = openusd::sdf::path(path).ok().filter(|prim| !prim.is_abs_root() && path.starts_with('/'));
                let prim = prim.filter(|prim| self.stage.is_shown(prim));
                let prim = prim.ok_or_else(|| {
                    let tops: Vec<_> = self.stage.children(&root).iter().map(|top| top.as_str().to_owned()).collect();
                    format!("it has no prim {path}; its top prims: {}", tops.join(", "))
                })?;
                (vec![prim], false)
            }
            None => match self.stage.default_prim() {
                Some(prim) => (vec![prim], true),
                None => (self.stage.children(&root), false),
            },
        };
        let (mut tops, mut placed) = (Vec::new(), Vec::new());
        for prim in prims {
            let mut above = to_world;
            let mut material = None;
            let mut ancestors: Vec<Path> = std::iter::successors(prim.parent(), Path::parent).collect();
            ancestors.retain(|ancestor| !ancestor.is_abs_root());
            for ancestor in ancestors.iter().rev() {
                above *= self.matrix(ancestor)?;
                material = self.binding(ancestor).or(material);
            }
            if choice.at_origin && choice.prim.is_some() {
                let origin = (above * self.matrix(&prim)?).w_axis.truncate();
                above = DMat4::from_translation(-origin) * above;
            }
            if let Some(node) = self.prim(&prim, material.as_ref(), 0)? {
                let is_still = above == DMat4::IDENTITY;
                let placing = json!({ "name": "stage", "children": [node], "matrix": above.to_cols_array() });
                tops.push(if is_still { node } else { self.node(placing)? });
            }
            let whole = self.holder(&prim);
            let mut place = above;
            for ancestor in ancestors.iter().take_while(|_| whole != prim) {
                place *= self.matrix(ancestor)?.inverse();
                if *ancestor == whole {
                    break;
                }
            }
            let off = self.beside(&whole, &prim);
            placed.push(PartPrim { path: whole.as_str().to_owned(), place, off });
        }
        if tops.is_empty() {
            return Err(match &choice.prim {
                Some(path) => format!("its prim {path} shows no meshes"),
                None => "it shows no meshes".into(),
            });
        }
        let part = StagePart { scene, prims: placed, is_default };
        Ok((json!({ "name": part.scene, "nodes": tops }), part))
    }

    fn node(&mut self, node: serde_json::Value) -> Result<usize, String> {
        self.nodes += 1;
        let most = FEW_NODES + self.stage.bytes() / BYTES_OF_A_NODE;
        if self.nodes > most {
            return Err(format!("it shows more than {most} prims and instances of few bytes: it is not read"));
        }
        Ok(self.out.push("nodes", node))
    }

    /// Counts bytes that are read for meshes.
    fn take_mesh_bytes(&mut self, bytes: usize) -> Result<(), String> {
        self.mesh_bytes = self.mesh_bytes.saturating_add(bytes);
        let most = FEW_MESH_BYTES + self.stage.bytes().saturating_mul(TIMES_MESH_BYTES);
        if self.mesh_bytes > most {
            return Err(format!("its references repeat meshes of more than {} MiB: make them instances", most >> 20));
        }
        Ok(())
    }

    /// The node of a prototype and of all below it, made once with each material and then copied.
    fn prototype(&mut self, prim: &Path, above: Option<&Path>, level: usize) -> Result<Option<usize>, String> {
        let key = (prim.clone(), above.cloned());
        let Some(Copied { top, nodes, channels }) = self.prototypes.get(&key).cloned() else {
            let [nodes, channels] = [self.nodes, self.channels.len()];
            let top = self.prim(prim, above, level)?;
            let made = Copied { top, nodes: nodes..self.nodes, channels: channels..self.channels.len() };
            self.prototypes.insert(key, made);
            return Ok(top);
        };
        let Some(top) = top else { return Ok(None) };
        let by = self.nodes - nodes.start;
        let move_on = |number: &mut serde_json::Value| {
            if let Some(index) = number.as_u64() {
                *number = json!(index + by as u64);
            }
        };
        for index in nodes {
            let mut node = self.out.entry("nodes", index);
            node.get_mut("children").and_then(|all| all.as_array_mut()).into_iter().flatten().for_each(move_on);
            self.node(node)?;
        }
        for index in channels {
            let mut channel = self.channels[index].clone();
            channel.pointer_mut("/target/node").into_iter().for_each(move_on);
            self.channels.push(channel);
        }
        Ok(Some(top + by))
    }

    fn field(&self, path: &Path, key: &str) -> Option<Value> {
        self.stage.field(path, key)
    }

    /// The value of an attribute; of one that changes with time, the first from the start of the stage on.
    fn value(&self, prim: &Path, name: &str) -> Option<Value> {
        let value = self.stage.value(prim, name);
        value.or_else(|| self.samples(prim, name, Some)?.into_iter().next().map(|(_, value)| value))
    }

    fn token(&self, prim: &Path, name: &str) -> Option<String> {
        stage::token(self.value(prim, name))
    }

    /// The samples of an attribute from the start of the stage on; of one that does not change, one.
    fn samples<T>(&self, prim: &Path, name: &str, read: impl Fn(Value) -> Option<T>) -> Option<Samples<T>> {
        let start = self.clock[0];
        let Some(samples) = self.stage.samples(prim, name).filter(|samples| !samples.is_empty()) else {
            return Some(vec![(start, read(self.stage.value(prim, name)?)?)]);
        };
        // What is there at the start was set before it.
        let first = samples.partition_point(|(time, _)| *time <= start).saturating_sub(1);
        let samples = samples.into_iter().skip(first).map(|(time, value)| Some((time.max(start), read(value)?)));
        samples.collect::<Option<Vec<_>>>().filter(|samples| !samples.is_empty())
    }

    fn kind(&self, prim: &Path) -> String {
        stage::token(self.field(prim, FieldKey::TypeName.as_str())).unwrap_or_default()
    }

    /// The material that is bound to a prim itself.
    fn binding(&self, prim: &Path) -> Option<Path> {
        let names = ["material:binding:full", "material:binding", "material:binding:preview"];
        names.iter().find_map(|name| self.stage.targets(prim, name).into_iter().next())
    }

    fn note(&mut self, what: &'static str, prim: &Path) {
        self.left_out.entry(what).or_default().insert(prim.as_str().to_owned());
    }

    /// The node of a prim and of all below it, if it shows anything. `above`: the material of what has none.
    fn prim(&mut self, prim: &Path, above: Option<&Path>, level: usize) -> Result<Option<usize>, String> {
        if level > MOST_LEVELS {
            return Err(format!("{}: prims are nested too deeply", prim.as_str()));
        }
        self.stage.check()?;
        let is_new = self.prims.insert(prim.clone()) && self.prims.len() > FEW_PRIMS;
        let most = if is_new { FEW_PRIMS + self.stage.bytes() / BYTES_OF_A_PRIM } else { usize::MAX };
        if self.prims.len() > most {
            return Err(format!("its references make more than {most} prims of few: it is not composed"));
        }
        let kind = self.kind(prim);
        let is_off = matches!(self.field(prim, FieldKey::Active.as_str()), Some(Value::Bool(false)));
        let is_hidden = self.token(prim, "visibility").is_some_and(|seen| seen == "invisible");
        let is_aid = self.token(prim, "purpose").is_some_and(|purpose| purpose == "guide" || purpose == "proxy");
        if is_off || is_hidden || is_aid || ["Material", "Shader", "GeomSubset", "Camera"].contains(&&*kind) {
            return Ok(None);
        }
        let own = self.binding(prim);
        let material = own.as_ref().or(above);
        let mut node = Object::from_iter([("name".to_owned(), json!(prim.name().unwrap_or_default()))]);
        let mut children = Vec::new();
        match &*kind {
            "Mesh" => {
                if let Some(mesh) = self.mesh(prim, material)? {
                    node.insert("mesh".into(), json!(mesh));
                }
            }
            "Sphere" | "Cube" | "Cone" | "Cylinder" | "Capsule" | "Plane" | "NurbsPatch" => {
                self.note("it has shapes that are no meshes, which are left out: save them as meshes", prim);
            }
            "PointInstancer" => {
                children = self.instances(prim, material, level)?;
                // A result of ours: its bodies are what the renderer calls the pile.
                if self.is_ours(prim) {
                    let [start, end, rate] = self.clock;
                    node.insert("name".into(), json!("pile"));
                    node.insert("extras".into(), json!({ "fps": rate, "frames": (end - start).round() as u64 + 1 }));
                }
            }
            _ => {
                if kind == "SkelRoot" {
                    self.note("its skeleton is left out: meshes have their rest pose", prim);
                }
                for child in self.stage.children(prim) {
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

    /// Whether a prim has the bodies of a result of ours.
    fn is_ours(&self, prim: &Path) -> bool {
        let data = self.field(&Path::abs_root(), FieldKey::CustomLayerData.as_str());
        let top = self.stage.default_prim().and_then(|top| top.append_path("Bodies").ok());
        matches!(data, Some(Value::Dictionary(data)) if data.contains_key(ORIGIN)) && top.as_ref() == Some(prim)
    }

    /// The transform of a prim, as at the start.
    fn matrix(&self, prim: &Path) -> Result<DMat4, String> {
        let Some(Value::TokenVec(order)) = self.value(prim, "xformOpOrder") else { return Ok(DMat4::IDENTITY) };
        let mut all = DMat4::IDENTITY;
        for op in &order {
            let op = op.as_str();
            all *= self.op(prim, op).ok_or_else(|| format!("{}: {op} is not read", prim.as_str()))?;
        }
        Ok(all)
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
        node.insert("matrix".into(), json!(self.matrix(prim)?.to_cols_array()));
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
        let prototypes = self.stage.targets(prim, "prototypes");
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
            let below = self.prototype(&prototype.clone(), material, level + 1)?;
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

/// Whether a prim is another one or below it.
fn is_at_or_below(prim: &Path, above: &Path) -> bool {
    let rest = prim.as_str().strip_prefix(above.as_str());
    rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
}
