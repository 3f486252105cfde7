//! `report.json`: the core's measures and counts, their inputs, and their cost.

use crate::machine;
use cairn_core::report::bake::{Bake, BakedPile};
use cairn_export::Encoded;
use cairn_wire::proto;
use cairn_wire::scene_file::SceneTree;
use cairn_wire::versions::versions;
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// Seconds that the caller of the core measured, since it began to read the files.
pub struct CallerSeconds {
    /// CPU time, like the next two.
    pub read: f64,
    pub encode: f64,
    /// Total, including the core's stages.
    pub cpu: f64,
    pub wall: f64,
}

/// The identity of a report's result.
pub struct ResultIdentity<'a> {
    /// See [`crate::request::hash`].
    pub request: blake3::Hash,
    /// See [`result_hash`].
    pub result: blake3::Hash,
    /// Hash of the result's file.
    pub output: blake3::Hash,
    /// Name of the result's file.
    pub name: &'a str,
}

/// The versions that decide a result, as in reports and results.
pub fn versions_json() -> Value {
    let proto::Versions { cairn, rapier3d, clarabel } = versions();
    json!({ "cairn": cairn, "rapier3d": rapier3d, "clarabel": clarabel })
}

/// The parts of a report that programs read back.
#[derive(Deserialize)]
pub struct ReportFile {
    #[serde(default)]
    pub request_blake3: String,
    pub output_blake3: String,
    seed: Option<f64>,
    pub bodies: Option<f64>,
    pub cpu_seconds: Option<f64>,
    #[serde(default)]
    pub measures: BTreeMap<String, Option<f64>>,
    #[serde(default)]
    counts: BTreeMap<String, f64>,
}

impl ReportFile {
    /// Measures, counts, seed, bodies and CPU seconds by name.
    pub fn figures(self) -> BTreeMap<String, f64> {
        let own = [("seed", self.seed), ("bodies", self.bodies), ("cpu_seconds", self.cpu_seconds)];
        let own = own.into_iter().map(|(name, value)| (name.to_owned(), value));
        let all = own.chain(self.measures).filter_map(|(name, value)| Some((name, value?)));
        all.chain(self.counts).collect()
    }
}

/// The content of the report file.
pub fn json(
    bake: &Bake,
    identity: &ResultIdentity,
    scene: &SceneTree,
    notes: &[String],
    seconds: &CallerSeconds,
) -> Value {
    let mut report = Map::new();
    report.insert("versions".into(), versions_json());
    report.insert("output".into(), identity.name.into());
    for (name, hash) in [("request", identity.request), ("result", identity.result), ("output", identity.output)] {
        report.insert(format!("{name}_blake3"), hash.to_hex().as_str().into());
    }
    let figures = serde_json::to_value(&bake.report).expect("a report has a JSON form");
    for (name, value) in figures.as_object().into_iter().flatten() {
        // The effective scene below holds them in the scene file's terms. Most piles are not taken apart.
        let is_nothing = match name.as_str() {
            "removals" => value.as_array().is_some_and(Vec::is_empty),
            "collapse" => value.is_null(),
            _ => false,
        };
        if name != "params" && !is_nothing {
            report.insert(name.clone(), value.clone());
        }
    }
    report.insert("glue".into(), json!(bake.pile.glue));
    for (stage, spent) in [("read", seconds.read), ("encode", seconds.encode)] {
        report["seconds"][stage] = json!(spent);
    }
    report.insert("notes".into(), json!(notes));
    report.insert("scene".into(), scene.to_value());
    report.insert("wall_seconds".into(), json!(seconds.wall));
    report.insert("cpu_seconds".into(), json!(seconds.cpu));
    report.insert("peak_memory_bytes".into(), json!(machine::peak_memory()));
    Value::Object(report)
}

/// The report of a bake's result in a further format. `first`: the report of the first one. `notes`: about the files.
pub fn of_format(first: &str, name: &str, result: &Encoded, notes: &[String]) -> Result<String, serde_json::Error> {
    let mut report: Map<String, Value> = serde_json::from_str(first)?;
    let notes: Vec<&String> = notes.iter().chain(&result.left_out).collect();
    report.insert("output".into(), name.into());
    report.insert("output_blake3".into(), blake3::hash(&result.bytes).to_hex().as_str().into());
    report.insert("notes".into(), json!(notes));
    Ok(format!("{:#}\n", Value::Object(report)))
}

/// Hash of a result: equal for equal bodies and frames, to the last bit, in any format.
///
/// BLAKE3 over little-endian bytes: fps; number of bodies; each body's prop and scale; number of frames; each frame's
/// poses as translation x, y, z and rotation x, y, z, w; of each body that appears later, its index and first frame;
/// the poses of moving scenery likewise. Counts and indices are 64 bit, the rest doubles.
pub fn result_hash(pile: &BakedPile) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&pile.fps.to_le_bytes());
    hasher.update(&(pile.bodies.len() as u64).to_le_bytes());
    for body in &pile.bodies {
        hasher.update(&(body.prop as u64).to_le_bytes());
        hasher.update(&body.scale.to_le_bytes());
    }
    hasher.update(&(pile.frames.len() as u64).to_le_bytes());
    let late = pile.bodies.iter().enumerate().filter(|(_, body)| body.first_frame > 0);
    let late: Vec<u64> = late.flat_map(|(i, body)| [i as u64, body.first_frame as u64]).collect();
    for pose in pile.frames.iter().flatten().chain(pile.scenery.iter().flatten()) {
        for number in pose.translation.to_array().into_iter().chain(pose.rotation.to_array()) {
            hasher.update(&number.to_le_bytes());
        }
    }
    for number in late {
        hasher.update(&number.to_le_bytes());
    }
    hasher.finalize()
}
