//! A stage as a `.glb`, for the bake and for what shows results. Long: its parts share the state of one walk.
//!
//! It has meshes, base colours, and the motion of instances and of prims, as composed, with the variants that are
//! selected. A part of a stage, for a bake, stands still, as at the start. Subdivision, skins, and materials other than
//! `UsdPreviewSurface` are not there, which is noted.

mod instances;
mod mesh;
#[cfg(test)]
mod small_files;
mod surface;
#[cfg(test)]
mod tests;
mod transform;
mod values;

use super::super::copy::GlbOutput;
use super::super::{ORIGIN, glb};
use super::stage::{self, ComposedStage};
use cairn_gltf::Resolver;
use cairn_gltf::document::Object;
use glam::{DMat4, DQuat, DVec3};
use openusd::sdf::{FieldKey, Path, Value};
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet, HashSet};
pub(super) use values::number;

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
    /// The prims that make it up; none where a reference to them would not be in its place.
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

/// Shapes without meshes.
const NO_MESHES: [&str; 14] = [
    "Sphere",
    "Cube",
    "Cone",
    "Cylinder",
    "Cylinder_1",
    "Capsule",
    "Capsule_1",
    "Plane",
    "NurbsPatch",
    "TetMesh",
    "BasisCurves",
    "NurbsCurves",
    "HermiteCurves",
    "Points",
];

/// What a prim takes from those above it.
#[derive(Clone, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Inherited {
    material: Option<Path>,
    purpose: Option<String>,
}

struct Converter<'a> {
    stage: &'a ComposedStage,
    out: GlbOutput,
    nodes: usize,
    /// What prims take that move in other ways than glTF's.
    work: usize,
    /// Those that were looked at.
    prims: HashSet<Path>,
    /// Start, end and number per second of the time codes.
    clock: [f64; 3],
    /// All stands still, as at the start.
    is_still: bool,
    /// Nodes of prims whose place does not depend on the prims above them.
    resets: Vec<usize>,
    meshes: BTreeMap<String, Option<usize>>,
    /// Bytes that were read for them.
    mesh_bytes: usize,
    /// What a prototype became where it was shown first, with what it took from above.
    prototypes: BTreeMap<(Path, Inherited), Copied>,
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
    tops: Vec<usize>,
    nodes: std::ops::Range<usize>,
    channels: std::ops::Range<usize>,
}

impl<'a> Converter<'a> {
    fn new(stage: &'a ComposedStage) -> Converter<'a> {
        Converter {
            stage,
            out: GlbOutput::default(),
            nodes: 0,
            work: 0,
            prims: HashSet::new(),
            clock: [0.0, 0.0, 24.0],
            is_still: false,
            resets: Vec::new(),
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
        self.is_still = !choices.is_empty();
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
                tops.extend(self.prim(&child, Inherited::default(), 0)?);
            }
            tops.append(&mut self.resets);
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
        let (mut tops, mut placed, mut can_refer) = (Vec::new(), Vec::new(), true);
        for prim in prims {
            let mut ancestors: Vec<Path> = std::iter::successors(prim.parent(), Path::parent).collect();
            ancestors.retain(|ancestor| !ancestor.is_abs_root());
            let mut above = Inherited::default();
            let mut place = to_world;
            for ancestor in ancestors.iter().rev() {
                place = self.place(ancestor)?.below(place, to_world);
                above.material = self.binding(ancestor).or(above.material);
                above.purpose = self.purpose(ancestor).or(above.purpose);
            }
            let own = self.place(&prim)?;
            let mut world = to_world;
            if choice.at_origin && choice.prim.is_some() {
                let shift = DMat4::from_translation(-own.below(place, to_world).w_axis.truncate());
                (place, world) = (shift * place, shift * world);
            }
            let nodes = self.prim(&prim, above, 0)?;
            let resets = std::mem::take(&mut self.resets);
            // What is taken by reference keeps its places, of which these are not below the reference.
            let is_whole = resets.is_empty() && ancestors.iter().all(|above| !self.steps(above).resets);
            for (nodes, matrix) in [(Vec::from_iter(nodes), place), (resets, world)] {
                if nodes.is_empty() {
                    continue;
                }
                if matrix == DMat4::IDENTITY {
                    tops.extend(nodes);
                } else {
                    let placing = json!({ "name": "stage", "children": nodes, "matrix": matrix.to_cols_array() });
                    tops.push(self.node(placing)?);
                }
            }
            can_refer &= is_whole;
            let whole = self.holder(&prim);
            for ancestor in ancestors.iter().take_while(|_| whole != prim) {
                place *= self.place(ancestor)?.matrix.inverse();
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
        let prims = if can_refer { placed } else { Vec::new() };
        let part = StagePart { scene, prims, is_default };
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

    /// The nodes of a prototype, made once with all that it takes from above and then copied: the topmost one, and
    /// those whose place does not depend on it.
    fn prototype(&mut self, prim: &Path, above: &Inherited, level: usize) -> Result<Vec<usize>, String> {
        let key = (prim.clone(), above.clone());
        let Some(Copied { tops, nodes, channels }) = self.prototypes.get(&key).cloned() else {
            let [nodes, channels] = [self.nodes, self.channels.len()];
            let outside = std::mem::take(&mut self.resets);
            let mut tops = Vec::from_iter(self.prim(prim, above.clone(), level)?);
            tops.append(&mut self.resets);
            self.resets = outside;
            let made = Copied { tops: tops.clone(), nodes: nodes..self.nodes, channels: channels..self.channels.len() };
            self.prototypes.insert(key, made);
            return Ok(tops);
        };
        if tops.is_empty() {
            return Ok(tops);
        }
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
        Ok(tops.into_iter().map(|top| top + by).collect())
    }

    fn field(&self, path: &Path, key: &str) -> Option<Value> {
        self.stage.field(path, key)
    }

    /// The value of an attribute at the start of the stage.
    fn value(&self, prim: &Path, name: &str) -> Option<Value> {
        self.stage.value(prim, name, self.clock[0])
    }

    fn token(&self, prim: &Path, name: &str) -> Option<String> {
        stage::token(self.value(prim, name))
    }

    /// The samples of an attribute from the start of the stage on, the first one at it; one where it does not change,
    /// or all stands still.
    fn samples<T>(&self, prim: &Path, name: &str, read: impl Fn(Value) -> Option<T>) -> Option<Samples<T>> {
        let start = self.clock[0];
        let mut all = vec![(start, read(self.value(prim, name)?)?)];
        let later = if self.is_still { None } else { self.stage.samples(prim, name) };
        for (time, value) in later.into_iter().flatten().filter(|(time, _)| *time > start) {
            all.push((time, read(value)?));
        }
        Some(all)
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

    /// The purpose that a prim states.
    fn purpose(&self, prim: &Path) -> Option<String> {
        self.token(prim, "purpose")
    }

    /// The node of a prim and of all below it, if it shows anything below the prims above.
    fn prim(&mut self, prim: &Path, above: Inherited, level: usize) -> Result<Option<usize>, String> {
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
        let seen = self.seen(prim);
        if is_off || seen.iter().all(|(_, is_seen)| !is_seen) || ["Material", "Shader", "GeomSubset"].contains(&&*kind)
        {
            return Ok(None);
        }
        let inherited = Inherited {
            material: self.binding(prim).or(above.material),
            purpose: self.purpose(prim).or(above.purpose),
        };
        let is_aid = inherited.purpose.as_deref().is_some_and(|purpose| purpose == "guide" || purpose == "proxy");
        let mut node = Object::from_iter([("name".to_owned(), json!(prim.name().unwrap_or_default()))]);
        let mut children = Vec::new();
        match &*kind {
            _ if is_aid => {}
            "Mesh" => {
                if let Some(mesh) = self.mesh(prim, inherited.material.as_ref())? {
                    node.insert("mesh".into(), json!(mesh));
                }
            }
            kind if NO_MESHES.contains(&kind) => {
                self.note("it has shapes that are no meshes, which are left out: save them as meshes", prim);
            }
            "PointInstancer" => {
                children = self.instances(prim, &inherited, level)?;
                // A result of ours: its bodies are what the renderer calls the pile.
                if self.is_ours(prim) {
                    let [start, end, rate] = self.clock;
                    node.insert("name".into(), json!("pile"));
                    node.insert("extras".into(), json!({ "fps": rate, "frames": (end - start).round() as u64 + 1 }));
                }
            }
            "SkelRoot" => self.note("its skeleton is left out: meshes have their rest pose", prim),
            _ => {}
        }
        // What is below an instancer shows as its prototypes alone. Meshes may have prims below them, too.
        if kind != "PointInstancer" {
            for child in self.stage.children(prim) {
                children.extend(self.prim(&child, inherited.clone(), level + 1)?);
            }
        }
        if children.is_empty() && !node.contains_key("mesh") {
            return Ok(None);
        }
        if !children.is_empty() {
            node.insert("children".into(), json!(children));
        }
        let mut place = self.node(serde_json::Value::Null)?;
        let resets = self.transform(prim, &mut node, place)?;
        self.out.set("nodes", place, node);
        if seen.iter().any(|(_, is_seen)| *is_seen != seen[0].1) {
            let name = json!({ "name": format!("{} seen", prim.name().unwrap_or_default()), "children": [place] });
            place = self.node(serde_json::Value::Null)?;
            let sizes: Samples<[f32; 3]> =
                seen.into_iter().map(|(time, is_seen)| (time, [f32::from(u8::from(is_seen)); 3])).collect();
            let mut shown = name;
            shown["scale"] = json!(sizes[0].1);
            self.channel(place, "scale", "STEP", &sizes);
            self.out.set("nodes", place, shown);
        }
        if resets {
            self.resets.push(place);
            return Ok(None);
        }
        Ok(Some(place))
    }

    /// When a prim can be seen, from the start on.
    fn seen(&self, prim: &Path) -> Samples<bool> {
        let seen = self.samples(prim, "visibility", |value| stage::token(Some(value)).map(|seen| seen != "invisible"));
        seen.unwrap_or_else(|| vec![(self.clock[0], true)])
    }

    /// Whether a prim has the bodies of a result of ours.
    fn is_ours(&self, prim: &Path) -> bool {
        let data = self.field(&Path::abs_root(), FieldKey::CustomLayerData.as_str());
        let top = self.stage.default_prim().and_then(|top| top.append_path("Bodies").ok());
        matches!(data, Some(Value::Dictionary(data)) if data.contains_key(ORIGIN)) && top.as_ref() == Some(prim)
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
